"""Unequal ports: the tank edge's area gradient is (1 + r) times the supply edge's, their geometric mean as declared.

About the mean because a change of both edges alike is the valve's gain (the discharge coefficient, `valve_gain_change`).
"""

from __future__ import annotations

import math

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Tank edge up, supply edge down by the root of the ratio."""
    root = math.sqrt(1.0 + values["tank_edge_ratio_change"])
    resolved.rows[list(legs), P.AREA_GRADIENT_TANK] *= root
    resolved.rows[list(legs), P.AREA_GRADIENT_SUPPLY] /= root


EFFECT = Effect(
    name="unequal_ports",
    balance="valve",
    description="the tank edge opens faster or slower than the supply edge",
    source="manufacture; asymmetric spools for differential cylinders reach 2:1",
    parameters=(EffectParameter(name="tank_edge_ratio_change", unit="1", bounds=(-0.9, 9.0), typical=0.08),),
    apply=apply,
)
