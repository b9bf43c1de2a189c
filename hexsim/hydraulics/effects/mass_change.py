"""Moving mass larger or smaller than declared."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The bench's moving mass, or the platform's mass with its inertia as declared."""
    load = resolved.load
    if load.moving_mass_kg is not None:
        resolved.load = load.model_copy(update={"moving_mass_kg": load.moving_mass_kg + values["mass_kg"]})
    else:
        resolved.load = load.model_copy(update={"platform_mass_kg": (load.platform_mass_kg or 0.0) + values["mass_kg"]})


EFFECT = Effect(
    name="mass_change",
    balance="force",
    description="the moving mass differs from the declared one",
    source="forgotten payload",
    parameters=(
        EffectParameter(
            name="mass_kg",
            unit="kg",
            bounds=(-1e5, 1e5),
            typical=4.0,
            adds_to=("moving_mass_kg", "platform_mass_kg"),
        ),
    ),
    apply=apply,
    places="platform",
)
