"""Hose compliance: a capacity that does not depend on the piston's position."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="hose_compliance",
    balance="continuity",
    description="hoses and pipes give way with pressure",
    source="hose data: 1e-14 to 1e-12 m3/Pa a metre",
    parameters=(
        EffectParameter(
            name="compliance_m3_Pa",
            unit="m3/Pa",
            bounds=(0.0, 1e-9),
            typical=2.0e-14,
            slot=P.HOSE_COMPLIANCE,
        ),
    ),
    shown_by="motion with fast pressure changes: steps of the setpoint, a sweep through the oil resonance",
    term="compliance of the chamber",
    nonlinear_response=True,
)
