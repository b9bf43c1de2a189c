"""What a scenario asks of a bench's single leg."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.machine.files import load_machine
from hexsim.machine.geometry import machine_kinematics
from hexsim.scenarios import Scenario

Array = NDArray[np.float64]
MODEL_HEXAPOD = "micro_motion_system"


def bench_motion(scenario: Scenario, time_s: Array) -> tuple[Array, Array, Array]:
    """Position [m, from half stroke], velocity and acceleration (n,) that a scenario asks of one leg.

    Actuator mode and heave are taken as they are. Any other motion of a platform is what leg 1 of the report's machine
    would do in it, so that a bench can be driven as one leg of a rolling hexapod is.
    """
    values, rates, accelerations = scenario.evaluate(time_s)
    if scenario.mode == "actuator":
        return values[:, 0], rates[:, 0], accelerations[:, 0]
    if set(scenario.signals) <= {"z"}:
        return values[:, 2], rates[:, 2], accelerations[:, 2]
    hexapod = load_machine(MODEL_HEXAPOD)
    kinematics = machine_kinematics(hexapod)
    twist, twist_rate = kinematics.twist(values, rates), kinematics.twist_rate(values, rates, accelerations)
    return (
        kinematics.piston_positions(values)[:, 0] - hexapod.cylinder.stroke_m / 2,
        kinematics.leg_velocities(values, twist)[:, 0],
        kinematics.leg_accelerations(values, twist, twist_rate)[:, 0],
    )
