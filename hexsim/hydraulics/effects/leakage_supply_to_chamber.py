"""Leakage from the supply into the bottom chamber: q = G (Ps - P1), laminar."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="leakage_supply_to_chamber",
    balance="continuity",
    description="laminar leakage from the supply into the bottom chamber, across the valve or the piston seal",
    source="Merritt 1967; size of a real edge 2.7e-13 m3/s/Pa",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa",
            unit="m3/s/Pa",
            bounds=(0.0, 1e-9),
            typical=1.8e-12,
            slot=P.LEAK_SUPPLY_CHAMBER,
        ),
    ),
)
