"""The mechanics of a declared machine: kinematics, and the bodies that move."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hexsim.declaration import Cylinder, Load, Machine
from hexsim.declaration.load import Payload
from hexsim.errors import HexsimError
from hexsim.hydraulics.resolved import PayloadMode, Resolved
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.mechanics.leg_inertia import LegBodies, legs_at_platform, lumped_legs
from hexsim.mechanics.rigid_body import RigidBody, Suspension, joined, mass_matrix, rigid_body


def machine_kinematics(machine: Machine) -> HexapodKinematics:
    """Joints, lengths and limits of a hexapod as declared. Raises HexsimError for a bench."""
    mechanics = machine.mechanics
    if not isinstance(mechanics, HexapodKinematics):
        raise HexsimError(f"machine {machine.name} is a bench and has no hexapod geometry: use a hexapod machine")
    return mechanics


def leg_bodies(resolved: Resolved, neutral_length: float) -> list[LegBodies]:
    """Cylinder and rod of each leg as slender rods: the cylinder spans 60 % of the neutral leg, the rod 55 % (they overlap)."""
    return [_leg_bodies(resolved.load, leg.cylinder, neutral_length) for leg in resolved.machine.legs]


def _leg_bodies(
    load: Load,
    cylinder: Cylinder,
    neutral_length: float,
    *,
    least_share: float = 1e-3,  # a machine without leg mass gets full legs of this share of the platform's mass each
) -> LegBodies:
    mass = load.leg_mass_kg or least_share * (load.platform_mass_kg or 0.0)
    rod_mass = load.rod_mass_fraction * mass
    cylinder_mass = mass - rod_mass
    cylinder_length, rod_length = 0.6 * neutral_length, 0.55 * neutral_length
    return LegBodies(
        cylinder_mass=cylinder_mass,
        cylinder_centre=cylinder_length / 2,
        cylinder_inertia=(
            cylinder_mass * cylinder_length**2 / 12,
            cylinder_mass * cylinder.piston_diameter_m**2 / 4,
        ),
        rod_mass=rod_mass,
        rod_centre=rod_length / 2,
        rod_inertia=(rod_mass * rod_length**2 / 12, rod_mass * cylinder.rod_diameter_m**2 / 8),
    )


def moving_body(resolved: Resolved, loaded: bool = False) -> RigidBody:
    """A bench's mass; or platform and, at its joints, the legs as far as they have mass (as in the tendon model).

    Without payloads on springs. loaded: with the additional mass, a point at the centre of mass.
    """
    load = with_additional_mass(resolved.load) if loaded else resolved.load
    kinematics = resolved.mechanics
    if not kinematics.has_platform:
        mass = load.moving_mass_kg or 0.0
        return rigid_body(mass, np.zeros(3), np.zeros((3, 3)), carried=mass)
    platform = platform_body(load, resolved.machine.payload)
    if load.leg_mass_kg <= 0:
        return platform
    neutral = float(kinematics.leg_lengths(np.zeros(6))[0])
    return joined(platform, lumped_legs(kinematics, leg_bodies(resolved, neutral)))


def legs_beyond_body(resolved: Resolved) -> np.ndarray:
    """Mass matrix (6, 6) of six legs at neutral, less that of the body that stands for them in `moving_body`; 0 without legs.

    A rigid body has one mass for all directions, legs have not. Its growth with the pose and what goes with the square of
    the velocity are left out.
    """
    kinematics = resolved.mechanics
    if not kinematics.has_platform or resolved.load.leg_mass_kg <= 0:
        return np.zeros((6, 6))
    bodies = leg_bodies(resolved, float(kinematics.leg_lengths(np.zeros(6))[0]))
    return legs_at_platform(kinematics, bodies)[0] - mass_matrix(lumped_legs(kinematics, bodies))


def with_additional_mass(load: Load) -> Load:
    """The load with what people put on it."""
    return load.model_copy(update={load.mass_key: load.carried_mass_kg + (load.additional_mass_kg or 0.0)})


def held_body(resolved: Resolved, loaded: bool = False) -> RigidBody:
    """`moving_body` with the payloads on springs held where they stand at rest."""
    body = moving_body(resolved, loaded)
    for mode in resolved.payload_modes:
        body = joined(body, rigid_body(mode.mass_kg, mode.position_m, np.zeros((3, 3)), carried=mode.mass_kg))
    return body


def platform_body(load: Load, payload: Sequence[Payload] = ()) -> RigidBody:
    """A hexapod's platform with what is bolted to it, as one body."""
    mass, inertia = load.platform_mass_kg or 0.0, np.diag(load.platform_inertia_kg_m2 or (0.0, 0.0, 0.0))
    body = rigid_body(mass, load.centre_of_mass_m, inertia, carried=mass)
    for part in payload:
        body = joined(
            body, rigid_body(part.mass_kg, part.position_m, np.diag(part.inertia_kg_m2), carried=part.mass_kg)
        )
    return body


def suspension(mode: PayloadMode, gravity_m_s2: np.ndarray) -> Suspension:
    """A payload's spring and damper as numbers."""
    omega = 2 * math.pi * mode.frequency_Hz
    rest = float(gravity_m_s2 @ np.array(mode.axis)) / omega**2
    return Suspension(mode.mass_kg, omega, mode.damping_ratio, mode.axis, mode.position_m, rest)
