"""Clearance leakage around null: laminar flow across both closed lands, G dp / (1 + (O - x)/l)."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="clearance_leakage",
    balance="continuity",
    description="laminar leakage across the radial clearance of the valve's lands, largest around null",
    source="Merritt 1967, 5-4; Eryilmaz and Wilson 2006",
    parameters=(
        EffectParameter(
            name="conductance_m3_s_Pa",
            unit="m3/s/Pa",
            bounds=(0.0, 1e-9),
            typical=2.0e-12,
            slot=P.CLEARANCE_CONDUCTANCE,
        ),
    ),
)
