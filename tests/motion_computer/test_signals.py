"""Setpoint signals: characteristic points, exact derivatives by finite differences, data in and out, bad input."""

import dataclasses

import numpy as np
import polars as pl
import pytest

from hexsim import HexsimError
from hexsim.scenarios import scenario_from_dict
from hexsim.setpoints import signals

SMOOTH = {  # signals whose velocity and acceleration exist everywhere
    "constant": signals.Constant(level=0.02),
    "sine": signals.Sine(amplitude=0.05, frequency_Hz=0.5, phase_rad=0.3),
    "multisine": signals.Multisine(amplitudes=(0.01, 0.02, 0.005), frequencies_Hz=(0.3, 0.7, 2.1), seed=4),
    "sweep": signals.Sweep(amplitude=0.05, start_Hz=0.1, end_Hz=5.0, duration_s=8.0),
    "sweep velocity": signals.Sweep(amplitude=0.05, start_Hz=0.1, end_Hz=5.0, duration_s=8.0, hold="velocity"),
    "log sweep": signals.Sweep(amplitude=0.05, start_Hz=0.1, end_Hz=5.0, duration_s=8.0, law="log"),
    "falling log sweep": signals.Sweep(
        amplitude=0.001, start_Hz=5.0, end_Hz=0.5, duration_s=8.0, law="log", hold="acceleration"
    ),
    "strokes": signals.ConstantVelocityStrokes(velocities=(0.05, 0.02), stroke=0.06),
    "soft block": signals.Block(amplitude=0.05, frequency_Hz=0.5, transition_s=0.37),
}
CORNERED = {  # and those with jumps in the derivatives, looked at between the jumps
    "block": signals.Block(amplitude=0.05, frequency_Hz=0.5),
    "triangle": signals.Triangle(amplitude=-0.05, frequency_Hz=0.5),
    "reversals": signals.ConstantAccelerationReversals(accelerations=(0.1, 0.02), cycles=2),
}
TIMES = np.linspace(0.0131, 9.9817, 499)
TIMES = TIMES[np.abs(TIMES - np.round(TIMES, 1)) > 1e-3]  # the corners of the signals above are at multiples of 0.1 s


def differences_agree(signal, times, rel=1e-6):
    """Central differences of 1e-5 s: their error is (w dt)^2 / 6 of the derivative, 2e-8 at 5 Hz."""
    step = 1e-5
    velocity = (signal.value(times + step) - signal.value(times - step)) / (2.0 * step)
    acceleration = (signal.velocity(times + step) - signal.velocity(times - step)) / (2.0 * step)
    for exact, numeric in ((signal.velocity(times), velocity), (signal.acceleration(times), acceleration)):
        assert exact == pytest.approx(numeric, abs=rel * max(np.max(np.abs(exact)), 1e-3))


@pytest.mark.parametrize("fade", [None, "linear", "smooth"])
@pytest.mark.parametrize("name", [*SMOOTH, *CORNERED])
def test_velocity_and_acceleration_are_exact_derivatives(name, fade):
    """Each signal, bare and faded in over 3 s either way, against central differences."""
    signal = (SMOOTH | CORNERED)[name]
    differences_agree(signal if fade is None else signals.faded(signal, 3.0, fade), TIMES)


@pytest.mark.parametrize("name", [*SMOOTH, *CORNERED])
def test_signals_are_pure_functions_of_time_of_any_shape(name):
    """A single time, a list and a matrix of times give the same numbers, in the shape asked."""
    signal = (SMOOTH | CORNERED)[name]
    for function in (signal.value, signal.velocity, signal.acceleration):
        block = function(TIMES[:6].reshape(2, 3))
        assert block.shape == (2, 3)
        assert np.array_equal(block.ravel(), function(list(TIMES[:6])))
        assert float(function(TIMES[4])) == block[1, 1]


@pytest.mark.parametrize("name", [name for name, signal in (SMOOTH | CORNERED).items() if signal.period_s])
def test_signals_repeat_after_their_period(name):
    """value(t + period) = value(t), and not after half of it; 1e-12: rounding of the time."""
    signal = (SMOOTH | CORNERED)[name]
    assert signal.value(TIMES + signal.period_s) == pytest.approx(signal.value(TIMES), abs=1e-12)
    assert np.max(np.abs(signal.value(TIMES + 0.5 * signal.period_s) - signal.value(TIMES))) > 1e-3


