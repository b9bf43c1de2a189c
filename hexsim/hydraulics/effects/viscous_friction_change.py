"""Viscous friction larger or smaller than declared, both directions."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Both directions alike, never below zero."""
    for place in (P.VISCOUS_EXTEND, P.VISCOUS_RETRACT):
        row = resolved.rows[list(legs), place]
        resolved.rows[list(legs), place] = (row + values["viscous_N_s_m"]).clip(min=0.0)


EFFECT = Effect(
    name="viscous_friction_change",
    balance="force",
    description="viscous friction differs from the declared one",
    source="oil temperature: viscosity halves in 15 K",
    parameters=(
        EffectParameter(
            name="viscous_N_s_m",
            unit="N s/m",
            bounds=(-1e7, 1e7),
            typical=800.0,
            adds_to=("viscous_extend_N_s_m", "viscous_retract_N_s_m"),
        ),
    ),
    apply=apply,
)
