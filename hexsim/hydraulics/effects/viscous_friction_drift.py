"""Viscous friction fades evenly while the oil warms up: times exp(-r t). Dry friction stays.

Viscosity falls by about the same share each kelvin, and viscous friction of seals goes with its root (`oil.LEG_POWERS`):
r = 0.02 /K dT/dt at 40 degC, twice that of a film of fixed thickness."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="viscous_friction_drift",
    balance="force",
    description="viscous friction fades evenly with time, dry friction stays",
    source="viscosity of ISO VG 46: 4.1 %/K at 40 degC, 5.4 %/K at 20 degC; a film in motion warms by 0.1-1 K/s",
    parameters=(
        EffectParameter(name="fading_1_s", unit="1/s", bounds=(0.0, 0.1), typical=0.01, slot=P.VISCOUS_FADING),
    ),
)
