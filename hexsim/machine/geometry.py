"""The mechanics of a declared machine: kinematics, and the bodies that move."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.resolved import PayloadMode, Resolved
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.mechanics.leg_inertia import LegBodies, lumped_legs
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.rigid_body import RigidBody, Suspension, joined, rigid_body
from hexsim.mechanics.single_leg import SingleLegKinematics

LEAST_LEG_FRACTION = 1e-3  # a machine without leg mass gets full legs of this share of the platform's mass each


def machine_kinematics(machine: Machine) -> HexapodKinematics:
    """Joints, lengths and limits from the [geometry] and [cylinder] tables, kept between calls. Raises HexsimError for a bench."""
    if machine.geometry is None:
        raise HexsimError(f"machine {machine.name} is a bench and has no hexapod geometry: use a hexapod machine")
    return _kinematics(tuple(machine.geometry.model_dump().items()), machine.cylinder.stroke_m)


def mechanics_of(machine: Machine) -> Mechanics:
    """Legs, poses and limits of a hexapod or of a bench."""
    if machine.geometry is None:
        return SingleLegKinematics.of_stroke(machine.cylinder.stroke_m)
    return machine_kinematics(machine)


@lru_cache(maxsize=8)
def _kinematics(geometry: tuple[tuple[str, float], ...], stroke: float) -> HexapodKinematics:
    return HexapodKinematics.from_geometry(**dict(geometry), stroke_m=stroke)


def leg_bodies(resolved: Resolved, neutral_length: float) -> LegBodies:
    """Cylinder and rod as slender rods: the cylinder spans 60 % of the neutral leg, the rod 55 % (they overlap)."""
    load, cylinder = resolved.load, resolved.machine.cylinder
    mass = load.leg_mass_kg or LEAST_LEG_FRACTION * (load.platform_mass_kg or 0.0)
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


def moving_body(resolved: Resolved) -> RigidBody:
    """A bench's mass; or platform and, at its joints, the legs as far as they have mass (as in the tendon model)."""
    load = resolved.load
    sprung = sum(mode.mass_kg for mode in resolved.payload_modes)
    kinematics = mechanics_of(resolved.machine)
    if not kinematics.has_platform:
        mass = load.moving_mass_kg or 0.0
        return rigid_body(mass, np.zeros(3), np.zeros((3, 3)), carried=mass, sprung=sprung)
    mass, inertia = load.platform_mass_kg or 0.0, np.diag(load.platform_inertia_kg_m2 or (0.0, 0.0, 0.0))
    platform = rigid_body(mass, load.centre_of_mass_m, inertia, carried=mass, sprung=sprung)
    if load.leg_mass_kg <= 0:
        return platform
    neutral = float(kinematics.leg_lengths(np.zeros(6))[0])
    return joined(platform, lumped_legs(kinematics, leg_bodies(resolved, neutral)))


def suspension(mode: PayloadMode) -> Suspension:
    """A payload's spring and damper as numbers."""
    return Suspension(mode.mass_kg, 2 * math.pi * mode.frequency_Hz, mode.damping_ratio)
