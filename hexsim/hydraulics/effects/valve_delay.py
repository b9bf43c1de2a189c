"""Delay between the command and the spool's electronics."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="valve_delay",
    balance="valve",
    description="the command reaches the valve late",
    source="communication and amplifier: 1-10 ms",
    parameters=(EffectParameter(name="delay_s", unit="s", bounds=(0.0, 0.5), typical=0.004, slot=P.VALVE_DELAY),),
)
