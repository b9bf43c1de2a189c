"""Stribeck peak at small speed larger or smaller than declared, both directions."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Both directions alike, never below zero."""
    for place in (P.STATIC_EXTEND, P.STATIC_RETRACT):
        row = resolved.rows[list(legs), place]
        resolved.rows[list(legs), place] = (row + values["static_N"]).clip(min=0.0)


EFFECT = Effect(
    name="stribeck_friction_change",
    balance="force",
    description="the friction peak at small speed differs from the declared one",
    source="seals at rest: peak up to the Coulomb force",
    parameters=(
        EffectParameter(
            name="static_N",
            unit="N",
            bounds=(-1e6, 1e6),
            typical=40.0,
            adds_to=("static_extend_N", "static_retract_N"),
        ),
    ),
    apply=apply,
)
