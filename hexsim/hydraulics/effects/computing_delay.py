"""Computing delay: the volts leave the motion computer that many ticks after the transducers were read."""

from __future__ import annotations

from hexsim.declaration.controller import LONGEST_DELAY_TICKS
from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Of the controllers as they run."""
    resolved.loop_delay_ticks[list(legs)] += values["delay_ticks"]


EFFECT = Effect(
    name="computing_delay",
    balance="controller",
    description="the motion computer gives its volts later than declared",
    source="buses and tasks of real-time computers: 1-3 ticks",
    parameters=(EffectParameter(name="delay_ticks", unit="1", bounds=(0.0, float(LONGEST_DELAY_TICKS)), typical=1.0),),
    apply=apply,
    built_in=True,
)
