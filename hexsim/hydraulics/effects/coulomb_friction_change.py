"""Coulomb friction larger or smaller than declared, both directions."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Both directions alike, never below zero."""
    for place in (P.COULOMB_EXTEND, P.COULOMB_RETRACT):
        row = resolved.rows[list(legs), place]
        resolved.rows[list(legs), place] = (row + values["force_N"]).clip(min=0.0)


EFFECT = Effect(
    name="coulomb_friction_change",
    balance="force",
    description="Coulomb friction differs from the declared one",
    source="seal wear and preload; a 63/35 mm cylinder has 1741 N",
    parameters=(
        EffectParameter(
            name="force_N",
            unit="N",
            bounds=(-1e6, 1e6),
            typical=40.0,
            adds_to=("coulomb_extend_N", "coulomb_retract_N"),
        ),
    ),
    apply=apply,
)
