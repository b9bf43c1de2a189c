"""Pump flow limit: the line gives no more than Q_max, C dPs/dt = min((P0 - Ps)/R, Q_max) - q."""

from __future__ import annotations

import math

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import LINE, S


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """The supply becomes a state behind a line that passes at most Q_max."""
    resolved.supply[S.MODEL] = LINE
    resolved.supply[S.RESISTANCE] = values["line_resistance_Pa_s_m3"]
    resolved.supply[S.CAPACITY] = values["accumulator_m3_Pa"]
    resolved.supply[S.FLOW_MAX] = values["flow_max_m3_s"]


EFFECT = Effect(
    name="pump_flow_limit",
    balance="supply",
    description="the pump delivers no more than a largest flow; beyond it the accumulator empties",
    source="Merritt 1967, ch. 9; 2.5 kW at 70 bar is 3e-4 m3/s",
    parameters=(
        EffectParameter(name="flow_max_m3_s", unit="m3/s", bounds=(1e-7, 1.0), typical=1.0e-4, neutral=math.inf),
        EffectParameter(
            name="line_resistance_Pa_s_m3",
            unit="Pa s/m3",
            bounds=(1e6, 1e12),
            typical=3e8,
            neutral=0.0,
            default=3e8,
        ),
        EffectParameter(name="accumulator_m3_Pa", unit="m3/Pa", bounds=(1e-14, 1e-8), typical=2e-11, default=2e-11),
    ),
    apply=apply,
    places="machine",
    limit=True,
    once=True,
)
