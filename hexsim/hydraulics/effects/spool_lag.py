"""Spool lag: the spool follows its command as a second-order system, Eq. of `valve`."""

from __future__ import annotations

import math

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Give the legs a spool state, or slow the one they have (delays add up)."""
    for leg in legs:
        row = resolved.rows[leg]
        delay = 2.0 * values["damping"] / (2.0 * math.pi * values["frequency_Hz"])
        if row[P.SPOOL_OMEGA] > 0.0:
            delay += (2.0 * row[P.SPOOL_DAMPING] or 1.0) / row[P.SPOOL_OMEGA]
        row[P.SPOOL_DAMPING] = values["damping"]
        row[P.SPOOL_OMEGA] = 2.0 * values["damping"] / delay


EFFECT = Effect(
    name="spool_lag",
    balance="valve",
    description="the spool lags behind its command",
    source="data sheets of servo and proportional valves: 20-100 Hz at the amplitude in use, damping 0.7",
    parameters=(
        EffectParameter(name="frequency_Hz", unit="Hz", bounds=(2.0, 2000.0), typical=60.0, neutral=math.inf),
        EffectParameter(name="damping", unit="1", bounds=(0.2, 3.0), typical=0.7, default=0.7),
    ),
    apply=apply,
    second_order_lag=True,
    once=True,
)
