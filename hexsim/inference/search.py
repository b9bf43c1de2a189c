"""The search for what a model lacks: forward by held-out log predictive density, then each must still earn its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut
from hexsim.inference.likelihood import Coefficients, Fit, fit, prior_of, whitened
from hexsim.inference.notebook import Notebook
from hexsim.inference.verdict import Judgment, Remainder, judge, needed, with_open_form, with_ties

Array = np.ndarray
OWN = 1e-3  # of a column's size beside the others: below it there is nothing of its own
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


class Forms(Protocol):
    """A machine with its free forms."""

    def problem(self, chosen: Sequence[Any]) -> Problem:
        """The declared model with these effects in it."""
        ...

    def free_forms(self, chosen: Sequence[Any], now: Fit) -> Sequence[Sequence[Any]]:
        """The most general laws over the signals that each place of the model can depend on, and memories where something is chosen:
        what is left there shows in them. Each as its parts."""
        ...


class Machine(Forms, Protocol):
    """What a search asks of a machine."""

    def candidates(self, chosen: Sequence[Any], now: Fit) -> tuple[Problem, list[tuple[Any, list[str]]]]:
        """The model with every further effect in it at amplitude 0, and each with the names of its amplitudes there."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """base: the declared model. steps: named, in order. refused: of the last round. in_model: the effects of `final`, in order: named
    ones, and those whose form is open, which stand in for what is not known and are no names."""

    base: Fit
    base_held: HeldOut
    steps: list[Judgment]
    refused: list[Judgment]
    final: Fit
    final_held: HeldOut
    in_model: list[Any] = field(default_factory=list)
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
    doubted = {one.title: one for one in (*without_rival(machine, steps, held, notes), *with_open_form(steps, left))}
    return known(refused)


def one_round(
    machine: Machine,
    chosen: Sequence[Any],
    now: Fit,
    held: HeldOut,
    tell: Callable[[str], None],
    notes: Notebook,
    compared: int,
    *,
    least_nats: float = 1.0,  # that a linear look must promise
    n_tried: int = 4,  # candidates of a round that are fitted in full, and all near the best one, at most MOST_TRIED
) -> tuple[list[Judgment], int]:
    """Candidates that were fitted in full, the best first, and how many all rounds have compared. compared: the earlier ones."""
    ranked = screened(machine, chosen, now)
    compared += len(ranked)
    tell(f"{len(ranked)} candidates")
    near = ranked[0][0] - needed(compared) if ranked else 0.0
    tried = [
        one
        for k, (nats, one) in enumerate(ranked)
        if one.has_memory or (k < MOST_TRIED and nats > least_nats and (k < n_tried or nats > near))
    ]
    judged = []
    for candidate in tried:
        tell(f"trying {candidate.title}")
        try:
            fitted, after = notes.attempt(
                machine, [*chosen, candidate], lambda problem, begin=candidate.begin: fitted_with(problem, now, begin)
            )
        except HexsimError:
            continue
        judged.append(judge(candidate, candidate.title, candidate.amplitude, fitted, held, after, compared))
    judged.sort(key=lambda one: (not one.named, -one.nats))
    most = max((one.nats for one in judged if one.named), default=0.0)
    judged.sort(key=lambda one: (not one.named, one.count if most - one.nats < needed(one.compared) else math.inf))
    return [with_ties(one, judged) for one in judged], compared


def remainders(machine: Forms, chosen: Sequence[Any], now: Fit) -> list[Remainder]:
    """What each free form would take at its place beside everything that is chosen, to first order.

    Its shapes are tried from smooth to rough (Neyman 1937): a law that resembles the named one differs smoothly from it. Memories have
    no place: they open no form, for a time step that is a little too long looks like one, but reject what takes nothing beside them.
    """
    found = []
    for form in machine.free_forms(chosen, now):
        try:
            problem = machine.problem([*chosen, *form])
        except HexsimError:
            continue  # together too large to be written
        x, y, names = looked_at(problem, now)
        at = np.array([now.value(name) if name in now.names else 0.0 for name in names])
        own = np.column_stack([x[:, [names.index(name) for name in one.amplitude]] @ one.shapes for one in form])
        columns = [names.index(name) for name in now.names]
        nats = taken(x[:, columns], own, y)
        beside = {one.title: still(x, y, [names.index(name) for name in one.amplitude], at) for one in chosen}
        place = "" if form[0].has_memory else form[0].place
        found.append(Remainder(title=form[0].title, place=place, nats=nats, beside=beside))
    return found


def looked_at(problem: Problem, now: Fit, at: Sequence[int] | None = None) -> tuple[Array, Array, list[str]]:
    """Slopes and residual of unit variance at the numbers there are, priors below them; names of the columns. at: stretches, default
    all."""
    known = dict(zip(now.names, (float(value) for value in now.theta), strict=True))
    theta = np.array([known.get(number.name, number.start) for number in problem.numbers])
    rest, slopes = whitened(
        Coefficients(problem, range(len(problem.stretches)) if at is None else at), theta, now.spectra
    )
    mean, precision = prior_of(problem.numbers)
    x, y = np.vstack([slopes, np.diag(precision)]), np.concatenate([rest, (theta - mean) * precision])
    return x, y, [number.name for number in problem.numbers]


def taken(base: Array, own: Array, y: Array) -> dict[int, float]:
    """Nats that the first 1, 2, 4 ... columns of `own` take of y beside `base`; columns that have nothing of their own are left out."""
    beside = own - base @ np.linalg.lstsq(base, own, rcond=1e-10)[0]
    size, whole = np.linalg.norm(own, axis=0), np.zeros((len(y), 0))
    for j in range(own.shape[1]):
        column = beside[:, j] - whole @ (whole.T @ beside[:, j])
        left = float(np.linalg.norm(column))
        if left > OWN * size[j]:
            whole = np.column_stack([whole, column / left])
    nats = 0.5 * np.cumsum((whole.T @ y) ** 2)
    return {m: float(nats[m - 1]) for k in range(len(nats)) if (m := min(2**k, len(nats)))}


def fitted_with(
    problem: Problem,
    now: Fit,
    begin: dict[str, float],
    *,
    most_evaluations: int = 20,  # of a candidate's fit with one spectrum: it begins near its end, or has none
) -> Fit:
    """From the numbers there are."""
    known = dict(zip(now.names, (float(value) for value in now.theta), strict=True)) | begin
    return fit(
        problem,
        begin=np.array([known.get(number.name, number.start) for number in problem.numbers]),
        spectra=now.spectra,
        evaluations=most_evaluations,
    )


def still(x: Array, y: Array, own: Sequence[int], at: Array) -> float:
    """Nats of the numbers `own` where all numbers are fitted anew, to first order about `at` (Wald 1943); 0 for one without a size."""
    if not own:
        return 0.0
    size = np.linalg.norm(x, axis=0)
    size = np.where(size > 0, size, 1.0)
    covariance = np.linalg.pinv((x / size).T @ (x / size), hermitian=True, rcond=1e-10)
    value = (at * size - covariance @ ((x / size).T @ y))[list(own)]
    return 0.5 * float(value @ np.linalg.pinv(covariance[np.ix_(own, own)], hermitian=True) @ value)


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
