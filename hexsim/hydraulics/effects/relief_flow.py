"""Flow from the bottom chamber to the tank above a threshold: q = G max(P1 - Pr, 0)."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="relief_flow",
    balance="continuity",
    description="above a pressure oil leaves the bottom chamber to the tank, as through a relief valve",
    source="Merritt 1967, 9-2; cartridge reliefs pass 1e-11 to 1e-9 m3/s/Pa beyond their setting",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa", unit="m3/s/Pa", bounds=(0.0, 1e-8), typical=1.0e-11, slot=P.RELIEF_CONDUCTANCE
        ),
        EffectParameter(
            name="opening_pressure_Pa", unit="Pa", bounds=(0.0, 1e8), typical=3.5e6, default=3.5e6, slot=P.RELIEF_OPENS
        ),
    ),
    once=True,
)
