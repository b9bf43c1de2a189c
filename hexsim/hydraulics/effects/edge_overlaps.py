"""Overlap of each edge of a four-way valve off its declared one; `overlap_change` is the same at all edges."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved

EDGES = {
    "supply_bottom_m": P.OVERLAP_SUPPLY,
    "tank_bottom_m": P.OVERLAP_TANK,
    "supply_top_m": P.OVERLAP_SUPPLY_TOP,
    "tank_top_m": P.OVERLAP_TANK_TOP,
}


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Each number to its place."""
    for name, place in EDGES.items():
        resolved.rows[list(legs), place] += values[name]


EFFECT = Effect(
    name="edge_overlaps",
    balance="valve",
    description="the overlaps of the valve's edges differ from the declared ones, each by its own length",
    source="Merritt 1967, 5-2; grinding to 1-5 um an edge, worn edges 10-50 um",
    parameters=tuple(
        EffectParameter(name=name, unit="m", bounds=(-1e-3, 1e-3), typical=8e-6, default=0.0) for name in EDGES
    ),
    apply=apply,
    four_way=True,
    vector=True,
)
