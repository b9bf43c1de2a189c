"""The load as the legs see it about neutral: masses along the legs, and the forces that hold it at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.hydraulics.resolved import Resolved
from hexsim.machine.geometry import moving_body
from hexsim.mechanics.rigid_body import joint_wrenches, mass_matrix

Array = NDArray[np.float64]


def leg_compliance(resolved: Resolved) -> Array:
    """Acceleration of each leg for a force on each, at neutral (n_legs, n_legs) [1/kg]: J M^-1 J'."""
    jacobian = resolved.machine.mechanics.jacobian(np.zeros(6))
    return jacobian @ np.linalg.pinv(mass_matrix(moving_body(resolved))) @ jacobian.T  # a bench's mass does not turn


def holding_forces(resolved: Resolved) -> Array:
    """Axial forces (n_legs,) [N] that hold the load at rest at neutral: J' F = -weight."""
    none = np.zeros((1, 6))
    wrench = joint_wrenches(moving_body(resolved), none, none[:, :3], resolved.gravity_m_s2[None, :], np.zeros(1))[0]
    return np.linalg.lstsq(resolved.machine.mechanics.jacobian(np.zeros(6)).T, wrench, rcond=None)[0]
