"""Supply droop: a laminar pump line and a linear accumulator, C dPs/dt = (P0 - Ps)/R - q."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import LINE, S


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The supply becomes a state behind the line."""
    resolved.supply[S.MODEL] = LINE
    resolved.supply[S.RESISTANCE] = values["line_resistance_Pa_s_m3"]
    resolved.supply[S.CAPACITY] = values["accumulator_m3_Pa"]


EFFECT = Effect(
    name="supply_droop",
    balance="supply",
    description="the supply droops with the flow that the legs take: resistance of the pump line, accumulator behind it",
    source="report 4.3 (Ps varies with the motion); linear accumulator about its working point",
    parameters=(
        EffectParameter(name="line_resistance_Pa_s_m3", unit="Pa s/m3", bounds=(1e6, 1e12), typical=2.4e9, neutral=0.0),
        EffectParameter(name="accumulator_m3_Pa", unit="m3/Pa", bounds=(1e-14, 1e-8), typical=6e-12, default=6e-12),
    ),
    apply=apply,
    places="machine",
    once=True,
)