def test_only_a_single_sine_has_a_fundamental():
    """`fundamental_Hz` says that the fundamental is the whole command; a fade does not change it."""
    assert signals.faded(signals.Sine(amplitude=0.05, frequency_Hz=0.5), 2.0).fundamental_Hz == 0.5
    assert signals.Multisine(amplitudes=(0.1,), frequencies_Hz=(0.7,)).fundamental_Hz == 0.7
    others = [signal for name, signal in (SMOOTH | CORNERED).items() if name != "sine"]
    assert [signal.fundamental_Hz for signal in others] == [None] * len(others)


def test_sine_at_its_characteristic_points():
    """0, top, 0, bottom at quarters of the period; largest speed A w at 0, largest acceleration -A w^2 at the top."""
    sine, w = signals.Sine(amplitude=0.05, frequency_Hz=0.5), np.pi
    assert sine.value([0.0, 0.5, 1.0, 1.5]) == pytest.approx([0.0, 0.05, 0.0, -0.05], abs=1e-16)
    assert sine.velocity([0.0, 0.5, 1.0]) == pytest.approx([0.05 * w, 0.0, -0.05 * w], abs=1e-16)
    assert sine.acceleration([0.0, 0.5, 1.5]) == pytest.approx([0.0, -0.05 * w**2, 0.05 * w**2], abs=1e-16)


def test_block_and_triangle_at_their_corners():
    """Block: +A, then -A from half a period; triangle: 0, A, 0, -A at quarters, speed 4 A f of either sign."""
    block, triangle = (
        signals.Block(amplitude=0.03, frequency_Hz=0.25),
        signals.Triangle(amplitude=0.03, frequency_Hz=0.25),
    )
    assert block.value([0.0, 1.999, 2.0, 3.999, 4.0]) == pytest.approx([0.03, 0.03, -0.03, -0.03, 0.03])
    assert triangle.value([0.0, 1.0, 2.0, 3.0, 4.0]) == pytest.approx([0.0, 0.03, 0.0, -0.03, 0.0], abs=1e-16)
    assert triangle.velocity([0.5, 1.5, 2.5, 3.5]) == pytest.approx([0.03, -0.03, -0.03, 0.03])


def test_multisine_holds_the_amplitudes_asked_for():
    """Fourier amplitudes over one period (10 s) are those given; same seed, same signal; another seed, another."""
    multisine = SMOOTH["multisine"]
    assert multisine.period_s == pytest.approx(10.0)
    time = np.arange(0.0, 10.0, 0.01)
    spectrum = 2.0 / len(time) * np.abs(np.fft.rfft(multisine.value(time)))
    assert spectrum[[3, 7, 21]] == pytest.approx([0.01, 0.02, 0.005], abs=1e-12)
    assert np.delete(spectrum, [3, 7, 21]).max() < 1e-12
    assert np.array_equal(dataclasses.replace(multisine).value(time), multisine.value(time))
    assert not np.allclose(dataclasses.replace(multisine, seed=5).value(time), multisine.value(time))


def test_multisine_of_incommensurate_frequencies_has_no_period():
    """1 and sqrt 2 Hz never repeat together."""
    assert signals.Multisine(amplitudes=(0.1, 0.1), frequencies_Hz=(1.0, np.sqrt(2.0))).period_s is None


@pytest.mark.parametrize(("law", "middle"), [("linear", 2.55), ("log", np.sqrt(0.1 * 5.0))])
def test_sweep_passes_its_frequencies(law, middle):
    """Start, end and the middle (arithmetic or geometric mean), from the phase between upward zero crossings."""
    sweep = signals.Sweep(amplitude=1.0, start_Hz=0.1, end_Hz=5.0, duration_s=200.0, law=law)
    for time, frequency in ((0.0, 0.1), (100.0, middle), (200.0, 5.0), (250.0, 5.0)):
        turns = sweep._frequency(np.array([time - 1e-3, time + 1e-3]))[0]
        assert np.diff(turns)[0] / 2e-3 == pytest.approx(frequency, rel=1e-3)


