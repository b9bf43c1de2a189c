"""Position transducer: it shows (1 + r) y."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The sensors of the legs."""
    resolved.leg_sensors["position_gain"][list(legs)] *= 1.0 + values["relative_change"]


EFFECT = Effect(
    name="position_gain",
    balance="sensor",
    description="the position transducer shows too much or too little",
    source="scale error of transducers: 0.1-1 %",
    parameters=(EffectParameter(name="relative_change", unit="1", bounds=(-0.9, 9.0), typical=0.01),),
    apply=apply,
)
