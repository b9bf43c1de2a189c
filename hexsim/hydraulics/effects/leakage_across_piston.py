"""Leakage across the piston: laminar flow G (P1 - P2) past its seal, where both chambers are on the valve."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="leakage_across_piston",
    balance="continuity",
    description="laminar leakage past the piston's seal, from chamber to chamber",
    source="Merritt 1967, 6-2; worn piston rings 1e-13 to 1e-11 m3/s/Pa",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa", unit="m3/s/Pa", bounds=(0.0, 1e-8), typical=5.0e-13, slot=P.LEAK_PISTON
        ),
    ),
    four_way=True,
)
