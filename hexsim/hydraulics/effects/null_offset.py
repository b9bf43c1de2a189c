"""Null offset: the spool is centred at u_0 volts."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="null_offset",
    balance="valve",
    description="the valve's null is off by a constant voltage",
    source="common in servo valve data sheets: up to 2 % of rated signal",
    parameters=(EffectParameter(name="offset_V", unit="V", bounds=(-5.0, 5.0), typical=0.05, slot=P.NULL_OFFSET),),
)