@pytest.mark.parametrize(("hold", "order"), [("position", 0), ("velocity", 1), ("acceleration", 2)])
def test_sweep_holds_what_it_says(hold, order):
    """The crests of position, velocity or acceleration are equal early and late in a slow sweep (2 %: its rate)."""
    sweep = signals.Sweep(amplitude=0.05, start_Hz=0.5, end_Hz=2.0, duration_s=400.0, law="log", hold=hold)
    function = (sweep.value, sweep.velocity, sweep.acceleration)[order]
    early, late = np.linspace(0.0, 10.0, 20_001), np.linspace(390.0, 400.0, 20_001)
    assert np.max(function(early)) == pytest.approx(0.05 * np.pi**order, rel=0.02)
    assert np.max(function(late)) == pytest.approx(np.max(function(early)), rel=0.02)


def test_reversals_are_parabolas():
    """Within 1 s of each clean reversal: acceleration constant, velocity from +a through 0 to -a, both signs."""
    signal = signals.ConstantAccelerationReversals()
    times, accelerations = signal.reversals()
    assert set(np.abs(accelerations)) == {0.1, 0.05, 0.02, 0.01, 0.005}
    assert (accelerations > 0.0).any()
    assert (accelerations < 0.0).any()
    for time, a in zip(times, accelerations, strict=True):
        near = time + np.linspace(-0.999, 0.999, 51)
        assert signal.acceleration(near) == pytest.approx(np.full(51, a), abs=1e-12)
        assert signal.velocity(near) == pytest.approx(a * (near - time), abs=1e-13)
        assert signal.value(time) == pytest.approx(-0.5 * a, abs=1e-14)  # amplitude a T^2 / 2


def test_reversals_are_continuous_and_start_and_end_at_rest():
    """Position and velocity do not jump anywhere, over the joints of pieces and of periods; it starts at 0, at rest."""
    signal = signals.ConstantAccelerationReversals()
    joints = signal.path.ends_s
    for function in (signal.value, signal.velocity):
        assert function(joints - 1e-9) == pytest.approx(function(joints + 1e-9), abs=1e-8)
    assert (signal.value(0.0), signal.velocity(0.0), signal.acceleration(0.0)) == (0.0, 0.0, 0.0)


def test_strokes_run_at_constant_velocity():
    """Each stroke holds its velocity up and down, at every level; slow ones are cut at `longest_s`."""
    signal = signals.ConstantVelocityStrokes(velocities=(0.002, 0.05), stroke=0.1, cycles=2, longest_s=10.0)
    starts, ends, velocities = signal.strokes()
    assert velocities == pytest.approx([0.002, -0.002, 0.002, -0.002, 0.05, -0.05, 0.05, -0.05])
    assert ends - starts == pytest.approx([10.0] * 4 + [2.0] * 4)
    for start, end, velocity in zip(starts, ends, velocities, strict=True):
        near = np.linspace(start + 1e-6, end - 1e-6, 21)
        assert signal.velocity(near) == pytest.approx(np.full(21, velocity), abs=1e-14)
        assert signal.value(end - 1e-12) + signal.value(start) == pytest.approx(0.0, abs=1e-12)  # about 0


def test_strokes_turn_round_smoothly():
    """Velocity and acceleration do not jump; the turn-around swings out by 0.3125 v T (integral of the velocity)."""
    signal = signals.ConstantVelocityStrokes(velocities=(0.05,), stroke=0.1, turn_around_s=0.2)
    joints = signal.path.ends_s
    for function in (signal.value, signal.velocity, signal.acceleration):
        assert function(joints - 1e-9) == pytest.approx(function(joints + 1e-9), abs=1e-6)
    turn = np.linspace(signal.strokes()[1][0], signal.strokes()[0][1], 2001)
    assert signal.value(turn).max() == pytest.approx(0.05 + 0.3125 * 0.05 * 0.2, abs=1e-12)


def test_linear_fade_is_that_of_the_report():
    """min(t / T, 1) times the sine (report 3.3): half the sine at half the fade, all of it afterwards, 0 before 0."""
    sine = signals.Sine(amplitude=0.05, frequency_Hz=0.5)
    signal = signals.faded(sine, 2.0)
    assert signal.value([-0.5, 0.0, 1.5, 2.5]) == pytest.approx([0.0, 0.0, 0.75 * sine.value(1.5), sine.value(2.5)])
    assert signal.velocity(0.0) == 0.0
    assert signal.acceleration(0.0) == pytest.approx(2.0 * 0.05 * np.pi / 2.0)  # 2 A w / T: what the fade costs


