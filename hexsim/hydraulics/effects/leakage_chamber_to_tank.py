"""Leakage from the bottom chamber to the tank: q = G (P1 - Pt), laminar."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="leakage_chamber_to_tank",
    balance="continuity",
    description="laminar leakage from the bottom chamber to the tank",
    source="Merritt 1967; size of a real edge 2.7e-13 m3/s/Pa",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa",
            unit="m3/s/Pa",
            bounds=(0.0, 1e-9),
            typical=1.8e-12,
            slot=P.LEAK_CHAMBER_TANK,
        ),
    ),
)
