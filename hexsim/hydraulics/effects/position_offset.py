"""Position transducer: it shows y + y_0, in the loop too."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The sensors of the legs."""
    resolved.leg_sensors["position_offset_m"][list(legs)] += values["offset_m"]


EFFECT = Effect(
    name="position_offset",
    balance="sensor",
    description="the position transducer shows a constant too much",
    source="zero of transducers: 0.1-2 mm",
    parameters=(EffectParameter(name="offset_m", unit="m", bounds=(-0.2, 0.2), typical=1.0e-3),),
    apply=apply,
    places="one leg",
    kinds=("hexapod",),
)
