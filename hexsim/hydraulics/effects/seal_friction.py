"""Seals of a cylinder with both chambers on the valve: Coulomb force + k1 P1 + k2 P2 + k |P1 - P2|."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved

SEALS = {
    "across_piston_N_Pa": P.SEAL_FRICTION_ACROSS,
    "rod_side_N_Pa": P.SEAL_FRICTION_TOP,
    "bottom_N_Pa": P.SEAL_FRICTION,
}


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Each number to its place."""
    for name, place in SEALS.items():
        resolved.rows[list(legs), place] += values[name]


EFFECT = Effect(
    name="seal_friction",
    balance="force",
    description="the seals are pressed harder by the pressures of both chambers, the piston's by their difference",
    source="lip seals: 1e-6 to 1e-4 N/Pa",
    parameters=tuple(
        EffectParameter(name=name, unit="N/Pa", bounds=(0.0, 1.0), typical=1.0e-5, default=0.0) for name in SEALS
    ),
    apply=apply,
    four_way=True,
    vector=True,
)
