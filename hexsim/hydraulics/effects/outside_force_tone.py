"""Outside force at one frequency: F sin(2 pi f t + phase)."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="outside_force_tone",
    balance="force",
    description="an outside source shakes the load at one frequency",
    source="pumps, fans, neighbouring machines: 5-100 Hz",
    parameters=(
        EffectParameter(name="amplitude_N", unit="N", bounds=(-1e6, 1e6), typical=10.0, slot=P.TONE_FORCE),
        EffectParameter(name="frequency_Hz", unit="Hz", bounds=(0.01, 5000.0), typical=17.0, slot=P.TONE_FREQUENCY),
        EffectParameter(
            name="phase_rad",
            unit="rad",
            bounds=(-6.3, 6.3),
            typical=0.0,
            slot=P.TONE_PHASE,
            default=0.0,
            grid=(0.0, 1.5707963),
        ),
    ),
    once=True,
)
