"""A candidate against the model without it: named, likely or refused, with the numbers that decide."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from hexsim.inference.held_out import HeldOut, mean_over_error
from hexsim.inference.likelihood import Fit

Array = np.ndarray


class Gates(NamedTuple):
    """Odds and standard errors that decide between named, likely and refused."""

    chance: float = 0.02  # that the best of the candidates compared gains so much by chance
    fall: float = 1.0  # block errors by which the held-out error must fall
    growth: float = 2.0  # block errors by which no channel's may grow
    end: float = 1e-3  # of a number's scale: at an end of its interval
    at: float = 2.0  # errors within which a number cannot be told from a value
    # spreads over bands and stretches that one amplitude must have: else it is as much another one as itself
    sure: float = 1.0
    # of what an effect does, one standard deviation of the error of its form: at three it would change its sign
    form: float = 1.0 / 3.0


GATES = Gates()


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgment:
    """title: of the candidate. nats: gain of the log predictive density on held-out motion, by group in `gains`. errors: channel ->
    (rms before, rms after, t of the fall over blocks), held out. tied: others, with the odds against them; rivals: the same as
    candidates."""

    candidate: Any
    title: str
    count: int
    compared: int
    fitted: Fit
    after: HeldOut
    gains: Array
    errors: dict[str, tuple[float, float, float]]
    verdict: str
    why: str
    tied: list[str] = field(default_factory=list)
    rivals: list[Any] = field(default_factory=list)

    @property
    def nats(self) -> float:
        return float(self.gains.sum())

    @property
    def chance(self) -> float:
        """That this gain comes by chance: candidates that were compared, by odds."""
        return min(self.compared * math.exp(-max(self.nats, 0.0)), 1.0)

    @property
    def named(self) -> bool:
        return self.verdict == "named"


def judge(
    candidate: Any,
    title: str,
    amplitude: Sequence[str],
    fitted: Fit,
    before: HeldOut,
    after: HeldOut,
    tried: int,
    declared: Collection[str] | None = None,
) -> Judgment:
    """tried: candidates that were compared. amplitude: numbers that are 0 where the effect is not there (none: it has no size).
    declared: numbers of the machine's file, none of which it may take the place of (None: all that there are). Earlier effects are
    taken out where they no longer earn their place."""
    gains = after.density - before.density
    errors = errors_of(before, after)
    unsure = stand_in(fitted, amplitude) or replaced(fitted, before.fits, declared)
    verdict, why = said(gains, errors, unsure, needed(tried))
    numbers = len(of_machine(fitted)) - len(of_machine(before.fits[0]))
    return Judgment(
        candidate=candidate,
        title=title,
        count=numbers,
        compared=tried,
        fitted=fitted,
        after=after,
        gains=gains,
        errors=errors,
        verdict=verdict,
        why=why,
    )


def errors_of(before: HeldOut, after: HeldOut) -> dict[str, tuple[float, float, float]]:
    """Channel -> (rms before, rms after, t of the fall over blocks)."""
    return {
        name: (before.rms(c), after.rms(c), mean_over_error(before.losses(c) - after.losses(c)))
        for c, name in enumerate(after.problem.channels)
        if len(after.losses(c))
    }


def of_machine(fitted: Fit) -> list[str]:
    """Numbers that are not of a run or of how it begins."""
    return [number.name for number in fitted.problem.numbers if not number.local]


def needed(compared: int) -> float:
    """Gain [nats] that the best of so many candidates has by chance with odds chance, one number more each."""
    return math.log(max(compared, 1) / GATES.chance)


def said(gains: Array, errors: dict[str, tuple[float, float, float]], unsure: str, needed: float) -> tuple[str, str]:
    """(verdict, why)."""
    nats = float(gains.sum())
    best = max(errors, key=lambda name: errors[name][2])
    fall = 1.0 - errors[best][1] / errors[best][0] if errors[best][0] > 0 else 0.0
    worse = [name for name, (_, _, t) in errors.items() if t < -GATES.growth]
    if nats <= 0.0:
        return "refused", f"held-out motion is {-nats:.1f} nats less likely with it"
    if worse:
        return (
            "likely",
            f"the held-out error of {worse[0]} grows beyond its block error: {errors[worse[0]][0]:.3g} -> {errors[worse[0]][1]:.3g}",
        )
    if nats < needed:
        return "likely", f"gain of {nats:.1f} nats, {needed:.1f} are needed"
    if nats - float(gains.max()) <= 0.0:
        return "likely", "the gain comes from one part of the motion only"
    if errors[best][2] < GATES.fall:
        change = f"{'falls' if fall >= 0.0 else 'grows'} by {100 * abs(fall):.1f} %"
        return "likely", f"the held-out error {change}, which is within its block error"
    if unsure:
        return "likely", unsure
    return "named", f"held-out error falls by {100 * fall:.0f} %"


def stand_in(fitted: Fit, amplitude: Sequence[str]) -> str:
    """Why an effect is another one from band to band or run to run: no amplitude of it is sure errors from 0, with its spread in them."""
    unsure = ""
    for name in amplitude:
        i = fitted.names.index(name)
        if abs(fitted.theta[i]) > GATES.sure * fitted.spread[i]:
            return ""
        apart = f"{fitted.spread[i]:.2g} ({fitted.theta[i]:.3g} on the whole)"
        unsure = f"{name} differs between bands or runs by {apart}: a stand-in for something else"
    return unsure


def without_size(steps: Sequence[Judgment], final: Fit) -> list[Judgment]:
    """Steps that are no names after all: in the final model none of their amplitudes can be told from 0. Before it, what is still missing
    spreads them."""
    doubted = []
    for step in steps:
        sizes = [(name, final.value(name), final.error(name)) for name in step.candidate.amplitude]
        if sizes and all(abs(value) < GATES.at * error for _, value, error in sizes):
            name, value, error = sizes[0]
            why = f"{name} cannot be told from 0: {value:.3g} +- {error:.2g} over bands and runs, a stand-in"
            doubted.append(replace(step, verdict="likely", why=why))
    return doubted


def replaced(fitted: Fit, before: Sequence[Fit], declared: Collection[str] | None = None) -> str:
    """Which declared number goes to an end of its interval with the effect, and did not without: two names of one term."""
    ended = at_end(fitted) & set(before[0].names if declared is None else declared)
    taken = sorted(ended - set().union(*(at_end(one) for one in before)))
    return f"it takes the place of {taken[0]}, which goes to an end of its interval" if taken else ""


def at_end(fitted: Fit) -> set[str]:
    """Numbers at an end of their interval: nearer than end of a typical change."""
    return {
        number.name
        for number, x in zip(fitted.problem.numbers, fitted.theta, strict=True)
        if min(x - number.low, number.high - x) < GATES.end * number.scale
    }


def with_ties(one: Judgment, judged: Sequence[Judgment]) -> Judgment:
    """Others that are not less likely with odds of 1 to 1 / chance, even where something else speaks against their names."""
    near = [
        other
        for other in judged
        if other is not one and one.named and one.nats - other.nats < needed(1) and not comes_to(other, one)
    ]
    tied = [f"{other.title}, odds 1 to {math.exp(max(one.nats - other.nats, 0.0)):.1f}" for other in near]
    return replace(one, tied=tied, rivals=[other.candidate for other in near])


def comes_to(other: Judgment, one: Judgment) -> bool:
    """Does the other one have more numbers, one of which cannot be told from an end of its interval, or one of several amplitudes from 0?
    It is the simpler one there."""
    numbers = zip(other.fitted.problem.numbers, other.fitted.theta, other.fitted.errors, strict=True)
    several = other.candidate.amplitude if len(other.candidate.amplitude) > 1 else ()
    return other.count > one.count and any(
        number.name not in one.fitted.names
        and min(x - number.low, number.high - x, abs(x) if number.name in several else math.inf) < GATES.at * error
        for number, x, error in numbers
    )


def changing(fitted: Fit) -> list[str]:
    """Numbers of the model that are not the same in all bands and stretches, a sentence each: a sign that something else is missing."""
    found = []
    for name, value, spread, variance in zip(
        fitted.names, fitted.theta, fitted.spread, np.diag(fitted.covariance), strict=True
    ):
        if spread > max(3.0 * math.sqrt(max(variance, 0.0)), 0.1 * abs(value)):
            found.append(
                f"{name} is not the same in all bands and stretches of motion: {value:.4g}, differing by {spread:.2g}"
            )
    return found
