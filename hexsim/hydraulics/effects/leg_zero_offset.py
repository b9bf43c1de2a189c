"""A leg longer than its piston says: the transducer's zero, or the rod's end screwed out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Lengthen the legs of the built machine."""
    retracted = np.array(resolved.mechanics.retracted_length_m)
    retracted[list(legs)] += values["offset_m"]
    resolved.mechanics = replace(resolved.mechanics, retracted_length_m=retracted)


EFFECT = Effect(
    name="leg_zero_offset",
    balance="platform",
    description="a leg is longer than its piston's position says",
    source="zero of a transducer after mounting: 0.1-1 mm",
    parameters=(EffectParameter(name="offset_m", unit="m", bounds=(-0.1, 0.1), typical=5e-4),),
    apply=apply,
    kinds=("hexapod",),
    of_build=True,
)
