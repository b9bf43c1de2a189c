"""Dead volume: more oil beside the piston's stroke than declared."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="dead_volume",
    balance="continuity",
    description="the chamber holds more oil than declared",
    source="manifolds and pipes: 1e-5 to 1e-4 m3",
    parameters=(
        EffectParameter(name="volume_m3", unit="m3", bounds=(0.0, 0.1), typical=3.0e-5, slot=P.PIPELINE_VOLUME),
    ),
    shown_by="motion with fast pressure changes: steps of the setpoint, a sweep through the oil resonance",
    term="compliance of the chamber",
    nonlinear_response=True,
)
