"""Controller gain: the loop runs with (1 + r) times the declared proportional gain."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Of the controllers as they run."""
    resolved.loop_gain[list(legs)] *= 1.0 + values["relative_change"]


EFFECT = Effect(
    name="controller_gain",
    balance="controller",
    description="the position loop runs with another gain than declared",
    source="a parameter file of another machine, a card's scale: 5-30 %",
    parameters=(EffectParameter(name="relative_change", unit="1", bounds=(-0.9, 9.0), typical=0.1),),
    apply=apply,
    built_in=True,
)
