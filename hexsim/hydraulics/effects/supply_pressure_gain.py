"""Supply pressure transducer: it shows (1 + r) Ps."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """All accelerometers."""
    sensors = resolved.sensors
    resolved.sensors = sensors.model_copy(
        update={"supply_pressure_gain": sensors.supply_pressure_gain * (1.0 + values["relative_change"])}
    )


EFFECT = Effect(
    name="supply_pressure_gain",
    balance="sensor",
    description="the supply pressure transducer shows too much or too little",
    source="transducers: 0.5-2 % of span",
    parameters=(EffectParameter(name="relative_change", unit="1", bounds=(-0.9, 9.0), typical=0.02),),
    apply=apply,
    places="machine",
)