def test_smooth_fade_starts_and_ends_without_a_jump():
    """Velocity and acceleration are 0 at the start and meet the signal's at the end; half of it in the middle."""
    sine = signals.Sine(amplitude=0.05, frequency_Hz=0.3, phase_rad=1.0)
    signal = signals.faded(sine, 2.0, "smooth")
    for faded_in, bare in ((signal.velocity, sine.velocity), (signal.acceleration, sine.acceleration)):
        assert faded_in([0.0, 1e-7]) == pytest.approx([0.0, 0.0], abs=1e-6)
        assert faded_in([2.0 - 1e-7, 2.0 + 1e-7]) == pytest.approx(bare([2.0, 2.0]), abs=1e-6)
    assert signal.value(1.0) == pytest.approx(0.5 * sine.value(1.0))


def test_no_fade_is_the_signal_itself():
    """A fade of 0 s changes nothing."""
    sine = signals.Sine(amplitude=0.05, frequency_Hz=0.5)
    assert signals.faded(sine, 0.0) is sine


def test_evaluate_stacks_six_coordinates():
    """Values, velocities, accelerations of several signals side by side, (n, n_signals)."""
    sine = signals.Sine(amplitude=0.05, frequency_Hz=0.5)
    value, velocity, acceleration = signals.evaluate([signals.Constant(), sine], TIMES)
    assert np.array_equal(value[:, 1], sine.value(TIMES))
    assert np.array_equal(velocity[:, 1], sine.velocity(TIMES))
    assert np.array_equal(acceleration[:, 1], sine.acceleration(TIMES))
    assert not np.any(value[:, 0])


# ---- from data and back ----------------------------------------------------------------------------------------------


def of_data(data):
    """The signal of a scenario's axis with this data."""
    tables = {"name": "one", "mode": "dof", "duration_s": 1.0, "axes": {"z": data}}
    return scenario_from_dict(tables, "heave").signals["z"]


@pytest.mark.parametrize("fade", [None, "linear", "smooth"])
@pytest.mark.parametrize("name", [*SMOOTH, *CORNERED])
def test_signal_to_data_and_back(name, fade):
    """Its data in a scenario make the same signal, for every kind and fade."""
    signal = (SMOOTH | CORNERED)[name]
    signal = signal if fade is None else signals.faded(signal, 3.0, fade)
    assert of_data(signals.signal_to_dict(signal)) == signal


def test_every_kind_is_among_the_round_trips():
    """No kind is left out of the tests above (a file needs a file, see below; an FMU is in tests/export/test_payload.py)."""
    assert {signal.kind for signal in (SMOOTH | CORNERED).values()} | {"file", "fmu"} == set(signals.SIGNAL_KINDS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            {"kind": "sinus"},
            r"heave: \[axes\.z\] kind = 'sinus': allowed are constant, sine, block, triangle, .* file$",
        ),
        ({"kind": ["sine"]}, r"heave: \[axes\.z\] kind = \['sine'\]: allowed are constant, sine"),
        ({"amplitude": 0.1}, r"heave: \[axes\.z\] kind = None: allowed are"),
        (3, r"heave: \[axes\] z = 3: must be a table"),
        (
            {"kind": "sine", "amplitude": 0.1, "frequency_Hz": 1.0, "frequency": 1.0},
            r"heave: \[axes\.z\] frequency is not a known key: did you mean frequency_Hz\? allowed are kind, amplitude, frequency_Hz",
        ),
        ({"kind": "sine", "amplitude": 0.1}, r"heave: \[axes\.z\] frequency_Hz is missing: add it"),
        (
            {"kind": "sine", "amplitude": "big", "frequency_Hz": 1},
            r"heave: \[axes\.z\] amplitude = 'big': a number is needed, without quotes",
        ),
        (
            {"kind": "sine", "amplitude": True, "frequency_Hz": 1},
            r"heave: \[axes\.z\] amplitude = True: .*valid number",
        ),
        (
            {"kind": "sine", "amplitude": float("nan"), "frequency_Hz": 1},
            r"heave: \[axes\.z\] amplitude = nan: .*finite number",
        ),
        ({"kind": "sine", "amplitude": 0.1, "frequency_Hz": -1}, r"frequency_Hz = -1: .*1e-06 to 1000 is possible"),
        ({"kind": "block", "amplitude": 0.1, "frequency_Hz": 0}, r"frequency_Hz = 0: .*1e-06 to 1000 is possible"),
        ({"kind": "multisine", "amplitudes": [1, 2], "frequencies_Hz": [1]}, r"amplitudes = .*: give 1, one for each"),
        ({"kind": "multisine", "amplitudes": [], "frequencies_Hz": []}, r"amplitudes = \[\]: .*at least 1 item"),
        ({"kind": "multisine", "amplitudes": 1, "frequencies_Hz": [1]}, r"amplitudes = 1: must be a list"),
        (
            {"kind": "multisine", "amplitudes": [1], "frequencies_Hz": [1], "seed": 1.5},
            r"seed = 1.5: .*valid integer",
        ),
        (
            {"kind": "sweep", "amplitude": 1, "start_Hz": 1, "end_Hz": 2, "duration_s": 3, "law": "quadratic"},
            r"law = 'quadratic': .*'linear' or 'log'",
        ),
        (
            {"kind": "constant_acceleration_reversals", "accelerations": [0.1, -0.1]},
            r"accelerations = -0.1: .* greater than",
        ),
        ({"kind": "constant_velocity_strokes", "cycles": 0}, r"cycles = 0: .*greater than or equal to 1"),
        ({"kind": "constant_velocity_strokes", "cycles": 1e308}, r"cycles = 1e\+308: .*valid integer"),
        ({"kind": "constant_velocity_strokes", "cycles": 10**9}, r"cycles = 1000000000: .*1 to 1000 is possible"),
        ({"kind": "constant", "fade_in_s": -1}, r"heave: \[axes\.z\] fade_in_s = -1: .*greater than or equal to 0"),
        ({"kind": "constant", "fade_in_s": 1, "fade_shape": "slow"}, r"fade_shape = 'slow': .*'linear' or 'smooth'"),
    ],
)
def test_bad_data_is_refused_naming_key_and_what_is_allowed(data, message):
    """Each message says where, at which axis, which key, what was given and what is allowed."""
    with pytest.raises(HexsimError, match=message):
        of_data(data)


