"""Leakage past the rod's seal: laminar flow G (P2 - Pt) out of the rod side."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="rod_seal_leakage",
    balance="continuity",
    description="laminar leakage from the rod side past the rod's seal",
    source="Merritt 1967, 6-2",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa", unit="m3/s/Pa", bounds=(0.0, 1e-8), typical=5.0e-13, slot=P.LEAK_TOP_TANK
        ),
    ),
    four_way=True,
)
