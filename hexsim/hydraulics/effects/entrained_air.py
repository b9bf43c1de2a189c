"""Entrained air: softer oil at low pressure, `chamber`: free air by Boyle, adiabatic ripple."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="entrained_air",
    balance="continuity",
    description="undissolved air makes the oil softer at low pressure",
    source="Merritt 1967; Kajaste 2005; 0.5 % is the default of commercial libraries",
    parameters=(
        EffectParameter(name="volume_fraction", unit="1", bounds=(0.0, 0.3), typical=0.01, slot=P.AIR_FRACTION),
    ),
    shown_by="motion with fast pressure changes: steps of the setpoint, a sweep through the oil resonance",
    nonlinear_response=True,
)
