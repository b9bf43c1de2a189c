"""Accelerometer offset: it shows a + a_0."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The shared sensor."""
    sensors = resolved.sensors
    resolved.sensors = sensors.model_copy(
        update={"acceleration_offset_m_s2": sensors.acceleration_offset_m_s2 + values["offset_m_s2"]}
    )


EFFECT = Effect(
    name="accelerometer_offset",
    balance="sensor",
    description="the accelerometer shows a constant too much",
    source="zero drift of accelerometers: 0.01-0.1 g",
    parameters=(EffectParameter(name="offset_m_s2", unit="m/s2", bounds=(-100.0, 100.0), typical=0.05),),
    apply=apply,
    places="machine",
)
