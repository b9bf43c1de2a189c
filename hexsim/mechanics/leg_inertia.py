"""The inertia of the legs: cylinder and rod as bodies, and what six of them add to the platform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.mechanics.mechanics import Mechanics, ROUNDING_m
from hexsim.mechanics.rigid_body import RigidBody, rigid_body


@dataclass(frozen=True, kw_only=True)
class LegBodies:
    """Masses [kg], centres [m] from their joint and moments [kg m2] of a leg's cylinder and rod."""

    cylinder_mass: float
    cylinder_centre: float
    cylinder_inertia: tuple[float, float]  # (transverse, axial)
    rod_mass: float
    rod_centre: float  # from the platform joint, towards the base
    rod_inertia: tuple[float, float]


def legs_at_platform(kinematics: Mechanics, bodies: Sequence[LegBodies]) -> tuple[np.ndarray, float]:
    """What six legs add to the platform at neutral: mass matrix (6, 6) about its origin, and the mass it carries [kg].

    Along a leg only the rod moves, across it both parts swing about the base joint, so its platform joint feels
        m_along = m_rod,   m_across = (I_cylinder + m_cylinder c^2 + I_rod + m_rod (L - c_rod)^2) / L^2
    and M = sum J_i' (m_along u u' + m_across (1 - u u')) J_i with J_i the velocity of joint i from the twist. The weight
    of rod and cylinder is shared between the joints as a beam's.
    """
    matrix, carried = np.zeros((6, 6)), 0.0
    jacobian = kinematics.jacobian(np.zeros(6))
    lengths = kinematics.leg_lengths(np.zeros(6))
    for leg, joint, row, length in zip(bodies, kinematics.platform_joints, jacobian, lengths, strict=True):
        swing = leg.cylinder_inertia[0] + leg.cylinder_mass * leg.cylinder_centre**2
        swing += leg.rod_inertia[0] + leg.rod_mass * (length - leg.rod_centre) ** 2
        along = np.outer(row[:3], row[:3])
        mass = leg.rod_mass * along + swing / length**2 * (np.eye(3) - along)
        x, y, z = joint
        arm = np.hstack([np.eye(3), np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])])
        matrix += arm.T @ mass @ arm
        level = 1 - row[2] ** 2
        carried += leg.rod_mass * (1 - level * leg.rod_centre / length)
        carried += leg.cylinder_mass * level * leg.cylinder_centre / length
    return matrix, carried


def lumped_legs(kinematics: Mechanics, bodies: Sequence[LegBodies]) -> RigidBody:
    """One rigid body in place of six legs: exact in heave and in the three rotations at neutral.

    A rigid body has one mass for all directions: heave's is taken, so surge and sway are off by the legs' difference
    (a few kg of 600); the centre takes up the couplings of heave with roll and pitch and of surge with pitch. Products of
    inertia, which legs that are not alike have, are left out. The difference from full legs is
    measured in tests/plant/test_integration.py.
    """
    matrix, carried = legs_at_platform(kinematics, bodies)
    mass = matrix[2, 2]
    x, y, z = -matrix[2, 4] / mass, matrix[2, 3] / mass, matrix[0, 4] / mass
    x, y = (0.0 if abs(offset) < ROUNDING_m else offset for offset in (x, y))
    about = np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    inertia = np.diag(np.diag(matrix)[3:] - mass * about)
    return rigid_body(mass, [x, y, z], inertia, carried)
