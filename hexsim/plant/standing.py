# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The machine as an MJCF for MuJoCo without hexsim: legs of linear actuators in place of the hydraulics.

    model   ctrl = valve volts u:     F = F_0 + k (int k_v u dt - y) - d y'
    servo   ctrl = displacement [m]:  F = F_0 + k (ctrl - y) - d_s y',  within what the oil can push

y: piston from neutral; F_0: force at rest; k: the oil spring of the leg with its valve shut; k_v: speed for a volt; d: its
viscous friction. Both stand at neutral from MuJoCo's own start on, and stop at the ends of the stroke. They have neither
overlap nor dry friction, so no reversal bump: for that a model needs hexsim, or the plugin of `hexsim export plugin`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from hexsim.hydraulics.oil_spring import oil_stiffness, speed_per_volt
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.plant.plant import Plant


def standing_xml(
    plant: Plant,
    servo: bool = False,
    *,
    servo_damping: float = 0.7,  # of the servo: a step without a ring to be seen
    step_s: float = 5e-4,  # the stiffest modes, of the ball ends, have 1.6e3 rad/s: RK4 bears 2.8 over the step
) -> str:
    """The MJCF of a machine of full legs, with keyframe `home`. The plant is left as it is."""
    plant.reset()
    spec = plant.spec.copy()
    spec.option.timestep = step_s
    spec.nuser_actuator = spec.nuserdata = 0
    compliance = np.diag(plant.compliance)
    for i in range(plant.n_legs):
        actuator, p = spec.actuator(f"leg_{i + 1}"), plant.rows[i]
        k, rest = oil_stiffness(p), float(plant.data.actuator_force[i])
        ends = np.array([0.0, p[P.STROKE]]) - plant.kinematics.neutral_positions[i]
        actuator.biastype, actuator.dyntype = mujoco.mjtBias.mjBIAS_AFFINE, mujoco.mjtDyn.mjDYN_NONE
        gain, bias = np.zeros(10), np.zeros(10)
        if servo:
            gain[0], bias[:3] = k, (rest, -k, -2.0 * servo_damping * np.sqrt(k / compliance[i]))
            actuator.actdim, actuator.ctrlrange = 0, ends
            actuator.forcelimited, actuator.forcerange = True, forces(p)
        else:
            speed = speed_per_volt(p, plant.bottom_pressures()[i])
            viscous = 0.5 * (p[P.VISCOUS_EXTEND] + p[P.VISCOUS_RETRACT])
            gain[0], bias[:3] = k * speed, (rest, -k, -viscous)
            actuator.dyntype, actuator.actdim = mujoco.mjtDyn.mjDYN_INTEGRATOR, 1
            actuator.actlimited, actuator.actrange = True, ends / speed
        actuator.gainprm, actuator.biasprm = gain, bias
        joint = spec.joint(f"slide_{i + 1}")
        joint.limited, joint.range = True, ends
    if plant.has_supply_states:
        spec.delete(spec.actuator("supply"))
    spec.add_key(name="home")
    return spec.to_xml()


def forces(p: np.ndarray) -> list[float]:
    """Least and largest force of a leg's oil [N]."""
    supply, tank, bottom, top = p[P.SUPPLY_PRESSURE], p[P.TANK_PRESSURE], p[P.AREA_BOTTOM], p[P.AREA_TOP]
    most = tank if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else supply  # the rod side while the leg extends
    return [float(tank * bottom - supply * top), float(supply * bottom - most * top)]
