"""The search for what a model lacks: forward by held-out log predictive density, then each must still earn its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut
from hexsim.inference.likelihood import Fit, fit
from hexsim.inference.notebook import Notebook
from hexsim.inference.remainder import (
    Forms,
    beside_form_errors,
    beside_names,
    looked_at,
    remainders,
    theta_of,
    with_open_form,
)
from hexsim.inference.verdict import Judgment, judge, needed, with_ties, without_size

Array = np.ndarray
MOST_TRIED = 9  # candidates that are fitted in a round at most


class Candidate(Protocol):
    """An effect at one place. amplitude: numbers that are 0 where it is not there. begin: where a search with it begins. memory: a
    linear look foretells less of it than it is, so all of them are fitted. place: where in the model it acts."""

    @property
    def title(self) -> str: ...
    @property
    def amplitude(self) -> Sequence[str]: ...
    @property
    def begin(self) -> dict[str, float]: ...
    @property
    def has_memory(self) -> bool: ...
    @property
    def place(self) -> str: ...


class Machine(Forms, Protocol):
    """What a search asks of a machine."""

    def candidates(self, chosen: Sequence[Any], now: Fit) -> tuple[Problem, list[tuple[Any, list[str]]]]:
        """The model with every further effect in it at amplitude 0, and each with the names of its amplitudes there."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """base: the declared model. steps: named, in order. refused: of the last round. in_model: the effects of `final`, in order: named
    ones, and those whose form is open, which stand in for what is not known and are no names. left: what they leave, a sentence."""

    base: Fit
    base_held: HeldOut
    steps: list[Judgment]
    refused: list[Judgment]
    final: Fit
    final_held: HeldOut
    in_model: list[Any] = field(default_factory=list)
    left: str = ""
    fits: list[tuple[str, Fit]] = field(default_factory=list)


def search(
    machine: Machine,
    tell: Callable[[str, float], None] = lambda what, share: None,
    most: int = 6,  # effects that are named, one after the other
    notes: Notebook | None = None,
    keep: Callable[[Found], None] = lambda found: None,
) -> Found:
    """What the machine lacks. Raises HexsimError where it cannot be run, or its motion cannot be parted.

    notes: fits of a search of the same machine that was broken off. keep: called with what is known after each round.
    """
    notes = notes or Notebook()
    tell("fitting the declared machine", 0.05)
    now, held = base, base_held = notes.attempt(machine, (), fit)
    steps: list[Judgment] = []
    refused: list[Judgment] = []
    doubted: dict[str, Judgment] = {}
    compared = 0
    fits = [("declared", base)]

    def known(judged: list[Judgment]) -> Found:
        return Found(
            base=base,
            base_held=base_held,
            steps=[step for step in steps if step.title not in doubted],
            refused=[*doubted.values(), *judged],
            final=now,
            final_held=held,
            in_model=[step.candidate for step in steps],
            fits=list(fits),
        )

    keep(known([]))
    for k in range(most):
        share = 0.1 + 0.8 * k / most
        tell(f"looking for what is missing, {k + 1}", share)
        judged, compared = one_round(
            machine,
            [step.candidate for step in steps],
            now,
            held,
            lambda what, share=share: tell(what, share),
            notes,
            compared,
            base.names,
        )
        best = next((one for one in judged if one.named), None)
        if best is None:
            refused = judged
            break
        steps.append(best)
        now, held = best.fitted, best.after
        fits.append((f"with {best.title}", now))
        keep(known([one for one in judged if one is not best]))
    steps, now, held = pruned(machine, steps, now, held, notes)
    left = remainders(machine, [step.candidate for step in steps], now) if steps else []
    no_names = (
        *without_rival(machine, steps, held, notes),
        *beside_form_errors(machine, steps, now),
        *with_open_form(steps, left),
    )
    if left:  # the terms of a balance, which its file names, may trade: that is said
        no_names = (*without_size(steps, now), *no_names)
    doubted = {one.title: one for one in no_names}
    return replace(known(refused), left=beside_names(left))


def one_round(
    machine: Machine,
    chosen: Sequence[Any],
    now: Fit,
    held: HeldOut,
    tell: Callable[[str], None],
    notes: Notebook,
    compared: int,
    declared: Collection[str],
    *,
    least_nats: float = 1.0,  # that a linear look must promise
    n_tried: int = 4,  # candidates of a round that are fitted in full, and all near the best one or a named one, at most MOST_TRIED
) -> tuple[list[Judgment], int]:
    """Candidates that were fitted in full, the best first, and how many all rounds have compared. compared: the earlier ones.
    declared: numbers of the machine's file."""
    ranked = screened(machine, chosen, now)
    compared += len(ranked)
    tell(f"{len(ranked)} candidates")
    near = ranked[0][0] - needed(compared) if ranked else 0.0
    judged = []
    for k, (promise, candidate) in enumerate(ranked):
        close = k < MOST_TRIED and promise > least_nats and (k < n_tried or promise > near)
        if not (candidate.has_memory or close):
            continue
        tell(f"trying {candidate.title}")
        try:
            fitted, after = notes.attempt(
                machine, [*chosen, candidate], lambda problem, begin=candidate.begin: fitted_with(problem, now, begin)
            )
        except HexsimError:
            continue
        judged.append(judge(candidate, candidate.title, candidate.amplitude, fitted, held, after, compared, declared))
        # what promised more and did not keep it must not hide what ties with a name
        near = min(near, promise - needed(compared)) if judged[-1].named else near
    judged.sort(key=lambda one: (not one.named, -one.nats))
    most = max((one.nats for one in judged if one.named), default=0.0)
    judged.sort(key=lambda one: (not one.named, one.count if most - one.nats < needed(one.compared) else math.inf))
    return [with_ties(one, judged) for one in judged], compared