# ---- files -----------------------------------------------------------------------------------------------------------


def write(path, **columns):
    table = pl.DataFrame(columns)
    table.write_parquet(path) if path.suffix == ".parquet" else table.write_csv(path)
    return path


@pytest.mark.parametrize("name", ["motion.csv", "motion.parquet"])
def test_file_signal_passes_its_samples(tmp_path, name):
    """At the samples the file's own values, between them the sine they came from (error (w dt)^4 A), held outside."""
    time = np.arange(0.0, 4.0, 0.01)
    sine = signals.Sine(amplitude=0.05, frequency_Hz=0.5, phase_rad=0.5 * np.pi)  # ends at rest, as the spline does
    path = write(tmp_path / name, time_s=time, z_m=sine.value(time), valve_V=time)
    signal = of_data({"kind": "file", "path": str(path), "column": "z_m"})
    assert signal.value(time) == pytest.approx(sine.value(time), abs=1e-15)
    between = np.arange(0.505, 3.5, 0.01)
    assert signal.value(between) == pytest.approx(sine.value(between), abs=1e-8)
    assert signal.acceleration(between) == pytest.approx(sine.acceleration(between), abs=1e-3)
    assert signal.value([-1.0, 10.0]) == pytest.approx([0.05, sine.value(time[-1])])
    assert not np.any(signal.velocity([-1.0, 10.0]))
    differences_agree(signal, between + 0.001)
    assert of_data(signals.signal_to_dict(signal)) == signal


def test_file_signal_starts_and_ends_at_rest(tmp_path):
    """A ramp in a file: the spline leaves and meets the values held before and after it without a jump in velocity."""
    path = write(tmp_path / "ramp.csv", time_s=0.2 * np.arange(21), x_m=0.002 * np.arange(21))
    signal = signals.SampledSignal(path=str(path), column="x_m")
    assert signal.velocity([0.0, 4.0 - 1e-9]) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert signal.velocity(2.0) == pytest.approx(0.01, rel=1e-4)  # the ends die out by 0.27 a sample


