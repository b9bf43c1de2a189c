"""Motion tests held to systems whose answers are known; then the machine itself, quickly."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import hexsim as hx
from hexsim import HexsimError, Scenario, qualification
from hexsim.mechanics import kinematics
from hexsim.qualification import measures
from hexsim.setpoints import signals

TAU = 0.03  # s, of the first-order system
RATE = 1000.0


def lagged(command, tau=TAU):
    """First-order lag of a sampled command, exact for commands that are straight between samples (first-order hold)."""
    b, a, _ = cont2discrete(([1.0], [tau, 1.0]), 1 / RATE, method="foh")
    return lfilter(np.squeeze(b), a, command)


class LinearRig:
    """Six axes, each the same first-order lag; legs likewise. All answers are known."""

    name, axes = "linear", kinematics.DOF_NAMES

    def __init__(self, tau=TAU):
        self.tau = tau

    def play(self, scenario: Scenario, seed: int = 0) -> qualification.Motion:
        time = np.arange(round(scenario.duration_s * RATE)) / RATE
        position, _, acceleration = scenario.evaluate(time)
        answer, felt = (np.column_stack([lagged(c, self.tau) for c in x.T]) for x in (position, acceleration))
        return qualification.Motion(
            time_s=time,
            commanded=dict(zip(kinematics.DOF_NAMES, position.T, strict=True)),
            response=dict(zip(kinematics.DOF_NAMES, answer.T, strict=True)),
            commanded_acceleration=dict(zip(kinematics.DOF_NAMES, acceleration.T, strict=True)),
            acceleration=dict(zip(kinematics.DOF_NAMES, felt.T, strict=True)),
            leg_setpoints=np.tile(position[:, 2:3], 6),
            leg_positions=np.tile(answer[:, 2:3], 6),
        )


@pytest.fixture(scope="module")
def linear():
    """The whole battery on the first-order lag."""
    return qualification.Battery(LinearRig(), qualification.QUICK).run()


def value(found, test, axis, figure):
    rows = [row for row in found.rows if (row.test, row.axis) == (test, axis) and row.figure.startswith(figure)]
    assert len(rows) == 1
    return rows[0].value


@pytest.mark.parametrize("axis", kinematics.DOF_NAMES)
def test_describing_function_of_a_lag(linear, axis) -> None:
    """Gain 1/sqrt(1 + (w tau)^2) and phase -atan(w tau) at every frequency, in every axis."""
    curve = linear.curves["describing_function"][axis]
    w = 2 * np.pi * np.array(curve["frequency_Hz"])
    assert curve["gain_dB"] == pytest.approx(-10 * np.log10(1 + (w * TAU) ** 2), abs=0.02)
    assert curve["phase_deg"] == pytest.approx(-np.degrees(np.arctan(w * TAU)), abs=0.15)


def test_the_corner_of_a_lag_is_found(linear) -> None:
    """-3 dB at 1/(2 pi tau) = 5.3 Hz, read between the points at 5 and 10 Hz: within 3 %. -90 deg is never reached."""
    assert value(linear, "describing function", "heave z", "gain") == pytest.approx(1 / (2 * np.pi * TAU), rel=0.03)
    assert value(linear, "describing function", "heave z", "phase") is None


def test_a_linear_system_has_no_noise_no_hysteresis_and_one_gain(linear) -> None:
    """Half-hertz noise, linearity, hysteresis, leg balance and repeatability of a linear system are zero."""
    for axis in ("surge x", "heave z", "yaw"):
        assert (
            value(linear, "half-hertz noise", axis, "noise ratio") < 2e-3
        )  # what is left of the fade-in, and of edges
        assert value(linear, "half-hertz noise", axis, "parasitic") == 0.0
    assert value(linear, "linearity", "heave z", "gain") < 1e-3  # per cent
    assert value(linear, "hysteresis", "heave z", "width") < 1e-3  # mm
    assert value(linear, "leg balance", "heave z", "largest") == pytest.approx(0.0, abs=1e-9)
    assert value(linear, "repeatability", "heave z", "largest") == 0.0
    assert value(linear, "turn-around", "heave z", "largest") < 5e-3


def test_dynamic_threshold_of_a_lag(linear) -> None:
    """63 % of a step of acceleration after tau, within 1 ms (50 Hz band, steps that last a second)."""
    assert value(linear, "dynamic threshold", "heave z", "63 %") == pytest.approx(1000 * TAU, abs=1.0)


def test_dynamic_threshold_of_a_delay() -> None:
    """A pure delay of 80 ms is found; the band adds its own 1.3 ms from half to 63 % of a step, 0.13/(2 * 50 Hz)."""
    signal = measures.AccelerationSteps(acceleration_m_s2=0.2, period=2.0)
    time = np.arange(8000) / RATE
    command = signal.acceleration(time)
    late = np.concatenate([np.full(80, command[0]), command[:-80]])
    assert measures.dynamic_threshold(time, command, late, 2.5) == pytest.approx(0.0813, abs=5e-4)
    with pytest.raises(HexsimError, match="does not reach 63 %"):
        measures.dynamic_threshold(time, command, 0.1 * command, 2.5)


def test_acceleration_steps_are_what_they_say() -> None:
    """Velocity is the derivative of value and acceleration that of velocity; arcs have the stated height and speed."""
    signal = measures.AccelerationSteps(acceleration_m_s2=0.2, period=2.0)
    t, h = np.linspace(0.013, 3.9, 977), 1e-6
    near_step = np.abs((t + 0.5) % 1.0 - 0.5) < 1e-5
    assert ((signal.value(t + h) - signal.value(t - h)) / (2 * h))[~near_step] == pytest.approx(
        signal.velocity(t)[~near_step], abs=1e-8
    )
    assert ((signal.velocity(t + h) - signal.velocity(t - h)) / (2 * h))[~near_step] == pytest.approx(
        signal.acceleration(t)[~near_step], abs=1e-6
    )
    assert signal.value(0.5) == pytest.approx(0.2 / 8) and signal.velocity(0.0) == pytest.approx(0.1)
    assert signal.velocity(1.0 - 1e-12) == pytest.approx(signal.velocity(1.0), abs=1e-9)  # only the acceleration jumps


def test_hysteresis_of_a_backlash_behind_a_lag() -> None:
    """A play of 0.4 mm full width, seen through a lag: 0.4 mm, though the loops themselves are 1 mm and wider."""
    widths = []
    for speed in (0.01, 0.02):
        signal = signals.Triangle(amplitude=0.01, frequency_Hz=speed / 0.04)
        time = np.arange(int(10 / signal.frequency_Hz / 4 * RATE)) / RATE
        command = signal.value(time)
        held, play = 0.0, np.empty_like(command)
        for k, c in enumerate(command):
            held = min(max(held, c - 2e-4), c + 2e-4)
            play[k] = held
        widths.append(measures.loop_width(time, command, lagged(play), 0.6 / signal.frequency_Hz))
        assert widths[-1] == pytest.approx(-2 * speed * TAU - 4e-4, rel=0.01)
    assert measures.hysteresis(*widths) == pytest.approx(4e-4, rel=0.02)


def test_linearity_of_a_dead_band() -> None:
    """A gain that falls from 1 to 0.9 is 11 % off the last; the last is the reference."""
    assert measures.linearity([0.9, 0.95, 1.0]) == pytest.approx(0.1)
    assert measures.linearity([1.0, 0.9]) == pytest.approx(1 / 0.9 - 1)


def test_leg_balance_finds_the_late_leg() -> None:
    """One of six legs later by 10 ms at 0.5 Hz is 1.8 deg behind: over the limit of 1.5."""
    time = np.arange(8000) / RATE
    setpoints = np.tile(0.05 * np.sin(np.pi * time)[:, None], 6)
    positions = setpoints.copy()
    positions[:, 3] = 0.05 * np.sin(np.pi * (time - 0.01))
    spread, phases = measures.leg_balance(time, setpoints, positions, 0.5, 2.0)
    assert spread == pytest.approx(1.8, abs=1e-3)
    assert np.argmin(phases) == 3


def test_noise_of_known_size_is_found() -> None:
    """A third harmonic of 5 % of the basic one: low harmonics 0.05, high ones 0; a 7th of 2 %: high harmonics 0.02."""

    class Harmonics(LinearRig):
        def play(self, scenario, seed=0):
            motion = super().play(scenario, seed)
            (axis,) = scenario.signals
            signal = scenario.signals[axis]
            if isinstance(signal, signals.Sine) and signal.frequency_Hz == 0.5:
                t, a = motion.time_s, signal.amplitude * np.pi**2
                motion.acceleration[axis] = a * (
                    np.sin(np.pi * t) + 0.05 * np.sin(3 * np.pi * t) + 0.02 * np.cos(7 * np.pi * t)
                )
            return motion

    battery = qualification.Battery(Harmonics(), qualification.QUICK)
    battery._axis("x")
    assert value(battery.found, "half-hertz noise", "surge x", "low harmonics") == pytest.approx(0.05, rel=0.01)
    assert value(battery.found, "half-hertz noise", "surge x", "high harmonics") == pytest.approx(0.02, rel=0.01)


def test_a_row_is_judged_only_where_there_is_a_limit() -> None:
    """Within, beyond, and reported: True, False, None."""
    row = dict(test="t", axis="z", figure="f", unit="m")
    assert qualification.Row(**row, value=1.0, limit=2.0).passed is True
    assert qualification.Row(**row, value=-3.0, limit=2.0).passed is False
    assert qualification.Row(**row, value=3.0).passed is None
    assert qualification.Row(**row, value=None, limit=2.0).passed is None


def test_progress_ends_where_it_should() -> None:
    """The fractions rise, stay below 1, and every test is announced."""
    heard: list[tuple[float, str]] = []
    qualification.Battery(LinearRig(), qualification.QUICK, lambda fraction, what: heard.append((fraction, what))).run()
    fractions = [fraction for fraction, _ in heard]
    assert fractions == sorted(fractions) and 0.9 < fractions[-1] < 1.0
    assert len({what for _, what in heard}) == len(heard)


def test_the_bench_is_qualified_and_reported(monkeypatch, tmp_path) -> None:
    """A bench, quickly: rows and pictures; report and JSON are there, agree, and every limit names its source."""
    heard: list[float] = []
    done = hx.qualify("bench", quick=True, progress=heard.append)
    assert done.rows["test"].n_unique() > 3 and done.passed == done.rows["passed"].drop_nulls().all()
    assert done.plot()._repr_png_().startswith(b"\x89PNG") and repr(done) in str(hx.qualify.__doc__)
    assert "<th>limit</th>" in done._repr_html_()
    monkeypatch.chdir(tmp_path)
    assert done.to_folder().parent == Path("runs")
    folder = done.to_folder(tmp_path / "q")
    assert {path.name for path in folder.iterdir()} == {"qualify.json", "report.html"}
    read = json.loads((folder / "qualify.json").read_text())
    assert read == json.loads(json.dumps(done.result))
    page = (folder / "report.html").read_text()
    assert "Qualification of bench" in page and page.count("data:image/png") >= 5
    judged = [row for row in read["rows"] if row["limit"] is not None]
    assert judged and all(row["source"].startswith(("[S]", "[K]")) for row in judged)
    assert read["passed"] == all(row["passed"] is not False for row in read["rows"])
    assert heard == sorted(heard) and heard[-1] == 1.0
    bandwidth = next(row["value"] for row in read["rows"] if row["figure"].startswith("gain falls"))
    width = next(row["value"] for row in read["rows"] if row["test"] == "hysteresis")
    assert width == pytest.approx(1.8, rel=0.2)  # mm: dead band of 2 * 45 mV over Kp = 50 V/m, and a little friction
    assert 0.7 < bandwidth < 1.6  # Kp Kv/(2 pi) = 50 * 0.13..0.17 / (2 pi) = 1.0..1.35 Hz, less for the dead band


def test_the_full_plan_covers_the_whole_range() -> None:
    """0.1 to 10 Hz, and half a hertz among them; the quick one begins at half a hertz."""
    for plan, low in ((qualification.Plan(), 0.1), (qualification.QUICK, 0.5)):
        assert plan.frequencies_Hz[0] == low and plan.frequencies_Hz[-1] == 10.0 and 0.5 in plan.frequencies_Hz
        assert math.isclose(plan.linearity_m[-1], plan.half_hertz_m)