def fitted_with(
    problem: Problem,
    now: Fit,
    begin: dict[str, float],
    *,
    most_evaluations: int = 20,  # of a candidate's fit with one spectrum: it begins near its end, or has none
) -> Fit:
    """From the numbers there are."""
    theta = theta_of(problem, now)
    names = [number.name for number in problem.numbers]
    theta[[names.index(name) for name in begin]] = list(begin.values())
    return fit(
        problem,
        begin=theta,
        spectra=now.spectra,
        evaluations=most_evaluations,
    )


def screened(machine: Machine, chosen: Sequence[Any], now: Fit) -> list[tuple[float, Any]]:
    """(nats to first order, candidate), the best first; of several tries of an effect the best one."""
    problem, found = machine.candidates(chosen, now)
    if not found:
        return []
    x, y, names = looked_at(problem, now)
    place = [names.index(name) for name in now.names]
    best: dict[str, tuple[float, Any]] = {}
    for candidate, amplitude in found:
        if any(candidate.title == one.title or same_memory(candidate, one) for one in chosen):
            continue
        own = [names.index(name) for name in amplitude]
        nats = promised(
            x[:, [*place, *own]], y, len(place), [(problem.numbers[k].low, problem.numbers[k].high) for k in own]
        )
        least = -1.0 if candidate.has_memory else 0.0
        if nats > best.get(candidate.title, (least, None))[0]:
            best[candidate.title] = (nats, candidate)
    return sorted(best.values(), key=lambda pair: -pair[0])


def same_memory(candidate: Any, one: Any) -> bool:
    """Two memories at one place cannot be told from one memory of another form: only one of them is named."""
    return candidate.has_memory and one.has_memory and candidate.place == one.place


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


def without_rival(machine: Machine, steps: Sequence[Judgment], held: HeldOut, notes: Notebook) -> list[Judgment]:
    """Steps that are no names after all: with what is tied with an earlier one in its place, motion held out is as likely without them.
    A name holds whichever of the tied ones is true."""
    doubted = []
    for k, step in enumerate(steps):
        for rival, instead in ((rival, one) for one in steps[:k] for rival in one.rivals):
            others = [rival, *(one.candidate for one in steps if one is not step and one is not instead)]
            if len({one.title for one in (*others, step.candidate)}) < len(steps):
                continue
            try:
                _, after = notes.attempt(
                    machine,
                    others,
                    lambda problem, now=instead.fitted, begin=rival.begin: fitted_with(problem, now, begin),
                )
            except HexsimError:
                continue
            if float(np.sum(held.density - after.density)) < needed(1):
                why = f"with {rival.title} in the place of {instead.title} motion is as likely without it"
                doubted.append(replace(step, verdict="likely", why=why))
                break
    return doubted


def pruned(
    machine: Machine, steps: list[Judgment], now: Fit, held: HeldOut, notes: Notebook
) -> tuple[list[Judgment], Fit, HeldOut]:
    """Without those that no longer earn their place beside what came in after them."""
    for step in list(steps[:-1]):
        others = [one.candidate for one in steps if one is not step]
        try:
            without, before = notes.attempt(machine, others, lambda problem, now=now: fitted_with(problem, now, {}))
        except HexsimError:
            continue
        if float(np.sum(held.density - before.density)) < needed(1):
            steps = [one for one in steps if one is not step]
            now, held = without, before
    return steps, now, held
