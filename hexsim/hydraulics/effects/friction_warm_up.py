"""Friction settles as seals and oil warm up: all of it times (1 + a exp(-t/tau)) / (1 + a c).

c says of which machine the declared friction is: 0 of a warm one, 1 of a cold one. a is a share of the warm friction either way.
What takes longer than half a minute is a change of friction. A cold seal rubs at most twice as much as a warm one: 2 % a
kelvin, 50 K."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One exponential a leg; shares of several of one time constant add up."""
    own, share = list(legs), values["share_at_start"]
    settled = 1.0 / (1.0 + share * values["declared_cold"])
    resolved.rows[own, P.FRICTION_WARM_UP] += share * settled
    resolved.rows[own, P.FRICTION_SETTLED] += settled - 1.0
    resolved.rows[own, P.FRICTION_WARM_UP_TIME] = values["time_constant_s"]


EFFECT = Effect(
    name="friction_warm_up",
    balance="force",
    description="friction is larger after the start and settles as seals and oil warm up",
    source="seal friction against temperature: 0.5-2 % per K; 5-50 % from a cold start",
    parameters=(
        EffectParameter(name="share_at_start", unit="1", bounds=(0.0, 1.0), typical=0.3),
        EffectParameter(name="time_constant_s", unit="s", bounds=(0.5, 30.0), typical=8.0, default=8.0),
        EffectParameter(
            name="declared_cold",
            unit="1",
            bounds=(0.0, 1.0),
            typical=0.0,
            default=0.0,
            grid=(0.0, 1.0),
            step_share=20.0,
            of_the_file=True,
        ),
    ),
    apply=apply,
    once=True,
)
