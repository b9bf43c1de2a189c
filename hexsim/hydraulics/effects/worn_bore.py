"""The bore is worn at one place: q = G exp(-((y - y0)/w)^2) dp past the piston's seal, laminar.

dp: from chamber to chamber, or from the supply where the annulus is on it.
Wear wider than 5 cm is an even leak.
"""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved

PLACES = {"conductance_m3_s_Pa": P.WEAR_CONDUCTANCE, "place_m": P.WEAR_PLACE, "width_m": P.WEAR_WIDTH}


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One place a leg."""
    for name, place in PLACES.items():
        resolved.rows[list(legs), place] = values[name]


EFFECT = Effect(
    name="worn_bore",
    balance="continuity",
    description="the bore is worn at one place of the stroke: the piston's seal leaks as it passes",
    source="wear where a machine works most: 5-30 mm of the stroke; worn rings leak 1e-13 to 1e-11 m3/s/Pa",
    parameters=(
        EffectParameter(name="conductance_m3_s_Pa", unit="m3/s/Pa", bounds=(0.0, 1e-8), typical=1.0e-12),
        EffectParameter(name="place_m", unit="m", bounds=(0.0, 10.0), typical=0.1, default=0.1),
        EffectParameter(name="width_m", unit="m", bounds=(1e-3, 0.05), typical=0.01, default=0.01),
    ),
    apply=apply,
    once=True,
)
