"""Position channel late by a delay, in the loop too."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The sensors of the legs."""
    resolved.leg_sensors["position_delay_s"][list(legs)] += values["delay_s"]


EFFECT = Effect(
    name="position_delay",
    balance="sensor",
    description="the position channel is late",
    source="filters and buses: 1-10 ms",
    parameters=(EffectParameter(name="delay_s", unit="s", bounds=(0.0, 1.0), typical=0.003),),
    apply=apply,
)
