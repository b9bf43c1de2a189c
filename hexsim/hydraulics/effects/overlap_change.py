"""Overlap larger (underlap: smaller) than declared, the same at both edges."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The same length at the supply and the tank edge."""
    resolved.rows[list(legs), P.OVERLAP_SUPPLY] += values["overlap_m"]
    resolved.rows[list(legs), P.OVERLAP_TANK] += values["overlap_m"]


EFFECT = Effect(
    name="overlap_change",
    balance="valve",
    description="the valve's overlap differs from the declared one at both edges",
    source="report 3.2; 5 um is 0.45 % of stroke, also 20 and 50 um",
    parameters=(
        EffectParameter(name="overlap_m", unit="m", bounds=(-1e-3, 1e-3), typical=8e-6, slot=P.OVERLAP_SUPPLY),
    ),
    apply=apply,
)
