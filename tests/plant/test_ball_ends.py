"""The ball ends of full legs: they hold, and take next to nothing of the oil's ring, whatever the legs weigh."""

import math

import mujoco
import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant

FRICTIONLESS = {
    f"friction.{kind}_{way}_{unit}": 0.0
    for kind, unit in (("viscous", "N_s_m"), ("coulomb", "N"), ("static", "N"))
    for way in ("extend", "retract")
}
TICKS = 1000


def decrement(model: str, leg_mass_kg: float) -> float:
    """Decay of the heave ring [1/s] with valves shut, no friction and no leak, after a push of 5 ms."""
    machine = changed(load_machine("micro_motion_system"), FRICTIONLESS | {"load.leg_mass_kg": leg_mass_kg})
    plant = Plant(machine, model=model, timestep=2.5e-4)
    plant.prepare(1000.0, TICKS)
    platform = plant.model.body("platform").id
    for k in range(TICKS):
        plant.data.xfrc_applied[platform, 2] = 3000.0 if k < 5 else 0.0
        plant.tick(np.zeros(6))
    speed, t = plant.record.qvel[:, 2], np.arange(TICKS) / 1000.0
    early, late = (np.sqrt(np.mean(speed[(t >= at) & (t < at + 0.3)] ** 2)) for at in (0.1, 0.65))
    return -math.log(late / early) / 0.55


@pytest.mark.parametrize(
    ("leg_mass_kg", "share"), [(12.0, 0.02), pytest.param(1.0, 0.02, marks=pytest.mark.slow), (0.1, 0.08)]
)
def test_ball_ends_damp_next_to_nothing(leg_mass_kg, share):
    """Beside the tendon model's ring, that of full legs decays by less than 2 % of what viscous friction would
    take; of legs of 0.1 kg, which no cylinder is as light as, by 6 %.

    2,000 N s/m a leg take d sum(cos^2)/2m of the heave: 6 x 2000 cos^2/(2 x 672 kg), about 6 1/s. Before: 2.4 % of it at
    12 kg, 50 % without leg mass.
    """
    viscous = 6 * 2000.0 * 0.7 / (2.0 * 672.0)
    assert decrement("full", leg_mass_kg) - decrement("tendon", leg_mass_kg) < share * viscous


def test_ball_ends_hold_at_the_longest_step():
    """Steps of a millisecond with legs of 0.1 kg: the ends give by less than 3 um, one count of the transducers, and no
    warning of MuJoCo."""
    plant = Plant(changed(load_machine("micro_motion_system"), {"load.leg_mass_kg": 0.1}), model="full")
    worst = 0.0
    for k in range(300):
        plant.tick(np.full(6, 1.5 * np.sin(2 * np.pi * 2.0 * k * 2e-3)))
        mujoco.mj_forward(plant.model, plant.data)
        worst = max(worst, float(np.abs(plant.data.efc_pos[: plant.data.nefc]).max()))
    plant.check()
    assert worst < 3e-6
