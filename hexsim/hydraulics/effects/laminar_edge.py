"""Laminar edge: at small openings and in cold oil the metering edges pass less than the root law, `valve`.

It holds what a declared `[valve] laminar_reynolds` holds, and adds to it.
"""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P, laminar_number
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """With the viscosity of the machine's oil at its present temperature."""
    added = laminar_number(resolved.machine, values["reynolds"], resolved.oil_temperature_degC)
    resolved.rows[list(legs), P.LAMINAR] += added


EFFECT = Effect(
    name="laminar_edge",
    balance="valve",
    description="flow through the metering edges is laminar below a Reynolds number: cold oil, small openings",
    source="Merritt 1967, 3-4: 15 of a sharp slot; Borutzky, Barnard, Thoma 2002; libraries: 12 to 150",
    parameters=(
        EffectParameter(name="reynolds", unit="1", bounds=(0.0, 1000.0), typical=15.0, adds_to=("laminar_reynolds",)),
    ),
    apply=apply,
)
