"""Unequal ports: the tank edge's area gradient is (1 + r) times the declared one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

if TYPE_CHECKING:
    from hexsim.machine.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Scale the tank edge."""
    resolved.rows[list(legs), P.AREA_GRADIENT_TANK] *= 1.0 + values["tank_edge_ratio_change"]


EFFECT = Effect(
    name="unequal_ports",
    balance="valve",
    says="the tank edge opens faster or slower than the supply edge",
    source="manufacture; asymmetric spools for differential cylinders reach 2:1",
    parameters=(EffectParameter(name="tank_edge_ratio_change", unit="1", bounds=(-0.9, 9.0), believable=0.08),),
    apply=apply,
)
