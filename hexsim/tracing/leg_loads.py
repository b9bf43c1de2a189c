"""What a platform asks of its legs, by inverse dynamics from measured motion, and what their oil gives."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.resolve import resolve
from hexsim.machine.geometry import held_body, machine_kinematics
from hexsim.mechanics.rigid_body import joint_wrenches
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import Window

Array = np.ndarray


def oil_forces(log: Log, machine: Machine) -> Array | None:
    """P1 A1 - P2 A2 (n_legs, n) [N]: P2 measured where the rod side is on the valve, else Ps. None without a pressure."""
    top = log.signal("pressure_top") if machine.cylinder.rod_side == "valve" else log.supply
    if log.pressure is None or top is None:
        return None
    bottom, rod = (machine.of_legs("cylinder", key)[:, None] for key in ("area_bottom_m2", "area_top_m2"))
    return log.pressure * bottom - top * rod


def leg_loads(log: Log, machine: Machine) -> tuple[Array, Array]:
    """(thrusts [N] that the platform asks of its legs, accelerations of the pistons [m/s2]), (6, n) each.

    The wrench of `mechanics.rigid_body` at the measured motion, then J^T f = wrench. The legs' masses as they act
    at neutral.
    """
    load = machine.load
    if machine.geometry is None or load.platform_mass_kg is None or load.platform_inertia_kg_m2 is None:
        raise HexsimError(f"machine {machine.name} has no [geometry] or platform: the legs' loads cannot be computed")
    legs, body = machine_kinematics(machine), held_body(resolve(machine), log.loaded)
    look = Window(log.rate, 0.04)
    positions = np.stack([look.mean(log.columns[f"position_{i}_m"]) for i in range(1, 7)])
    pose = legs.forward(positions.T)
    twist = legs.twist(pose, look.rate(pose.T).T)
    measured = np.stack([log.columns[name] for name in accelerations_of(6)], axis=-1)
    omega = legs.to_platform_frame(pose, twist)[:, 3:]
    gravity = np.array([0.0, 0.0, -machine.machine.gravity_m_s2]) @ legs.rotation(pose)
    wrench = joint_wrenches(body, measured, np.ascontiguousarray(omega), gravity)
    thrust = legs.static_leg_forces(pose, legs.from_platform_frame(pose, wrench))
    return thrust.T, legs.leg_accelerations(pose, twist, legs.from_platform_frame(pose, measured)).T
