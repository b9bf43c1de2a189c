"""Spring between load and base, neutral at half stroke."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="spring",
    balance="force",
    description="a spring acts between the load and the base",
    source="umbilicals and bellows: 100-2000 N/m",
    parameters=(
        EffectParameter(name="stiffness_N_m", unit="N/m", bounds=(-1e8, 1e8), typical=600.0, slot=P.EXTRA_SPRING),
    ),
)
