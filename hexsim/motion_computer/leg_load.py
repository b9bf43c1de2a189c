"""The load as the legs see it about neutral: masses along the legs, and the forces that hold it at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.hydraulics.resolved import Resolved
from hexsim.machine.geometry import machine_kinematics, platform_body
from hexsim.mechanics.rigid_body import joint_wrenches, mass_matrix

Array = NDArray[np.float64]


def leg_compliance(resolved: Resolved) -> Array:
    """Acceleration of each leg for a force on each, at neutral (n_legs, n_legs) [1/kg]: J M^-1 J'."""
    machine = resolved.machine
    if not machine.is_hexapod:
        return np.array([[1.0 / (resolved.load.moving_mass_kg or 0.0)]])
    kinematics = machine_kinematics(machine)
    jacobian = kinematics.jacobian(np.zeros(6))
    return jacobian @ np.linalg.solve(mass_matrix(platform_body(resolved, kinematics)), jacobian.T)


def holding_forces(resolved: Resolved) -> Array:
    """Axial forces (n_legs,) [N] that hold the load at rest at neutral: J' F = -weight."""
    machine, gravity = resolved.machine, resolved.gravity_m_s2
    if not machine.is_hexapod:
        return np.array([-(resolved.load.moving_mass_kg or 0.0) * gravity[2]])
    kinematics = machine_kinematics(machine)
    nothing = np.zeros((1, 6))
    body = platform_body(resolved, kinematics)
    wrench = joint_wrenches(body, nothing, nothing[:, :3], gravity[None, :], np.zeros(1))[0]
    return np.linalg.solve(kinematics.jacobian(np.zeros(6)).T, wrench)
