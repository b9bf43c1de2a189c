"""Hysteresis of the spool: backlash of half width h between command and spool."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="valve_hysteresis",
    balance="valve",
    description="backlash between the valve command and the spool",
    source="data sheets: 0.2-1 % of the signal with electrical feedback or dither, up to 5 % without",
    parameters=(EffectParameter(name="half_width_V", unit="V", bounds=(0.0, 5.0), typical=0.04, slot=P.HYSTERESIS),),
)
