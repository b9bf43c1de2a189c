"""Flexible or sloshing payload: a part of the load rides on a spring and damper."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import PayloadMode, Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Take the part out of the rigid load and hang it on a spring along the vertical axis."""

    load, mass = resolved.load, values["mass_kg"]
    if mass <= 0.0:
        return
    key = "moving_mass_kg" if load.moving_mass_kg is not None else "platform_mass_kg"
    resolved.load = load.model_copy(update={key: getattr(load, key) - mass})
    mode = PayloadMode(mass_kg=mass, frequency_Hz=values["frequency_Hz"], damping_ratio=values["damping_ratio"])
    mode.position_m = load.centre_of_mass_m
    resolved.payload_modes.append(mode)


EFFECT = Effect(
    name="flexible_payload",
    balance="force",
    description="a part of the payload moves on a spring (flexible mount, sloshing)",
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
    ),
    apply=apply,
    places="platform",
)
