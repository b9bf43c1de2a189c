"""Rate limit: the spool moves no faster than a largest speed."""

from __future__ import annotations

import math

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """A spool state with limited speed; a spool without declared dynamics follows its command in first order."""
    for leg in legs:
        row = resolved.rows[leg]
        row[P.SPOOL_RATE] = values["rate_m_s"]
        if row[P.SPOOL_OMEGA] == 0.0:
            row[P.SPOOL_OMEGA] = 2.0 * math.pi * values["frequency_Hz"]
            row[P.SPOOL_DAMPING] = 0.0


EFFECT = Effect(
    name="spool_rate_limit",
    balance="valve",
    description="the spool's speed is limited",
    source="rate of a proportional valve: full stroke in 10-50 ms",
    parameters=(
        EffectParameter(name="rate_m_s", unit="m/s", bounds=(1e-5, 10.0), typical=5e-4, neutral=math.inf),
        EffectParameter(name="frequency_Hz", unit="Hz", bounds=(2.0, 2000.0), typical=250.0, default=250.0),
    ),
    apply=apply,
    limit=True,
    once=True,
)
