"""Gas accumulator behind the pump line: C(Ps) dPs/dt = (P0 - Ps)/R - q,  C = V_gas/(n P_abs),  V_gas P_abs^(1/n) constant."""

from __future__ import annotations

import math

from hexsim.declaration import ATMOSPHERE_Pa
from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import LINE, S


def apply(
    resolved: Resolved,
    legs: tuple[int, ...],
    values: dict[str, float],
    *,
    least_share: float = 0.2,  # of the nominal pressure (absolute): precharge, below which the gas is shut off
) -> None:
    """The supply becomes a state behind the line, with the gas volume given at the nominal pressure."""
    row, exponent = resolved.supply, values["polytropic_exponent"]
    row[S.MODEL] = LINE
    row[S.RESISTANCE] = values["line_resistance_Pa_s_m3"]
    row[S.EXPONENT] = exponent
    row[S.PRECHARGE] = least_share * (row[S.PRESSURE] + ATMOSPHERE_Pa)
    row[S.GAS_VOLUME] = values["gas_volume_m3"] * least_share ** (-1.0 / exponent)


EFFECT = Effect(
    name="gas_accumulator",
    balance="supply",
    description="the supply lives on a gas accumulator behind the pump line; the gas grows softer as it empties",
    source="report 2.2.2; polytropic gas, n = 1 (slow) to 1.4 (fast)",
    parameters=(
        EffectParameter(
            name="gas_volume_m3", unit="m3", bounds=(1e-7, 1.0), typical=4e-4, neutral=math.inf, default=4e-4
        ),
        EffectParameter(name="line_resistance_Pa_s_m3", unit="Pa s/m3", bounds=(1e6, 1e12), typical=5e9, default=5e9),
        EffectParameter(name="polytropic_exponent", unit="1", bounds=(1.0, 1.4), typical=1.2, default=1.2),
    ),
    apply=apply,
    places="machine",
    once=True,
)
