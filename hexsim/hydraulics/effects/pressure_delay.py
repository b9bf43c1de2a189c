"""Chamber pressure channel late by a delay."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The sensors of the legs."""
    resolved.leg_sensors["pressure_delay_s"][list(legs)] += values["delay_s"]


EFFECT = Effect(
    name="pressure_delay",
    balance="sensor",
    description="the chamber pressure channel is late",
    source="filters and buses: 1-400 ms",
    parameters=(EffectParameter(name="delay_s", unit="s", bounds=(0.0, 1.0), typical=0.003),),
    apply=apply,
)
