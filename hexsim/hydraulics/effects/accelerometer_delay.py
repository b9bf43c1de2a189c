"""Accelerometer late by a delay."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The shared sensor."""
    sensors = resolved.sensors
    resolved.sensors = sensors.model_copy(
        update={"acceleration_delay_s": sensors.acceleration_delay_s + values["delay_s"]}
    )


EFFECT = Effect(
    name="accelerometer_delay",
    balance="sensor",
    description="the acceleration channel is late",
    source="filters and buses: 1-400 ms",
    parameters=(EffectParameter(name="delay_s", unit="s", bounds=(0.0, 1.0), typical=0.003),),
    apply=apply,
    places="machine",
)
