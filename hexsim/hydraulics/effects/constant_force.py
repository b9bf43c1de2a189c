"""Constant outside force along the leg, positive outwards."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="constant_force",
    balance="force",
    description="a constant outside force acts along the leg",
    source="hanging cables, springs with long travel, a tilted base",
    parameters=(EffectParameter(name="force_N", unit="N", bounds=(-1e6, 1e6), typical=40.0, slot=P.EXTRA_FORCE),),
    generic=True,
)
