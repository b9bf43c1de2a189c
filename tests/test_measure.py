"""Figures from a log: those of `qualify` on the same motion, and the accelerometers' place, axes, gravity and band."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from hexsim import Scenario, load_scenario, qualification
from hexsim.cli import app
from hexsim.qualification import measured
from hexsim.setpoints import signals
from hexsim.signals.log import Log
from hexsim.simulation import simulate

PLAN = qualification.Plan(periods=3)


class Recording:
    """A rig that keeps the log of what it plays beside the motion that `qualify` judges."""

    def __init__(self, machine) -> None:
        self.rig, self.machine = qualification.MachineRig(machine), machine
        self.name, self.axes = machine.name, self.rig.axes

    def play(self, scenario: Scenario, seed: int = 0):
        self.log = simulate(self.machine, scenario, fast=True, seed=seed).log
        return self.rig.play(scenario, seed)


@pytest.fixture(scope="module")
def played(hexapod):
    """The half-hertz heave of the battery: its rows and its log."""
    rig = Recording(hexapod)
    battery = qualification.Battery(rig, PLAN)
    motion, start = battery._sine("half-hertz z", "z", PLAN.half_hertz_m, 0.5)
    battery._half_hertz("z", motion, start)
    log = Log.of_table("heave", rig.log, "hexapod")
    battery._heave, battery._heave_start = motion, start
    battery._repeatability()
    return battery.found.rows, log


def value(rows, test: str, figure: str) -> float:
    rows = [row if isinstance(row, dict) else vars(row) for row in rows]
    return next(row["value"] for row in rows if row["test"] == test and row["figure"].startswith(figure))


FIGURES = (
    ("half-hertz noise", "noise ratio"),
    ("half-hertz noise", "low harmonics"),
    ("half-hertz noise", "high harmonics"),
    ("half-hertz noise", "peak"),
    ("half-hertz noise", "parasitic"),
    ("leg balance", "largest"),
)


def test_figures_of_a_simulated_log_are_those_of_qualify(hexapod, played, tmp_path):
    """Half-hertz noise, peak, parasitic motion and leg balance of the same heave, to 1e-6."""
    rows, log = played
    result = qualification.measure(log, hexapod, tmp_path)
    for test, figure in FIGURES:
        assert value(result["rows"], test, figure) == pytest.approx(value(rows, test, figure), rel=1e-6), figure
    assert (tmp_path / "report.html").stat().st_size > 50_000
    assert json.loads((tmp_path / "measure.json").read_text())["rows"] == result["rows"]


@pytest.mark.usefixtures("undrawn")
def test_by_its_sensors_a_log_says_the_same_within_their_noise(hexapod, played, tmp_path):
    """Noise of 0.02 m/s2 in the accelerometer: the peak in the band is at most 0.1 m/s2 off, the phase 0.3 deg."""
    _, log = played
    true, sensed = (
        qualification.measure(log, hexapod, tmp_path / "a"),
        qualification.measure(log, hexapod, tmp_path / "b", qualification.Imu()),
    )
    peaks = [value(found["rows"], "half-hertz noise", "peak") for found in (true, sensed)]
    phases = [value(found["rows"], "describing function", "phase") for found in (true, sensed)]
    assert peaks[1] == pytest.approx(peaks[0], abs=0.1)
    assert phases[1] == pytest.approx(phases[0], abs=0.3)


@pytest.mark.usefixtures("undrawn")
def test_a_narrow_sensor_is_said_and_its_band_used(hexapod, played, tmp_path):
    """A bandwidth of 20 Hz: the peak is lower, and the report says of which band it is."""
    _, log = played
    wide, narrow = (
        qualification.measure(log, hexapod, tmp_path / str(b), qualification.Imu(bandwidth_Hz=b)) for b in (50.0, 20.0)
    )
    assert value(narrow["rows"], "half-hertz noise", "peak, 20 Hz") < value(
        wide["rows"], "half-hertz noise", "peak, 50 Hz"
    )
    assert any("up to 20 Hz" in note for note in narrow["notes"])


def test_place_axes_and_gravity_of_accelerometers_drop_out(hexapod):
    """A platform that pitches and heaves: what a turned accelerometer with gravity reads 0.3 m off the origin, taken back
    to the origin, is the origin's acceleration (formula of a rigid body, independent of the function's).
    """
    mechanics, rate = hexapod.mechanics, 1000.0
    t = np.arange(6000) / rate
    pose, rates, accelerations = (np.zeros((len(t), 6)) for _ in range(3))
    for k, size, f in ((2, 0.05, 0.5), (4, 0.1, 1.0), (3, 0.05, 0.7)):
        w = 2 * np.pi * f
        pose[:, k], rates[:, k], accelerations[:, k] = (
            size * np.sin(w * t),
            size * w * np.cos(w * t),
            -size * w * w * np.sin(w * t),
        )
    twist, twist_rate = mechanics.twist(pose, rates), mechanics.twist_rate(pose, rates, accelerations)
    origin = mechanics.to_platform_frame(pose, twist_rate)
    offset, turn = np.array([0.1, -0.2, 0.3]), (10.0, -20.0, 30.0)
    rotation = mechanics.rotation(pose)
    arm = rotation @ offset
    at_sensor = twist_rate[:, :3] + np.cross(twist_rate[:, 3:], arm)
    at_sensor = at_sensor + np.cross(twist[:, 3:], np.cross(twist[:, 3:], arm)) + [0.0, 0.0, 9.81]
    in_platform = np.einsum("kji,kj->ki", rotation, at_sensor)
    read = Rotation.from_euler("xyz", turn, degrees=True).inv().apply(in_platform)
    imu = qualification.Imu(offset_m=tuple(offset), turn_deg=turn, has_gravity=True)
    found, _ = measured.at_origin(read.T, origin[:, 3:].T, pose, mechanics, rate, imu, 9.81)
    inner = slice(200, -200)
    assert np.abs(found.T - origin[:, :3])[inner].max() < 2e-3
    assert np.abs(read - origin[:, :3])[inner].max() > 5.0


def test_a_sine_is_found_with_its_frequency_and_start():
    """Faded in over 4 s at 0.4 Hz: the frequency to 1e-4, the start a period after the fade; noise and a sweep are none."""
    t = np.arange(20_000) / 1000
    fade = np.clip(t / 4, 0, 1)
    frequency, start = measured.sine_of(t, 0.05 * fade * np.sin(2 * np.pi * 0.4 * t)) or (0.0, 0.0)
    assert frequency == pytest.approx(0.4, rel=1e-4)
    assert 5.0 < start <= 9.0
    assert measured.sine_of(t, 0.05 * np.sin(2 * np.pi * (0.2 + 0.05 * t) * t)) is None
    assert measured.sine_of(t, 0.05 * np.sin(2 * np.pi * 0.05 * t)) is None


@pytest.mark.usefixtures("undrawn")
def test_another_motion_gives_its_frequency_response(bench, tmp_path):
    """A multisine on the bench: its gain at 0.5 Hz is that of a sine within 0.5 dB (the machine is not linear)."""
    scenario = Scenario(
        name="m", mode="actuator", signals={"leg_1": signals.Sine(amplitude=0.01, frequency_Hz=0.3)}, duration_s=3.0
    )

    run = simulate(bench, replace(load_scenario("multisine"), duration_s=30.0))
    result = qualification.measure(Log.of_table("multisine", run.log, "bench"), bench, tmp_path)
    assert any("no sine" in note for note in result["notes"])
    curve = result["describing_function"]["z"]
    gain_at = np.interp(0.5, curve["frequency_Hz"], curve["gain_dB"])
    sine = simulate(
        bench, replace(scenario, signals={"leg_1": signals.Sine(amplitude=0.03, frequency_Hz=0.5)}, duration_s=12.0)
    )
    wanted = qualification.measure(Log.of_table("sine", sine.log, "bench"), bench, tmp_path)["describing_function"]["z"]
    assert gain_at == pytest.approx(wanted["gain_dB"][0], abs=0.5)


def test_the_axis_that_moves_is_found(hexapod, played):
    """Heave alone, from the setpoints of the legs."""
    _, log = played
    motion, notes = measured.motion_of(log, hexapod.mechanics, None)
    assert measured.driven_axes(motion) == ["z"]
    assert notes == ["Accelerations are the simulation's true ones."]


def test_the_command_measures_a_run(bench, tmp_path):
    """`hexsim test log LOG`: a table and a report; numbers that are none are a sentence."""
    run = simulate(
        bench,
        Scenario(
            name="s",
            mode="actuator",
            signals={"leg_1": signals.Sine(amplitude=0.05, frequency_Hz=0.5)},
            duration_s=10.0,
        ),
    )
    run.log.write_parquet(tmp_path / "s.parquet")
    call = ["test", "log", str(tmp_path / "s.parquet"), "--machine", "bench", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*call, "--json"])
    assert done.exit_code == 0, done.output
    assert {row["test"] for row in json.loads(done.stdout)["rows"]} == {
        "half-hertz noise",
        "turn-around",
        "describing function",
    }
    assert (tmp_path / "out" / "report.html").is_file()
    bad = CliRunner().invoke(app, [*call, "--imu-offset", "1,2"])
    assert bad.exit_code == 2
    assert "--imu-offset '1,2': three numbers are needed" in bad.output


MOTIONS = {
    "heave": ({"z": (0.05, 0.5)}, {"half-hertz noise", "leg balance"}),
    "turn-around": ({"z": (0.075, 0.5)}, {"half-hertz noise", "leg balance", "turn-around"}),
    "sway": ({"y": (0.05, 0.5)}, {"half-hertz noise"}),
    "pitch": ({"pitch": (0.08, 0.5)}, set()),
    "fast heave": ({"z": (0.01, 2.0)}, set()),
    "combined": ({"x": (0.03, 0.5), "z": (0.03, 0.5), "roll": (0.08, 0.7), "pitch": (0.08, 0.3)}, set()),
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", MOTIONS)
def test_a_machine_that_follows_perfectly_does_not_fail(hexapod, tmp_path, name):
    """A made-up log whose legs and accelerations are exactly those asked for: nothing is exceeded, and each limit judges only
    the motion that its test is for."""
    axes, judged = MOTIONS[name]
    mechanics, time = hexapod.mechanics, np.arange(20_000) * 1e-3
    pose, rate, change = (np.zeros((len(time), 6)) for _ in range(3))
    for axis, (size, f) in axes.items():
        column, w = ("x", "y", "z", "roll", "pitch", "yaw").index(axis), 2 * np.pi * f
        pose[:, column] = size * np.sin(w * time)
        rate[:, column], change[:, column] = size * w * np.cos(w * time), -size * w**2 * np.sin(w * time)
    twist_rate = mechanics.to_platform_frame(pose, mechanics.twist_rate(pose, rate, change))
    legs = mechanics.piston_positions(pose)
    columns = {"time_s": time}
    for k in range(6):
        columns |= {f"setpoint_{k + 1}_m": legs[:, k], f"position_{k + 1}_m": legs[:, k]}
    for k, axis in enumerate("xyz"):
        columns |= {
            f"acceleration_{axis}_m_s2": twist_rate[:, k],
            f"angular_acceleration_{axis}_rad_s2": twist_rate[:, 3 + k],
        }
    result = qualification.measure(Log.of_table("perfect", pl.DataFrame(columns), "hexapod"), hexapod, tmp_path)
    assert {row["test"] for row in result["rows"] if row["passed"] is not None} == judged
    assert result["passed"] is (True if judged else None)


@pytest.mark.usefixtures("undrawn")
def test_strict_ends_with_one_where_a_limit_is_exceeded(hexapod, tmp_path):
    """`measure --strict` on the shipped machine without compensation: 1 and the tests that are exceeded; without it 0."""
    simulate(hexapod, load_scenario("heave", duration_s=8.0), fast=True).log.write_parquet(tmp_path / "log.parquet")
    arguments = ["test", "log", str(tmp_path / "log.parquet"), "-m", "micro_motion_system", "--out"]
    ended = CliRunner().invoke(app, [*arguments, str(tmp_path / "a"), "--strict"])
    passed = json.loads((tmp_path / "a" / "measure.json").read_text())["passed"]
    assert passed is False and ended.exit_code == 1 and "limits exceeded: half-hertz noise heave z" in ended.stderr
    assert CliRunner().invoke(app, [*arguments, str(tmp_path / "b")]).exit_code == 0
