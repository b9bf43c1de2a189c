"""Chamber pressure transducer: it shows P1 + P_0."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The sensors of the legs."""
    resolved.leg_sensors["pressure_offset_Pa"][list(legs)] += values["offset_Pa"]


EFFECT = Effect(
    name="pressure_offset",
    balance="sensor",
    description="the chamber pressure transducer shows a constant too much",
    source="zero drift of transducers: 0.5-2 % of span",
    parameters=(EffectParameter(name="offset_Pa", unit="Pa", bounds=(-1e8, 1e8), typical=5.0e4),),
    apply=apply,
)
