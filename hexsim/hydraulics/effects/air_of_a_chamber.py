"""Entrained air in the oil of one chamber; `entrained_air` is the same in both."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The rod side's place holds what it has beyond the bottom chamber."""
    resolved.rows[list(legs), P.AIR_FRACTION] += values["bottom_fraction"]
    resolved.rows[list(legs), P.AIR_FRACTION_TOP] += values["top_fraction"] - values["bottom_fraction"]


EFFECT = Effect(
    name="air_of_a_chamber",
    balance="continuity",
    description="free air in the oil of one chamber, or unlike in both",
    source="a chamber that was not bled: 0.5-5 %",
    parameters=(
        EffectParameter(name="bottom_fraction", unit="1", bounds=(0.0, 0.3), typical=0.01, default=0.0),
        EffectParameter(name="top_fraction", unit="1", bounds=(0.0, 0.3), typical=0.01, default=0.0),
    ),
    apply=apply,
    four_way=True,
    vector=True,
    nonlinear_response=True,
)
