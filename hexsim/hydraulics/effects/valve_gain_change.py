"""Valve gain: both edges pass (1 + r) times the declared flow (a valve that differs, a worn edge)."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Scale the discharge."""
    resolved.rows[list(legs), P.DISCHARGE] *= 1.0 + values["relative_change"]


EFFECT = Effect(
    name="valve_gain_change",
    balance="valve",
    description="the valve passes more or less flow than declared, at both edges alike",
    source="tolerance of valve data sheets: 10 %",
    parameters=(EffectParameter(name="relative_change", unit="1", bounds=(-0.9, 9.0), typical=0.10),),
    apply=apply,
    generic=True,
)