def test_linear_interpolation_does_not_overshoot(tmp_path):
    """A step in a file stays within its two values with "linear", and overshoots with "cubic"."""
    path = write(tmp_path / "step.csv", time_s=[0.0, 1.0, 2.0, 3.0], x_m=[0.0, 0.0, 0.1, 0.1])
    fine = np.linspace(0.0, 3.0, 301)
    linear = signals.SampledSignal(path=str(path), column="x_m", interpolation="linear")
    cubic = signals.SampledSignal(path=str(path), column="x_m")
    assert (linear.value(fine).min(), linear.value(fine).max()) == (0.0, pytest.approx(0.1))
    assert linear.value(1.5) == pytest.approx(0.05)
    assert linear.velocity([0.5, 1.5]) == pytest.approx([0.0, 0.1])
    assert cubic.value(fine).max() > 0.101


def test_leg_setpoints_are_read(tmp_path):
    """Actuator mode: setpoint_1_m to setpoint_6_m, and the bench's setpoint_m; other columns are left aside."""
    legs = {f"setpoint_{leg}_m": [0.1, 0.1 + 0.01 * leg] for leg in range(1, 7)}
    columns = signals.read_setpoint_file(write(tmp_path / "legs.csv", time_s=[0, 1], **legs, position_1_m=[0.0, 0.0]))
    assert list(columns) == ["time_s", *legs]
    assert columns["setpoint_6_m"] == pytest.approx([0.1, 0.16])
    bench = signals.read_setpoint_file(write(tmp_path / "bench.csv", time_s=[0.0, 1.0], setpoint_m=[0.1, 0.2]))
    assert list(bench) == ["time_s", "setpoint_m"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,z_m\n0,0\n1,nan\n2,0\n", r"row 2, column z_m: nan is not a finite number"),
        ("time_s,z_m\n0,0\n1,\n2,0\n", r"row 2, column z_m: an empty cell is not a finite number"),
        ("time_s,z_m\n0,0\n1,0.1\n2,up\n", r"row 3, column z_m: up is not a finite number"),
        ("time_s,z_m\n0,0\n1,inf\n", r"row 2, column z_m: inf is not a finite number"),
        ("time_s,z_m\n0,0\nnan,1\n", r"row 2, column time_s: nan is not a finite number"),
        ("time_s,z_m\n0,0\n2,0\n1,0\n", r"row 3, column time_s: 1 s is earlier than the row before it \(2 s\)"),
        ("time_s,z_m\n0,0\n1,0\n1,0\n", r"row 3, column time_s: 1 s repeats the time stamp before it \(1 s\)"),
        ("t,z_m\n0,0\n1,0\n", r"no column time_s; it has t, z_m"),
        (
            "time_s,z\n0,0\n1,0\n",
            r"no setpoint column; give any of x_m, y_m, .* or setpoint_m \(bench\); it has time_s, z",
        ),
        ("time_s,setpoint_1_m,setpoint_3_m\n0,0,0\n1,0,0\n", r"no column setpoint_2_m; leg setpoints need all of"),
        ("time_s,z_m,setpoint_1_m\n0,0,0\n1,0,0\n", r"has both z_m and setpoint_1_m; give DOF setpoints or leg"),
        ("time_s,z_m\n0,0\n", r"1 rows; setpoints need at least two"),
        ("time_s,z_m\n", r"0 rows; setpoints need at least two"),
        ("", r"cannot be read as a table"),
    ],
)
def test_bad_files_are_refused_naming_row_and_column(tmp_path, text, message):
    """Rows count from 1 after the header."""
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(HexsimError, match=message):
        signals.read_setpoint_file(path)


def test_missing_and_foreign_files_are_refused(tmp_path):
    """No such file; a kind that is not read (nothing is unpickled); a Parquet file that is none; a column not there."""
    with pytest.raises(HexsimError, match=r"no such setpoint file; give a .csv"):
        signals.read_setpoint_file(tmp_path / "none.csv")
    (tmp_path / "motion.pkl").write_bytes(b"")
    with pytest.raises(HexsimError, match=r"unknown kind of file; give a .csv, .csv.gz or .parquet file"):
        signals.read_setpoint_file(tmp_path / "motion.pkl")
    (tmp_path / "motion.parquet").write_bytes(b"no parquet")
    with pytest.raises(HexsimError, match=r"motion.parquet: cannot be read as a table"):
        signals.read_setpoint_file(tmp_path / "motion.parquet")
    path = write(tmp_path / "motion.csv", time_s=[0.0, 1.0], z_m=[0.0, 0.1])
    with pytest.raises(HexsimError, match=r"heave: .*column = 'x_m': .*motion.csv has the setpoints z_m"):
        of_data({"kind": "file", "path": str(path), "column": "x_m"})
