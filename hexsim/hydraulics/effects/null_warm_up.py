"""The spool's null settles as the valve warms up: V0 (1 - exp(-t/tau)). One slower than a minute is a null drift."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One exponential a leg."""
    resolved.rows[list(legs), P.NULL_WARM_UP] = values["offset_V"]
    resolved.rows[list(legs), P.NULL_WARM_UP_TIME] = values["time_constant_s"]


EFFECT = Effect(
    name="null_warm_up",
    balance="valve",
    description="the valve's null shifts while it warms up, and settles",
    source="null shift with temperature: 1-3 % of rated signal over 40 K (servo valve data sheets)",
    parameters=(
        EffectParameter(name="offset_V", unit="V", bounds=(-10.0, 10.0), typical=0.05),
        EffectParameter(name="time_constant_s", unit="s", bounds=(0.5, 60.0), typical=8.0, default=8.0),
    ),
    apply=apply,
    once=True,
)
