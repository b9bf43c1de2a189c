"""What the platform of a hexapod asks of its legs, from measured motion: inverse dynamics, no hydraulics."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import Window

Array = np.ndarray


def leg_loads(log: Log, machine: Machine) -> tuple[Array, Array]:
    """(thrusts [N] that the platform asks of its legs, accelerations of the pistons [m/s2]), (6, n) each.

    Newton-Euler about the centre of the joints in the world frame, then J^T f = wrench. Massless legs.
    """
    geometry, load = machine.geometry, machine.load
    if geometry is None or load.platform_mass_kg is None or load.platform_inertia_kg_m2 is None:
        raise HexsimError(f"machine {machine.name} has no [geometry] or platform: the legs' loads cannot be told")
    legs = HexapodKinematics.from_geometry(**geometry.model_dump(), stroke_m=machine.cylinder.stroke_m)
    look = Window(log.rate, 0.04)
    positions = np.stack([look.mean(log.columns[f"position_{i}_m"]) for i in range(1, 7)])
    pose = legs.forward(positions.T)
    twist = legs.twist(pose, look.rate(pose.T).T)
    measured = np.stack([log.columns[name] for name in accelerations_of(6)], axis=-1)
    motion = legs.from_platform_frame(pose, measured)
    rotation = legs.rotation(pose)
    omega, alpha = twist[:, 3:], motion[:, 3:]
    arm = rotation @ np.asarray(load.centre_of_mass_m)
    a = motion[:, :3] + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    force = load.platform_mass_kg * (a + np.array([0.0, 0.0, machine.machine.gravity_m_s2]))
    inertia = rotation * np.asarray(load.platform_inertia_kg_m2) @ np.swapaxes(rotation, -1, -2)
    spin = np.einsum("nij,nj->ni", inertia, omega)
    moment = np.einsum("nij,nj->ni", inertia, alpha) + np.cross(omega, spin) + np.cross(arm, force)
    thrust = legs.static_leg_forces(pose, np.concatenate([force, moment], axis=-1))
    return thrust.T, legs.leg_accelerations(pose, twist, motion).T
