"""Spring between load and base that hardens: F = -k (y - half stroke)^3."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="hardening_spring",
    balance="force",
    description="a spring between the load and the base grows stiffer with its travel",
    source="bellows, hoses and cables near their ends: 10-300 N at 0.1 m",
    parameters=(
        EffectParameter(name="stiffness_N_m3", unit="N/m3", bounds=(-1e10, 1e10), typical=2.0e5, slot=P.HARDENING),
    ),
)
