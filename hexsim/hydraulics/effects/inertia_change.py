"""Moments of inertia differ from the declared ones."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Add to the three moments."""
    load = resolved.load
    declared = load.platform_inertia_kg_m2 or (0.0, 0.0, 0.0)
    moments = tuple(m + values[k] for m, k in zip(declared, ("x_kg_m2", "y_kg_m2", "z_kg_m2"), strict=True))
    resolved.load = load.model_copy(update={"platform_inertia_kg_m2": moments})


EFFECT = Effect(
    name="inertia_change",
    balance="platform",
    description="the platform's moments of inertia differ from the declared ones",
    source="payload spread: 10-50 %",
    parameters=(
        EffectParameter(name="x_kg_m2", unit="kg m2", bounds=(-1e6, 1e6), typical=12.0, default=0.0),
        EffectParameter(name="y_kg_m2", unit="kg m2", bounds=(-1e6, 1e6), typical=12.0, default=0.0),
        EffectParameter(name="z_kg_m2", unit="kg m2", bounds=(-1e6, 1e6), typical=20.0, default=0.0),
    ),
    apply=apply,
    places="platform",
    kinds=("hexapod",),
    vector=True,
)
