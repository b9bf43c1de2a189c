"""Seal friction grows with chamber pressure: Coulomb force + k P1."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="pressure_dependent_friction",
    balance="force",
    description="the seal is pressed harder by the chamber pressure",
    source="lip seals: 1e-6 to 1e-4 N/Pa",
    parameters=(
        EffectParameter(
            name="force_per_pressure_N_Pa",
            unit="N/Pa",
            bounds=(0.0, 1.0),
            typical=1.0e-5,
            slot=P.SEAL_FRICTION,
        ),
    ),
)
