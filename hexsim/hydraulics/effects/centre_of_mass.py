"""Centre of mass off its declared place."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Shift the centre of mass in the platform frame."""
    load = resolved.load
    shifted = tuple(c + values[k] for c, k in zip(load.centre_of_mass_m, ("x_m", "y_m", "z_m"), strict=True))
    resolved.load = load.model_copy(update={"centre_of_mass_m": shifted})


EFFECT = Effect(
    name="centre_of_mass",
    balance="platform",
    description="the platform's centre of mass is off its declared place",
    source="payload put on off centre: 10-100 mm",
    parameters=(
        EffectParameter(name="x_m", unit="m", bounds=(-5.0, 5.0), typical=0.03, default=0.0),
        EffectParameter(name="y_m", unit="m", bounds=(-5.0, 5.0), typical=0.03, default=0.0),
        EffectParameter(name="z_m", unit="m", bounds=(-5.0, 5.0), typical=0.1, default=0.0),
    ),
    apply=apply,
    places="platform",
    kinds=("hexapod",),
    vector=True,
)
