"""Delays of late channels, by the balances that they stand in.

A channel is moved first to where it follows its reference (`term_columns.aligned`). What else is in it shifts that: the
leakage and the compressibility beside a flow lead its speed. So the delays are then fitted together with all that the
balances may hold, every term and every candidate without a place to find,

    minimise over delays  sum over balances and runs |target - sum c_i term_i|^2 / sigma^2,   c: least squares within

(variable projection, Golub and Pereyra 1973), on the first half of each part of a run; the second halves are scored.
One delay for each run, or one for each part where that is clearly better. A run that is held out has its own delays,
with the numbers of the others. A channel that the balances do not move by three standard errors in any run stays.

Honest limit: where a candidate does the same as a delay in these runs, errors are wide and the channel stays where
correlation has put it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from hexsim.inference.verdict import needed
from hexsim.tracing import rules
from hexsim.tracing.term_columns import CLOCKS, OwnBalance, Point, RunData, run_data
from hexsim.tracing.term_selection import residual, rms, solve_physical

Array = np.ndarray
Sentences = dict[str, dict[str, str]]  # of a run and a channel


@dataclass(frozen=True, kw_only=True)
class Late:
    """An unknown delay: of a channel in one run, in some of its parts."""

    run: int
    channel: str
    parts: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Delays (n,) of `lates` [s], their standard errors, and the criterion by which two sets of unknowns are compared."""

    lates: list[Late]
    seconds: Array
    errors: Array
    criterion: float

    def moved(self, before: Array) -> set[str]:
        """Channels that are elsewhere than before by three standard errors, in some run."""
        far = np.abs(self.seconds - before) > rules.ERRORS * self.errors
        return {late.channel for late, own in zip(self.lates, far, strict=True) if own}


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Balances with what may stand in them, and runs at the samples on which channels are aligned.

    numbers: coefficients of every balance, None to fit them within.
    """

    balances: Sequence[OwnBalance]
    points: Sequence[Point]
    numbers: Sequence[Array] | None = None
    _made: dict[tuple[int, bytes], list[RunData]] = field(default_factory=dict)

    def runs(self, lates: Sequence[Late], seconds: Array) -> list[list[RunData]]:
        """Every run as every balance sees it, [run][balance]."""
        found = []
        for i, point in enumerate(self.points):
            own = [k for k, late in enumerate(lates) if late.run == i]
            key = (i, np.array([[k, seconds[k]] for k in own]).tobytes())
            if key not in self._made:
                moved = read_later(point, [lates[k] for k in own], seconds[own])
                self._made[key] = [run_data(balance, moved) for balance in self.balances]
            found.append(self._made[key])
        return found

    def rests(self, lates: Sequence[Late], seconds: Array) -> tuple[list[Array], list[Array]]:
        """Residuals and coefficients of every balance."""
        runs = self.runs(lates, seconds)
        rests, numbers = [], []
        for k, balance in enumerate(self.balances):
            mine = [run[k] for run in runs]
            own = self.numbers[k] if self.numbers is not None else solve_physical(balance, mine, balance.candidates)
            numbers.append(own)
            rests.append(np.concatenate([residual(run, own, balance.candidates) for run in mine]))
        return rests, numbers

    def squares(self, found: Fit) -> list[float]:
        """Sum of squares that every balance leaves at these delays."""
        return [max(float(np.sum(rest**2)), 1e-300) for rest in self.rests(found.lates, found.seconds)[0]]

    def fit(self, lates: Sequence[Late], start: Array) -> Fit:
        """Delays that leave least, from a start; every balance weighs by what it leaves in the end."""
        seconds = start
        for _ in range(2):
            sizes = [max(rms(rest), 1e-300) for rest in self.rests(lates, seconds)[0]]
            bounds: Any = (start - rules.LONGEST_DELAY_S, start + rules.LONGEST_DELAY_S)
            slopes: Any = self.slopes
            found = least_squares(self.weighed, seconds, slopes, bounds, args=(lates, sizes), x_scale=0.01)
            seconds = found.x
        rests = self.rests(lates, seconds)[0]
        n, k = sum(map(len, rests)), len(start)
        variance = 2.0 * found.cost / max(n - k, 1)
        errors = np.sqrt(variance * np.diag(np.linalg.pinv(found.jac.T @ found.jac)))
        errors = np.where(np.any(found.jac != 0.0, axis=0), errors, math.inf)
        likely = sum(len(rest) * math.log(max(float(np.mean(rest**2)), 1e-300)) for rest in rests)
        return Fit(lates=list(lates), seconds=seconds, errors=errors, criterion=likely + k * math.log(n))

    def weighed(self, seconds: Array, lates: Sequence[Late], sizes: Sequence[float]) -> Array:
        return np.concatenate([r / s for r, s in zip(self.rests(lates, seconds)[0], sizes, strict=True)])

    def slopes(self, seconds: Array, lates: Sequence[Late], sizes: Sequence[float]) -> Array:
        """Finite differences of `weighed` by every delay (m, n), over half a sample: over whole ones a delay passes for a rate."""
        steps = np.diag([0.5 / self.points[late.run].log.rate for late in lates])
        middle = self.weighed(seconds, lates, sizes)
        return np.column_stack([(self.weighed(seconds + step, lates, sizes) - middle) / step.max() for step in steps])


def read_later(point: Point, lates: Sequence[Late], seconds: Array) -> Point:
    """The point with channels read later by other delays."""
    shifts = {name: np.array(delay_s) for name, delay_s in point.shifts_s.items()}
    parts = np.array_split(np.arange(len(point.log.time)), CLOCKS.parts)
    for late, value in zip(lates, seconds, strict=True):
        for part in late.parts:
            shifts[late.channel][parts[part]] = value
    return replace(point, shifts_s=shifts)


def starts(points: Sequence[Point], lates: Sequence[Late]) -> Array:
    """The delays that the points have now (n,) [s]: medians over the parts of each unknown."""
    found = []
    for late in lates:
        parts = np.array_split(points[late.run].shifts_s[late.channel], CLOCKS.parts)
        found.append(np.median(np.concatenate([parts[part] for part in late.parts])))
    return np.array(found)


def holds(balance: OwnBalance, point: Point, channel: str) -> bool:
    """Does this channel stand in the balance?"""
    one, other = (run_data(balance, p) for p in (point, point.late(channel, 1.0 / point.log.rate)))
    return bool(
        np.any(one.target != other.target) or np.any(one.matrix(balance.candidates) != other.matrix(balance.candidates))
    )


def unknowns(points: Sequence[Point], channels: Collection[str], split: Collection[str] = ()) -> list[Late]:
    """Every delay of these channels to be found: of a run, or of each part for those in `split`."""
    whole = tuple(range(CLOCKS.parts))
    return [
        Late(run=i, channel=name, parts=parts)
        for i, point in enumerate(points)
        for name in point.shifts_s
        if name in channels
        for parts in ([(k,) for k in whole] if name in split else [whole])
    ]


def refined(
    balances: Sequence[OwnBalance], points: Sequence[Point], held_out: Sequence[Point], constant: Sequence[str],
    late: Sentences, signs: dict[str, list[str]],
) -> tuple[list[Point], list[Point]]:  # fmt: skip
    """Runs to fit and held out with the delays that the balances ask for; `late` says it of each run and channel, `signs` of
    each balance which candidate would take much with the other sign.

    balances: with the candidates that are fitted beside the delays. constant: channels of one delay a run.
    """
    fit, scored = ([replace(point, aligning=True) for point in some] for some in (points, held_out))
    held = [{name for point in fit for name in point.shifts_s if holds(balance, point, name)} for balance in balances]
    channels = set().union(*held)
    if not channels:
        return list(points), list(held_out)
    balances = [balance for balance, names in zip(balances, held, strict=True) if names]
    lates = unknowns(fit, channels)
    problem = Problem(balances=balances, points=fit)
    found = problem.fit(lates, starts(fit, lates))
    if split := channels - set(constant):
        finer = unknowns(fit, channels, split)
        start = [found.seconds[lates.index(replace(one, parts=tuple(range(CLOCKS.parts))))] for one in finer]
        parts = problem.fit(finer, np.array(start))
        found = parts if parts.criterion < found.criterion - 2.0 * needed(1) else found
    signs |= other_signs(problem, found)
    moved = found.moved(starts(fit, found.lates))
    if not moved:
        return list(points), list(held_out)
    lates = unknowns(scored, channels, {one.channel for one in found.lates if len(one.parts) == 1})
    if lates:
        numbers = problem.rests(found.lates, found.seconds)[1]
        alone = Problem(balances=balances, points=scored, numbers=numbers)
        held_out = told(held_out, alone.fit(lates, starts(scored, lates)), moved, late)
    return told(points, found, moved, late), list(held_out)


def other_signs(problem: Problem, found: Fit) -> dict[str, list[str]]:
    """Balance -> candidates that would take much of what it leaves if their other sign were allowed, a sentence each.

    A delay does a part of what a candidate of the wrong sign would have done, so the delays are fitted anew with each.
    """
    before, said = problem.squares(found), {}
    for k, balance in enumerate(problem.balances):
        for one in (candidate for candidate in balance.candidates if candidate.sign):
            freed = [replace(other, sign=0) if other is one else other for other in balance.candidates]
            balances = list(problem.balances)
            balances[k] = replace(balance, candidates=tuple(freed))
            trial = replace(problem, balances=balances, _made={})
            best = trial.fit(found.lates, found.seconds)
            place = len(balance.terms) + freed.index(next(own for own in freed if own.name == one.name))
            value, taken = trial.rests(best.lates, best.seconds)[1][k][place], 1.0 - trial.squares(best)[k] / before[k]
            if value * one.sign < 0.0 and taken >= rules.TELLABLE:
                shift = 1e3 * float(np.median(best.seconds - found.seconds))
                said.setdefault(balance.name, []).append(
                    f"with the other sign {one.name} would take {taken:.0%} of the residual's mean square ({value:.3g} {one.unit}, "
                    f"delays {shift:+.0f} ms): check the sign of its column"
                )
    return said


def told(points: Sequence[Point], found: Fit, moved: set[str], late: Sentences) -> list[Point]:
    """Points with these channels moved, and a sentence on each in `late`."""
    result = []
    for i, point in enumerate(points):
        own = [k for k, one in enumerate(found.lates) if one.run == i and one.channel in moved]
        before = starts([point] * (i + 1), [found.lates[k] for k in own])
        for name in dict.fromkeys(found.lates[k].channel for k in own):
            mine = [j for j, k in enumerate(own) if found.lates[k].channel == name]
            words = ", ".join(f"{1e3 * found.seconds[own[j]]:.1f} +- {1e3 * found.errors[own[j]]:.2g}" for j in mine)
            whose = " (a part of the run each)" if len(mine) > 1 else ""
            late[point.log.name][name] = (
                f"{name} of run {point.log.name} is late by {words} ms{whose}, by all that its balances may hold: moved "
                f"(by its reference alone {', '.join(f'{1e3 * before[j]:.0f}' for j in mine)} ms)"
            )
        result.append(read_later(point, [found.lates[k] for k in own], found.seconds[own]))
    return result
