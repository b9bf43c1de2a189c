"""The leg that `adaptive` estimates and inverts, and the leg that hexsim simulates, are written apart. Here they meet."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from compensation.adaptive import leg
from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

V_TO_M, BOTTOM_m2, TOP_m2 = 1.1e-4, math.pi / 4 * 0.04**2, math.pi / 4 * (0.04**2 - 0.03**2)
ROUNDING_m, TICK_S, WINDOW = 1e-6, 2e-3, 100


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """The bench in heave under plain control, without noise: 1 kHz."""
    ideal: dict[str, Any] = dict.fromkeys(
        ("sensors.position_noise_m", "sensors.position_resolution_m", "sensors.pressure_noise_Pa"), 0.0
    )
    machine = changed(load_machine("bench"), ideal | {"valve.edge_rounding_m": ROUNDING_m})
    run = simulate(machine, load_scenario("heave", duration_s=6.0), compensator="none", fast=True)
    return {name: run.log[name].to_numpy() for name in run.log.columns}


def declared(**changes: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and sheet of the estimator's leg for the bench of models/bench.toml."""
    n, sheet = np.zeros(leg.N_NUMBERS), np.zeros(leg.N_SHEET)
    sheet[[leg.S_A1, leg.S_A2, leg.S_E, leg.S_V1, leg.S_STROKE, leg.S_TICK, leg.S_OWN]] = (
        BOTTOM_m2, TOP_m2, 1.5e9, 5e-7, 0.2, TICK_S, 1.0,
    )  # fmt: skip
    sheet[leg.S_FLOW] = 0.611 * math.pi * 0.01 * V_TO_M * math.sqrt(2.0 / 860.0)
    known = {
        "ln_spool": math.log(60.0), "zeta": 0.7, "gain_up": 1.0, "gain_dn": 1.0, "dead_up_V": 5e-6 / V_TO_M,
        "dead_dn_V": 5e-6 / V_TO_M, "ln_round_V": math.log(ROUNDING_m / V_TO_M), "ln_turbulent": math.log(1e4),
        "ln_laminar": -20.0, "mass": 40.0,
        "hold": 40.0 * 9.8, "coulomb_up": 65.0, "coulomb_dn": 60.0, "static_up": 30.0, "static_dn": 30.0,
        "viscous_up": 2200.0, "viscous_dn": 1800.0, "ln_stribeck": math.log(5e-3), "reg_m_s": 2e-4,
        "give_m_N": 1.0 / 3e8,
    }  # fmt: skip
    for name, value in (known | changes).items():
        n[leg.NAMES.index(name)] = value
    return n, sheet


def off(log: dict[str, np.ndarray], first: int, **changes: float) -> tuple[float, float]:
    """Largest distance of position [m] and pressure [Pa] within a window of the log from its row `first` on."""
    n, sheet = declared(**changes)
    y, v, P1 = log["true_position_m"], log["velocity_m_s"], log["true_pressure_bottom_Pa"]
    spool, volts = log["spool_m"] / V_TO_M, log["valve_V"]
    x = np.zeros(leg.N_STATES)
    x[[leg.Y, leg.V, leg.P1, leg.P2, leg.X, leg.AMP]] = y[first], v[first], P1[first], 7e6, spool[first], volts[first]
    x[leg.XD], x[leg.Z] = (spool[first + 1] - spool[first - 1]) / 2e-3, math.copysign(62.5 / 3e8, v[first])
    none, work = np.zeros((leg.N_STATES, 1)), np.zeros(leg.N_SPACE)
    rows, found = first + 2 + 2 * np.arange(WINDOW), np.empty((2, WINDOW))
    for k in range(WINDOW):
        leg.tick(x, none, n, sheet, volts[first + 2 * k], volts[first + 2 * k], 0.0, 7e6, 0.0, work)
        found[:, k] = x[leg.Y], x[leg.P1]
    return float(np.abs(found[0] - y[rows]).max()), float(np.abs(found[1] - P1[rows]).max())


# where a window begins [row of 1 ms]: up, up and slower, down, down at full speed
STROKES = (2000, 2400, 2800, 3200)
TURN = 3600
SAME_m, SAME_Pa, TURN_Pa = 1e-5, 1e3, 5e4


def test_both_legs_move_alike(log) -> None:
    """0.2 s from the log's own state under its volts, numbers of the machine file: within 10 um and 1 kPa of the simulated leg in
    strokes. In a reversal within 50 kPa: the estimator's bristle gives way, the plant's friction has none."""
    assert np.ptp(log["true_position_m"][2000:4000]) > 0.05
    for first in STROKES:
        apart_m, apart_Pa = off(log, first)
        assert apart_m < SAME_m and apart_Pa < SAME_Pa
    apart_m, apart_Pa = off(log, TURN)
    assert np.ptp(np.sign(log["velocity_m_s"][TURN : TURN + 200])) == 2.0
    assert apart_m < SAME_m and apart_Pa < TURN_Pa


@pytest.mark.parametrize(
    "changes",
    [
        {"gain_up": 1.01, "gain_dn": 1.01},
        {"dead_up_V": 0.046, "dead_dn_V": 0.046},
        {"ln_spool": math.log(55.0)},
        {"zeta": 0.8},
        {"leak": 1e-13},
        {"hold": 40.0 * 9.8 + 20.0},
        {"viscous_up": 2400.0, "viscous_dn": 2000.0},
        {"coulomb_up": 85.0, "coulomb_dn": 80.0},
        {"ln_turbulent": math.log(1e6)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_each_number_is_the_plants(log, changes) -> None:
    """A number that is a little off shows in a stroke: beyond twice what both legs differ by."""
    apart = np.max([off(log, first, **changes) for first in STROKES], axis=0)
    assert apart[0] > 2.0 * SAME_m or apart[1] > 2.0 * SAME_Pa
