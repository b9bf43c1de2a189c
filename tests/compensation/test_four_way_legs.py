"""Legs with two chambers on a four-way valve: the bump that is left on a plant written apart, and on the shipped machines."""

from __future__ import annotations

import dataclasses

import pytest
from leg_plant import sine
from pair_plant import PairLeg, run_pair

from compensation import create
from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

LEGS = {
    "underlap of 5 um": PairLeg(overlap_m=-5e-6),
    "backlash of 30 mV": PairLeg(backlash_V=0.03),
    "valve 4 ms late": PairLeg(valve_delay_s=4e-3),
    "overlap of 20 um": PairLeg(overlap_m=2e-5),
    "backlash, 500 kg": PairLeg(mass_kg=500.0, backlash_V=0.03),
    "underlap of 10 um": PairLeg(overlap_m=-1e-5),
    "valve 6 ms late": PairLeg(valve_delay_s=6e-3),
}
DAILY = 1


@pytest.mark.parametrize(
    "name", [*list(LEGS)[:DAILY], *(pytest.param(n, marks=pytest.mark.slow) for n in list(LEGS)[DAILY:])]
)
def test_an_eighth_of_plain_controls_bump_is_left(name) -> None:
    """0.05 m at 0.5 Hz, nothing learned before: the last three of twelve periods; none before is worse by more than a tenth."""
    leg = LEGS[name]
    bump = run_pair(create("none"), leg, sine(), 8.0, period_s=2.0, seed=9720).peaks()[-2:].max()
    peaks = run_pair(create("adaptive"), leg, sine(), 24.0, period_s=2.0, seed=9720).peaks()
    assert peaks[-3:].max() < bump / 8
    assert peaks.max() < 1.1 * bump


@pytest.mark.slow
def test_a_late_valve_on_soft_oil_in_a_slow_motion_is_compensated() -> None:
    """6 ms late, 3 % of air, 120 kg, 0.03 m at 0.2 Hz: a third of plain control's bump is left at the end."""
    leg = PairLeg(mass_kg=120.0, valve_delay_s=6e-3, air=0.03)
    plain, made = (
        run_pair(create(name), leg, sine(0.03, 0.2), 42.0, period_s=5.0, seed=9722).peaks(5.0)[-3:].max()
        for name in ("none", "adaptive")
    )
    assert made < plain / 3


def bump(name: str, changes: dict[str, float], scenario: str = "heave", machine: str = "servo_bench") -> float:
    """Peak in the band from 14 to 24 s of the sine."""
    motion = dataclasses.replace(load_scenario(scenario, duration_s=24.0), figures_from_s=14.0)
    done = simulate(changed(load_machine(machine), changes), motion, compensator=create(name), fast=True)
    axes = done.summary["axes"]
    found = axes[next(iter(axes)) if "bench" in machine else {"heave": "z", "roll": "roll"}[scenario]]
    return found.get("peak_band_m_s2", found.get("peak_band_rad_s2"))


CONTROLLERS = {
    "P": {},
    "PID": {"controller.integral_time_s": 1.0, "controller.velocity_gain_V_s_per_m": 0.6},
    "feed-forward": {
        "controller.velocity_feed_forward_V_s_per_m": 9.6, "controller.acceleration_feed_forward_V_s2_per_m": 0.05
    },
    "notch": {"controller.notch_Hz": 27.0},
    "cascade": {"controller.structure": "cascade", "controller.velocity_gain_V_s_per_m": 1.0},
    "pressure feedback": {"controller.pressure_feedback_V_per_Pa": 6e-8},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_it_acts_on_top_of_each_controller(controller) -> None:
    """The servo bench, 0.05 m at 0.5 Hz, nothing learned before: an eighth of plain control's bump is left, a fifth where the
    controller's own pressure feedback takes part in the damping."""
    changes = CONTROLLERS[controller]
    left = 1 / 5 if controller == "pressure feedback" else 1 / 8
    assert bump("adaptive", changes) < left * bump("none", changes)


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "left"), [("heave", 1 / 8), ("roll", 1 / 4)])
def test_a_servo_hexapod_is_compensated(scenario, left) -> None:
    """Six legs: an eighth of plain control's bump is left in heave, a quarter in roll, where legs 3 and 6 hardly move themselves."""
    made, plain = (bump(name, {}, scenario, "servo_hexapod") for name in ("adaptive", "none"))
    assert made < left * plain
