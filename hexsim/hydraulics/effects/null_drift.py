"""Null drift: the valve's null moves at a constant rate (warming oil)."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="null_drift",
    balance="valve",
    description="the valve's null drifts with time",
    source="data sheets: 2 % of rated signal over 40 K",
    parameters=(EffectParameter(name="drift_V_s", unit="V/s", bounds=(-1.0, 1.0), typical=0.003, slot=P.NULL_DRIFT),),
)
