"""The search for what a model lacks: forward by held-out log predictive density, then each must still earn its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut, held_out
from hexsim.inference.likelihood import Coefficients, Fit, fit, prior_of, whitened
from hexsim.inference.verdict import Judgment, held_against, judge, needed, whose_form_is_open, with_ties

Array = np.ndarray
MOST_EFFECTS = 6  # named, one after the other
EVALUATIONS = 20  # of a candidate's fit with one spectrum: it begins near its end, or has none
LEAST = 1.0  # nats that a linear look must promise
RIVALS = 2  # free curves that are fitted
TRIED = 4  # candidates of a round that are fitted in full, and all near the best one, at most MOST_TRIED
MOST_TRIED = 9


class Candidate(Protocol):
    """An effect at one place. amplitude: numbers that are 0 where it is not there. begin: where a search with it begins. memory: a
    linear look foretells less of it than it is. rival: a free curve over some signal, against which effects are held: no name."""

    @property
    def title(self) -> str: ...
    @property
    def amplitude(self) -> Sequence[str]: ...
    @property
    def begin(self) -> dict[str, float]: ...
    @property
    def has_memory(self) -> bool: ...
    @property
    def rival(self) -> bool: ...


class Machine(Protocol):
    """What a search asks of a machine."""

    def problem(self, chosen: Sequence[Any]) -> Problem:
        """The declared model with these effects in it."""
        ...

    def candidates(self, chosen: Sequence[Any], now: Fit) -> tuple[Problem, list[tuple[Any, list[str]]]]:
        """The model with every further effect in it at amplitude 0, and each with the names of its amplitudes there."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """base: the declared model. steps: named, in order. refused: of the last round. final: with all that is named."""

    base: Fit
    base_held: HeldOut
    steps: list[Judgment]
    refused: list[Judgment]
    final: Fit
    final_held: HeldOut
    fits: list[tuple[str, Fit]] = field(default_factory=list)


def search(
    machine: Machine, tell: Callable[[str, float], None] = lambda what, share: None, most: int = MOST_EFFECTS
) -> Found:
    """What the machine lacks. Raises HexsimError where it cannot be run, or its motion cannot be parted."""
    tell("fitting the declared machine", 0.05)
    now = base = fit(machine.problem(()))
    held = base_held = held_out(base)
    steps: list[Judgment] = []
    refused: list[Judgment] = []
    doubted: list[Judgment] = []
    fits = [("declared", base)]
    for k in range(most):
        share = 0.1 + 0.8 * k / most
        tell(f"looking for what is missing, {k + 1}", share)
        judged, rivals = one_round(
            machine, [step.candidate for step in steps], now, held, lambda what, share=share: tell(what, share)
        )
        best = next((one for one in judged if one.named), None)
        if best is None:
            refused = judged
            doubted = whose_form_is_open(steps, rivals)
            break
        steps.append(best)
        now, held = best.fitted, best.after
        fits.append((f"with {best.title}", now))
    steps, now, held = pruned(machine, steps, now, held)
    titles = [one.title for one in doubted]
    if any(step.title in titles for step in steps):
        steps = [step for step in steps if step.title not in titles]
        now = fitted_with(machine.problem([step.candidate for step in steps]), base, {})
        held = held_out(now)
        refused = [*doubted, *refused]
    return Found(base=base, base_held=base_held, steps=steps, refused=refused, final=now, final_held=held, fits=fits)


def one_round(
    machine: Machine, chosen: Sequence[Any], now: Fit, held: HeldOut, tell: Callable[[str], None]
) -> tuple[list[Judgment], list[Judgment]]:
    """Candidates that were fitted in full, the best first, and free curves."""
    every = screened(machine, chosen, now)
    ranked, rivals = ([pair for pair in every if pair[1].rival is rival] for rival in (False, True))
    tell(f"{len(ranked)} candidates")
    memories = [one for _, one in ranked if one.has_memory][:1]
    near = ranked[0][0] - needed(len(ranked)) if ranked else 0.0
    tried = [
        one for k, (nats, one) in enumerate(ranked[:MOST_TRIED])
        if nats > LEAST and (k < TRIED or nats > near)
    ]  # fmt: skip
    tried += [one for one in memories if one not in tried]

    def judged_of(candidates: Sequence[Any]) -> list[Judgment]:
        found = []
        for candidate in candidates:
            tell(f"trying {candidate.title}")
            try:
                after = fitted_with(machine.problem([*chosen, candidate]), now, candidate.begin)
                found.append(
                    judge(candidate, candidate.title, candidate.amplitude, after, held, held_out(after), len(ranked))
                )
            except HexsimError:
                continue
        return found

    judged = judged_of(tried)
    against: list[Judgment] = []
    if chosen or any(one.named for one in judged):
        against = judged_of([one for _, one in rivals[:RIVALS]])
        judged = [held_against(one, against) for one in judged]
    judged.sort(key=lambda one: (not one.named, -one.nats))
    most = max((one.nats for one in judged if one.named), default=0.0)
    judged.sort(key=lambda one: (not one.named, one.count if most - one.nats < needed(one.compared) else math.inf))
    return [with_ties(one, judged) for one in judged], against


def fitted_with(problem: Problem, now: Fit, begin: dict[str, float]) -> Fit:
    """From the numbers there are."""
    known = dict(zip(now.names, (float(value) for value in now.theta), strict=True)) | begin
    return fit(problem, begin=np.array([known.get(number.name, number.start) for number in problem.numbers]), spectra=now.spectra,
               evaluations=EVALUATIONS)  # fmt: skip


def screened(machine: Machine, chosen: Sequence[Any], now: Fit) -> list[tuple[float, Any]]:
    """(nats to first order, candidate), the best first; of several tries of an effect the best one."""
    problem, found = machine.candidates(chosen, now)
    if not found:
        return []
    known = dict(zip(now.names, (float(value) for value in now.theta), strict=True))
    theta = np.array([known.get(number.name, number.start) for number in problem.numbers])
    names = [number.name for number in problem.numbers]
    data = Coefficients(problem, range(len(problem.stretches)))
    rest, slopes = whitened(data, theta, now.spectra)
    mean, precision = prior_of(problem.numbers)
    place = [names.index(name) for name in now.names]
    best: dict[str, tuple[float, Any]] = {}
    for candidate, amplitude in found:
        if any(candidate.title == one.title for one in chosen):
            continue
        own = [names.index(name) for name in amplitude]
        columns = [*place, *own]
        x = np.vstack([slopes[:, columns], np.diag(precision[columns])])
        y = np.concatenate([rest, ((theta - mean) * precision)[columns]])
        nats = promised(x, y, len(place), [(problem.numbers[k].low, problem.numbers[k].high) for k in own])
        if nats > best.get(candidate.title, (0.0, None))[0]:
            best[candidate.title] = (nats, candidate)
    return sorted(best.values(), key=lambda pair: -pair[0])


def promised(x: Array, y: Array, count: int, bounds: Sequence[tuple[float, float]]) -> float:
    """Fall of half the sum of squares by the columns after the first `count`; 0 where one amplitude would leave its side."""
    size = np.linalg.norm(x, axis=0)
    if not np.isfinite(size).all() or not size[count:].any():
        return 0.0
    scaled = x / np.where(size > 0, size, 1.0)
    inner, right = scaled.T @ scaled, -scaled.T @ y
    with_it = np.linalg.lstsq(inner, right, rcond=1e-10)[0]
    without = np.linalg.lstsq(inner[:count, :count], right[:count], rcond=1e-10)[0]
    low, high = bounds[0]
    if len(bounds) == 1 and ((low >= 0 and with_it[-1] < 0) or (high <= 0 and with_it[-1] > 0)):
        return 0.0
    return 0.5 * float(with_it @ right - without @ right[:count])


def pruned(machine: Machine, steps: list[Judgment], now: Fit, held: HeldOut) -> tuple[list[Judgment], Fit, HeldOut]:
    """Without those that no longer earn their place beside what came in after them."""
    for step in list(steps[:-1]):
        others = [one.candidate for one in steps if one is not step]
        try:
            without = fitted_with(machine.problem(others), now, {})
            before = held_out(without)
        except HexsimError:
            continue
        if float(np.sum(held.density - before.density)) < needed(1):
            steps = [one for one in steps if one is not step]
            now, held = without, before
    return steps, now, held
