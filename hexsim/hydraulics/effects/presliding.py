"""Presliding: bristles deflect before the seal slides (LuGre)."""

from __future__ import annotations

import math

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Give the legs a bristle state."""
    resolved.rows[list(legs), P.BRISTLE_STIFFNESS] = values["bristle_stiffness_N_m"]
    resolved.rows[list(legs), P.BRISTLE_DAMPING] = values["bristle_damping_N_s_m"]


EFFECT = Effect(
    name="presliding",
    balance="force",
    description="the seal is elastic before it slides",
    source="Canudas de Wit 1995; sizes 1e6-1e7 N/m",
    parameters=(
        EffectParameter(
            name="bristle_stiffness_N_m",
            unit="N/m",
            bounds=(1e4, 1e9),
            typical=1.0e6,
            neutral=math.inf,
        ),
        EffectParameter(name="bristle_damping_N_s_m", unit="N s/m", bounds=(0.0, 1e6), typical=1.0e3, default=1.0e3),
    ),
    apply=apply,
    once=True,
)
