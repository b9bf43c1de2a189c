"""Overlap larger (underlap: smaller) than declared, the same at all edges."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The same length at all edges; a three-way valve does not look at the last two."""
    for edge in (P.OVERLAP_SUPPLY, P.OVERLAP_TANK, P.OVERLAP_SUPPLY_TOP, P.OVERLAP_TANK_TOP):
        resolved.rows[list(legs), edge] += values["overlap_m"]


EFFECT = Effect(
    name="overlap_change",
    balance="valve",
    description="the valve's overlap differs from the declared one at all edges",
    source="report 3.2; 5 um is 0.45 % of stroke, also 20 and 50 um",
    parameters=(
        EffectParameter(name="overlap_m", unit="m", bounds=(-1e-3, 1e-3), typical=8e-6, slot=P.OVERLAP_SUPPLY),
    ),
    apply=apply,
)
