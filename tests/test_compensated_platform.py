"""The adaptive algorithm on the whole platform, in a motion that never repeats."""

from __future__ import annotations

import numpy as np
import pytest

from hexsim import load_scenario, smoothness
from hexsim.machine import load_machine
from hexsim.simulation import simulate

pytestmark = (
    pytest.mark.slow
)  # in heave legs engage together and leave a third in motion_computer/test_legs_together.py
AXES = ("acceleration_x_m_s2", "acceleration_z_m_s2", "angular_acceleration_x_rad_s2", "angular_acceleration_z_rad_s2")


def roughness(run, axis: str) -> float:
    """Largest deviation from the commanded acceleration from 7 s on, in 50 Hz, less its mean over 0.1 s."""
    t = run.log["time_s"].to_numpy()
    a = smoothness.band_limit(t, run.log[f"true_{axis}"].to_numpy()) - run.log[f"commanded_{axis}"].to_numpy()
    a -= np.convolve(a, np.ones(101) / 101, "same")
    return float(np.abs(a[(t > 7.0) & (t < t[-1] - 0.2)]).max())


@pytest.fixture(scope="module")
def runs():
    """Plain control and the adaptive algorithm in six sines of six frequencies."""
    machine, scenario = load_machine("micro_motion_system"), load_scenario("combined", duration_s=11.0)
    plain, adaptive = (simulate(machine, scenario, compensator=name, fast=True) for name in ("none", "adaptive"))
    return plain, adaptive


@pytest.mark.parametrize("axis", AXES)
def test_irregular_motion_is_compensated(runs, axis: str) -> None:
    """Six sines of six frequencies, turns of some 0.05 m/s2: from 7 s on the worst bump is less than a third of plain
    control's in every axis."""
    plain, adaptive = runs
    assert roughness(plain, axis) > 0.1
    assert roughness(adaptive, axis) < roughness(plain, axis) / 3.0


def engaged_s(run) -> np.ndarray:
    """Since when each leg has added volts without a pause: the small motion by which it shows its valve before pauses at reversals."""
    volts = run.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    assert volts[-1].all()
    return run.log["time_s"].to_numpy()[len(volts) - (volts[::-1] == 0.0).argmax(axis=0)]


def test_legs_engage_together(runs) -> None:
    """All six within one second, and before 7 s, from when on the bumps above are compared: legs that begin apart tilt the platform."""
    at_s = engaged_s(runs[1])
    assert np.ptp(at_s) < 1.0 and at_s.max() < 7.0


def test_legs_that_hardly_move_hold_nobody_up() -> None:
    """Roll: legs 3 and 6 turn with a fifth of the others' acceleration, and yet all six have engaged before 7 s."""
    machine, scenario = load_machine("micro_motion_system"), load_scenario("roll", duration_s=7.5)
    assert engaged_s(simulate(machine, scenario, compensator="adaptive", fast=True)).max() < 7.0
