"""Friction settles as seals and oil warm up: all of it times 1 + a exp(-t/tau). Declared friction is that of a warm leg.

What takes longer than half a minute is a change of friction."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One exponential a leg; shares of several of one time constant add up."""
    resolved.rows[list(legs), P.FRICTION_WARM_UP] += values["share_at_start"]
    resolved.rows[list(legs), P.FRICTION_WARM_UP_TIME] = values["time_constant_s"]


EFFECT = Effect(
    name="friction_warm_up",
    balance="force",
    description="friction is larger after the start and settles as seals and oil warm up",
    source="seal friction against temperature: 0.5-2 % per K; 5-50 % from a cold start",
    parameters=(
        EffectParameter(name="share_at_start", unit="1", bounds=(-0.9, 5.0), typical=0.3),
        EffectParameter(name="time_constant_s", unit="s", bounds=(0.5, 30.0), typical=8.0, default=8.0),
    ),
    apply=apply,
)
