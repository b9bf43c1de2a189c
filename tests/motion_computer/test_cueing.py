"""Motion cueing: the washout has the properties of a washout, and the machine plays it."""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim.cueing import washout
from hexsim.machine import geometry, load_machine

PATH = Path(__file__).parents[2] / "examples" / "motion_cueing.py"
RATE_Hz = 500.0
TIME = np.arange(0.0, 40.0, 1.0 / RATE_Hz)


def test_position_returns_to_the_middle() -> None:
    """A lasting acceleration moves the platform and then lets it come back: the high-pass has no steady part."""
    position = washout.poses(washout.Washout(scale=1.0), np.ones((len(TIME), 3)))[:, 0]
    assert np.abs(position).max() > 0.05
    assert abs(position[-1]) < 1e-4


def test_a_quick_acceleration_passes_at_once() -> None:
    """Right after a step of 1 m/s2 the platform's acceleration is 1 m/s2: to 2 % a tenth of a tick over w."""
    position = washout.poses(washout.Washout(scale=1.0), np.ones((len(TIME), 3)))[:, 0]
    step = TIME[1]
    begin = (position[3] - 2 * position[2] + position[1]) / step**2
    assert begin == pytest.approx(1.0, abs=0.03)  # 3 ticks of 2 ms times 2 w + w_b = 5.3 rad/s


def test_a_lasting_acceleration_is_felt_as_tilt() -> None:
    """0.6 m/s2 forward for long: the platform stands nose up so that gravity gives 0.6 m/s2, and got there no faster
    than 3 deg/s."""
    acceleration = np.zeros((len(TIME), 3))
    acceleration[:, 0] = 2.0
    pose = washout.poses(washout.Washout(), acceleration)
    kinematics = geometry.machine_kinematics(load_machine("micro_motion_system"))
    felt = washout.specific_force(kinematics.rotation(pose[-1:]), np.zeros((1, 3)))[0]
    assert felt[0] == pytest.approx(0.6, rel=0.01)
    assert pose[-1, 4] < 0.0
    assert np.abs(np.diff(pose[:, 3:5], axis=0)).max() * RATE_Hz <= np.radians(3.0) * 1.001


def test_leaning_begins_and_ends_without_a_step_of_angular_acceleration() -> None:
    """A lasting acceleration through the rate limit: from tick to tick the pitch acceleration changes by less than a tenth of
    its largest value, for two lags of 25 ms pass 2 ms / 25 ms = 8 % a tick; a single lag passes a kink of rate whole."""
    acceleration = np.zeros((len(TIME), 3))
    acceleration[2500:, 0] = 2.0
    angular = np.diff(washout.poses(washout.Washout(), acceleration)[:, 4], 2) * RATE_Hz**2
    assert np.abs(np.diff(angular)).max() < 0.1 * np.abs(angular).max()


def test_acceleration_to_the_left_is_felt_to_the_left() -> None:
    """The same for a lasting acceleration to the left: roll gives it its sign."""
    acceleration = np.zeros((len(TIME), 3))
    acceleration[:, 1] = 2.0
    pose = washout.poses(washout.Washout(), acceleration)
    kinematics = geometry.machine_kinematics(load_machine("micro_motion_system"))
    felt = washout.specific_force(kinematics.rotation(pose[-1:]), np.zeros((1, 3)))[0]
    assert felt[1] == pytest.approx(0.6, rel=0.01)


@pytest.mark.slow  # the washout that it runs is above
def test_the_example_runs_end_to_end(tmp_path, monkeypatch, capsys) -> None:
    """Manoeuvre, washout, machine, comparison: what is felt forward follows what was commanded, later by the loop's lag
    1/(Kp Kv) = 0.13 s and some more for the dead band."""
    monkeypatch.setattr(sys, "argv", ["motion_cueing.py", "--fast", "--out", str(tmp_path)])
    runpy.run_path(str(PATH), run_name="__main__")
    table = json.loads((tmp_path / "cueing.json").read_text())
    assert table["x"]["correlation"] > 0.9
    assert 80 < table["x"]["delay_ms"] < 300
    assert (tmp_path / "cueing.png").stat().st_size > 20_000
    assert (tmp_path / "felt.csv").exists() and "correlation" in capsys.readouterr().out


def test_a_flight_is_a_table_for_the_example(tmp_path, monkeypatch) -> None:
    """JSBSim's C172, by its signs: nose up (negative pitch rate, axes forward left up) and pressed into the seat first, a roll to
    the left (negative) at 9 s and back at 16 s, less push with the throttle at idle. The example
    plays the first five seconds of it: what is felt up follows what was commanded."""
    pytest.importorskip("jsbsim", reason="flies the aircraft; pip install jsbsim")
    monkeypatch.setattr(sys, "argv", ["flight_manoeuvre.py", "--out", str(tmp_path / "flight.csv")])
    runpy.run_path(str(PATH.with_name("flight_manoeuvre.py")), run_name="__main__")
    flight = pl.read_csv(tmp_path / "flight.csv")
    mean = lambda name, start, end: flight.filter(pl.col("time_s").is_between(start, end))[name].mean()  # noqa: E731
    assert abs(mean("up_m_s2", 0.0, 3.0)) < 0.1
    assert mean("pitch_rad_s", 3.0, 4.0) < -0.03 and mean("up_m_s2", 3.2, 4.2) > 1.5
    assert mean("up_m_s2", 4.4, 5.0) < -1.5
    assert mean("roll_rad_s", 9.0, 10.5) < -0.1 and mean("roll_rad_s", 16.0, 17.5) > 0.1
    assert mean("forward_m_s2", 30.0, 32.0) < -0.7
    flight.filter(pl.col("time_s") < 6.0).write_csv(tmp_path / "short.csv")
    monkeypatch.setattr(
        sys, "argv", ["motion_cueing.py", "--fast", "--vehicle", str(tmp_path / "short.csv"), "--out", str(tmp_path)]
    )
    runpy.run_path(str(PATH), run_name="__main__")
    assert json.loads((tmp_path / "cueing.json").read_text())["z"]["correlation"] > 0.7
