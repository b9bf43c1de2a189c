"""The adaptive algorithm on the whole platform, in a motion that never repeats."""

from __future__ import annotations

import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import Run, simulate
from hexsim.smoothness import band_limit

AXES = ("acceleration_x_m_s2", "acceleration_z_m_s2", "angular_acceleration_x_rad_s2", "angular_acceleration_z_rad_s2")


def roughness(run: Run, axis: str) -> float:
    """Largest deviation from the commanded acceleration from 7 s on, in 50 Hz, less its mean over 0.1 s."""
    t = run.log["time_s"].to_numpy()
    a = band_limit(t, run.log[f"true_{axis}"].to_numpy()) - run.log[f"commanded_{axis}"].to_numpy()
    a -= np.convolve(a, np.ones(101) / 101, "same")
    return float(np.abs(a[(t > 7.0) & (t < t[-1] - 0.2)]).max())


@pytest.fixture(scope="module")
def runs() -> tuple[Run, Run]:
    """Plain control and the adaptive algorithm in six sines of six frequencies."""
    machine, scenario = load_machine("micro_motion_system"), load_scenario("combined", duration_s=16.0)
    plain, adaptive = (simulate(machine, scenario, compensator=name, fast=True) for name in ("none", "adaptive"))
    return plain, adaptive


@pytest.mark.parametrize(("axis", "part"), [(axis, 3.0) for axis in AXES])
def test_irregular_motion_is_compensated(runs: tuple[Run, Run], axis: str, part: float) -> None:
    """Six sines of six frequencies, turns of some 0.05 m/s2: from 7 s on the worst bump is less than a third of plain
    control's in every axis."""
    plain, adaptive = runs
    assert roughness(plain, axis) > 0.1
    assert roughness(adaptive, axis) < roughness(plain, axis) / part


def test_legs_engage_together(runs: tuple[Run, Run]) -> None:
    """All six within one second, the last before 6 s: who is ready waits for who is not, and no longer. Each by itself they
    would begin between 3.3 and 4.8 s, and tilt the platform."""
    log = runs[1].log
    volts = log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    engaged_s = log["time_s"].to_numpy()[(volts != 0.0).argmax(axis=0)]
    assert volts.any(axis=0).all()
    assert engaged_s.max() - engaged_s.min() < 1.0
    assert engaged_s.max() < 6.0


def test_legs_that_hardly_move_hold_nobody_up() -> None:
    """Roll: legs 3 and 6 turn with a fifth of the others' acceleration and are not ready within 8 s. The other four engage before
    5 s; waiting for those two they began at 13 s."""
    run = simulate(
        load_machine("micro_motion_system"), load_scenario("roll", duration_s=8.0), compensator="adaptive", fast=True
    )
    volts = run.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    engaged_s = run.log["time_s"].to_numpy()[(volts != 0.0).argmax(axis=0)]
    assert [bool(leg.any()) for leg in volts.T] == [True, True, False, True, True, False]
    assert engaged_s[[0, 1, 3, 4]].max() < 5.0
