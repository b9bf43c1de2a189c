"""Leg zero: the leg is longer or shorter than declared at the same piston position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """As [geometry] leg_zero_offsets_m of these legs."""
    lengths = np.array(resolved.mechanics.retracted_length_m)
    lengths[list(legs)] += values["length_m"]
    resolved.mechanics = replace(resolved.mechanics, retracted_length_m=lengths)


EFFECT = Effect(
    name="leg_zero_offset",
    balance="platform",
    description="the leg is longer than declared at the same reading of its transducer",
    source="a transducer that was not zeroed with the leg, a turned rod eye: 0.2-2 mm",
    parameters=(EffectParameter(name="length_m", unit="m", bounds=(-0.2, 0.2), typical=1.0e-3),),
    apply=apply,
    places="one leg",
    kinds=("hexapod",),
    built_in=True,
)
