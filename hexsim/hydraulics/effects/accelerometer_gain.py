"""Accelerometer gain: it shows (1 + r) a."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """All accelerometers."""
    sensors = resolved.sensors
    resolved.sensors = sensors.model_copy(
        update={"acceleration_gain": sensors.acceleration_gain * (1.0 + values["relative_change"])}
    )


EFFECT = Effect(
    name="accelerometer_gain",
    balance="sensor",
    description="the accelerometer shows too much or too little",
    source="report 2.3.1: dividing and multiplying by a sensitivity confused",
    parameters=(EffectParameter(name="relative_change", unit="1", bounds=(-0.95, 9.0), typical=0.04),),
    apply=apply,
    places="machine",
)
