"""Flexible or sloshing payload: a part of the load rides on a spring and damper along one axis of the load.

[effects.flexible_payload]                                    # surge: tilt 90 deg, azimuth 0; sway: both 90 deg
mass_kg = 60.0
frequency_Hz = 4.5
tilt_rad = 1.5708                                             # of the axis from the platform's z towards its x
azimuth_rad = 0.0                                             # of that tilt about z, from x towards y
"""

from __future__ import annotations

import math

from hexsim.errors import HexsimError
from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import PayloadMode, Resolved

OF_PLATFORM = ("tilt_rad", "azimuth_rad", "height_m")


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Take the part out of the rigid load and hang it on a spring; the centre of mass of both stays. HexsimError: of a bench
    an axis that is not its own."""

    load, mass = resolved.load, values["mass_kg"]
    if mass <= 0.0:
        return
    tilt, azimuth, height = (values[key] for key in OF_PLATFORM)
    key = "moving_mass_kg" if load.moving_mass_kg is not None else "platform_mass_kg"
    left = getattr(load, key) - mass
    if key == "moving_mass_kg" and (tilt, height) != (0.0, 0.0):
        raise HexsimError("[effects.flexible_payload] a bench moves along its axis only: leave out tilt and height")
    x, y, z = load.centre_of_mass_m
    below = mass * height / left if height and left else 0.0  # no mass left: `resolve.check_load` says so
    resolved.load = load.model_copy(update={key: left, "centre_of_mass_m": (x, y, z - below)})
    mode = PayloadMode(mass_kg=mass, frequency_Hz=values["frequency_Hz"], damping_ratio=values["damping_ratio"])
    mode.position_m = (x, y, z + height)
    mode.axis = (math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt))
    resolved.payload_modes.append(mode)


EFFECT = Effect(
    name="flexible_payload",
    balance="force",
    description="a part of the payload moves on a spring along one axis (flexible mount, sloshing)",
    source="Ibrahim 2005; mounts 3-30 Hz",
    parameters=(
        EffectParameter(name="mass_kg", unit="kg", bounds=(0.0, 1e5), typical=4.0),
        EffectParameter(
            name="frequency_Hz",
            unit="Hz",
            bounds=(0.1, 200.0),
            typical=8.0,
            default=8.0,
        ),
        EffectParameter(name="damping_ratio", unit="1", bounds=(0.0, 2.0), typical=0.05, default=0.05),
        *(
            EffectParameter(name=name, unit=unit, bounds=(-most, most), typical=0.0, default=0.0, kinds=("hexapod",))
            for name, unit, most in zip(OF_PLATFORM, ("rad", "rad", "m"), (6.3, 6.3, 3.0), strict=True)
        ),
    ),
    apply=apply,
    places="platform",
)
