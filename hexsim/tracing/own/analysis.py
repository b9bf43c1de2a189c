"""One balance traced, and what stands beside its verdict: remarks, held-out runs, what would have been seen, what remains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.inference.notebook import Notebook
from hexsim.inference.verdict import GATES
from hexsim.tracing import rules
from hexsim.tracing.own.events import Event, events, said
from hexsim.tracing.own.folder import OwnMachine
from hexsim.tracing.term_columns import OwnBalance, Point, RunData, outside, run_data
from hexsim.tracing.term_regression import OwnVerdict, numbers, trace_own
from hexsim.tracing.term_selection import Chosen, best_placed, losses_of, placed, residual, rms, solve

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnTrace:
    """Verdict of one balance, and what stands beside it.

    remarks: numbers far from their declaration, runs that a refit makes worse. held_out: run -> rms declared, refit,
    with_terms. detectable: candidate -> (size, unit). extremes: where the rest is not as elsewhere, a sentence each.
    rests: run -> (time, residual without and with the terms), every sample under the window. events: run -> events.
    spread: signal -> (its samples, the rest) of all runs.
    """

    balance: OwnBalance
    verdict: OwnVerdict
    remarks: list[str]
    held_out: dict[str, dict[str, float]]
    detectable: dict[str, tuple[float, str]]
    extremes: list[str]
    rests: dict[str, tuple[Array, Array, Array, Array]]
    events: dict[str, list[Event]]
    spread: dict[str, tuple[Array, Array]]


def trace_balance(balance: OwnBalance, machine: OwnMachine, notes: Notebook | None = None) -> OwnTrace:
    """The verdict, then the held-out runs with the final numbers, and what remains."""
    verdict = trace_own(balance, machine.fit, notes)
    runs = [run_data(balance, point) for point in machine.fit]
    scored = [run_data(balance, point) for point in machine.validate]
    terms = verdict.terms
    declared = np.array([term.declared or 0.0 for term in balance.terms])
    plain, final = solve(balance, runs, ()), solve(balance, runs, terms)
    held_out = {
        run.name: {
            "declared": rms(residual(run, declared, ())),
            "refit": rms(residual(run, plain, ())),
            "with_terms": rms(residual(run, final, terms)),
        }
        for run in scored
    }
    points = machine.validate or whole_runs(machine.fit)
    rests = {point.log.name: rest_of(balance, point, plain, final, terms) for point in points}
    left = [residual(run, final, terms) for run in runs]
    shared = set.intersection(*(set(run.signals) for run in runs))
    rest = np.concatenate(left)
    spread = {name: (np.concatenate([run.signals[name] for run in runs]), rest) for name in sorted(shared)}
    found = {name: events(t, after, points[0].window.half) for name, (t, _, _, after) in rests.items()}
    signs = list(machine.signs.get(balance.name, []))  # beside other delays; what stands there is not said twice
    known = {one.partition(" would take")[0] for one in signs}
    signs += [one for one in other_signs(balance, runs, terms) if one.partition(" would take")[0] not in known]
    return OwnTrace(
        balance=balance, verdict=verdict, remarks=remarks_of(balance, verdict, held_out) + signs + traded(balance, runs, verdict),
        held_out=held_out,
        detectable=detectable(balance, runs, terms, verdict), rests=rests, events=found,
        extremes=extremes(runs, left), spread=spread,
    )  # fmt: skip


def whole_runs(points: Sequence[Point]) -> list[Point]:
    """Each run once, uncut."""
    return list({id(point.log.columns): replace(point, rows=None) for point in points}.values())


def rest_of(
    balance: OwnBalance, point: Point, plain: Array, final: Array, terms: Chosen
) -> tuple[Array, Array, Array, Array]:
    """(time, target, residual refitted, residual with the terms) of every sample under whole windows."""
    n, half = len(point.log.time), point.window.half
    target = np.broadcast_to(balance.target(point), (n,))
    columns = [np.broadcast_to(term.column(point), (n,)) for term in balance.terms]
    added = [np.broadcast_to(term.column(point), (n,)) for term in terms]
    before = target - sum((c * x for c, x in zip(plain, columns, strict=True)), np.zeros(n))
    after = target - sum((c * x for c, x in zip(final, [*columns, *added], strict=True)), np.zeros(n))
    inside = slice(half, n - half)
    return point.log.time[inside] - point.log.time[0], target[inside], before[inside], after[inside]


def remarks_of(balance: OwnBalance, verdict: OwnVerdict, held_out: dict[str, dict[str, float]]) -> list[str]:
    """What a reader must know before the numbers."""
    found = []
    for term in balance.terms:
        value, error = verdict.coefficients[term.name]
        if term.declared is not None and term.uncertainty > 0:
            off = (value - term.declared) / term.uncertainty
            if abs(off) > GATES.at:
                size = f"{value:.4g} +- {error:.2g} {term.unit}".removesuffix(" 1")
                found.append(
                    f"{term.name} is {size}, {abs(off):.1f} standard deviations from the declared {term.declared:.4g}"
                )
    for fold in verdict.folds:
        if fold.refit > (1.0 + rules.MODEL_SHARE) * fold.declared:
            found.append(
                f"on run {fold.held_out} the refit is worse than the declaration: {fold.declared:.3g} -> {fold.refit:.3g} "
                f"{balance.unit}"
            )
    for run, row in held_out.items():
        if row["refit"] > (1.0 + rules.MODEL_SHARE) * row["declared"] and any(
            term.declared is not None for term in balance.terms
        ):
            found.append(
                f"on held-out run {run} the refit is worse than the declaration: {row['declared']:.3g} -> "
                f"{row['refit']:.3g} {balance.unit}"
            )
        if verdict.named and row["with_terms"] > row["refit"]:
            found.append(
                f"on held-out run {run} the named terms make it worse: {row['refit']:.3g} -> {row['with_terms']:.3g} "
                f"{balance.unit}"
            )
    return found


def other_signs(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> list[str]:
    """Terms that would take much with the sign that was not allowed: often it is the column's sign that is wrong.

    A candidate is tried without its sign beside what is named, a declared term free against held to its declaration; each is
    scored on runs that its number has not seen.
    """
    found, named = [], {term.name for term in chosen}
    before = mean_loss(balance, runs, chosen)
    for one in balance.candidates:
        if one.sign and one.name not in named:
            trial = (*chosen, best_placed(balance, runs, chosen, replace(one, sign=0)))
            found.append((one, one.sign, before, balance, trial, -1))
    for k, one in enumerate(balance.terms):
        if one.declared:
            held, free = (
                replace(balance, terms=(*balance.terms[:k], other, *balance.terms[k + 1 :]))
                for other in (
                    replace(one, uncertainty=rules.HELD * abs(one.declared)),
                    replace(one, declared=None, uncertainty=0.0),
                )
            )
            found.append((one, np.sign(one.declared), mean_loss(held, runs, chosen), free, chosen, k))
    said = []
    for one, side, left, freed, trial, k in found:
        value = solve(freed, runs, trial)[k]
        taken = 1.0 - mean_loss(freed, runs, trial) / max(left, 1e-300)
        if value * side < 0.0 and taken >= rules.TELLABLE:
            size = f"{value:.3g} {one.unit}".removesuffix(" 1")
            said.append(
                f"with the other sign {one.name} would take {taken:.0%} of the residual's mean square ({size}): check the sign of "
                "its column"
            )
    return said


def mean_loss(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> float:
    """Mean square that is left of each run, predicted from the others, by its target's variance."""
    return float(np.mean([loss.mean() for loss in losses_of(balance, runs, chosen)]))


def traded(balance: OwnBalance, runs: Sequence[RunData], verdict: OwnVerdict) -> list[str]:
    """Named numbers that would move by more than their errors if a term acted that is tied with them, a sentence each."""
    if not verdict.named:
        return []
    ties, found = {name for fold in verdict.folds for name in fold.tied} - set(verdict.named), []
    for tied in (term for term in balance.candidates if term.name in ties):
        moved = numbers(balance, runs, (*verdict.terms, placed(balance, runs, verdict.terms, tied)))
        for term in verdict.terms:
            (value, error), (other, wide) = verdict.coefficients[term.name], moved[term.name]
            if abs(other - value) > GATES.at * error:
                found.append(
                    f"{term.name} would be {other:.4g} +- {wide:.2g} {term.unit} if {tied.name} acted as well: they are tied"
                )
    return found


def detectable(
    balance: OwnBalance, runs: Sequence[RunData], terms: Chosen, verdict: OwnVerdict
) -> dict[str, tuple[float, str]]:
    """Smallest coefficient of each candidate that these runs would have shown beside their rest.

    theta = 3 rms(rest) sqrt(2 tau/N) / (rms(x) sqrt(1 - R2)), tau: samples over which the rest is correlated.
    """
    final = solve(balance, runs, terms)
    left = [residual(run, final, terms) for run in runs]
    independent = sum(len(x) / correlated(x) for x in left)
    base = np.vstack([run.matrix(terms) for run in runs])
    size, found = rms(np.concatenate(left)), {}
    for term in balance.candidates:
        if term.over is not None or term.name in verdict.named:
            continue
        x = np.concatenate([run.column(term) for run in runs])
        own = outside(x, base) if base.shape[1] else 1.0
        if own > 1e-6:
            found[term.name] = (rules.ERRORS * size / (math.sqrt(independent) * rms(x) * own), term.unit)
    return found


def correlated(x: Array) -> float:
    """Samples over which a residual is correlated: 1 + 2 sum of its positive correlations."""
    x = x - x.mean()
    n, total = len(x), 1.0
    for lag in range(1, min(n // 4, 200)):
        own = float(x[lag:] @ x[:-lag]) / max(float(x @ x), 1e-300)
        if own < 0.05:
            break
        total += 2.0 * own
    return total


def extremes(runs: Sequence[RunData], left: Sequence[Array]) -> list[str]:
    """Signals at whose ends the rest lies elsewhere than in the middle: what acts in a few samples only.

    The ends are what `rules.TAIL` cuts off; in every run that reaches them the shift must have one sign, and over occasions
    be five standard errors from nothing.
    """
    found: list[tuple[float, str]] = []
    rest = rms(np.concatenate(left))
    for name in sorted(set.intersection(*(set(run.signals) for run in runs)) - {"time_s"}):
        low, high = np.quantile(np.concatenate([run.signals[name] for run in runs]), [rules.TAIL, 1.0 - rules.TAIL])
        for word, limit, side in (("above", high, 1.0), ("below", low, -1.0)):
            means = []
            for run, own in zip(runs, left, strict=True):
                at = np.flatnonzero(side * (run.signals[name] - limit) > 0)
                middle = float(np.median(own))
                groups = np.split(at, np.flatnonzero(np.diff(at) > 2) + 1) if len(at) else []
                means += [float(own[group].mean()) - middle for group in groups]
            if len(means) < 6:
                continue
            shift, error = float(np.mean(means)), float(np.std(means, ddof=1)) / math.sqrt(len(means))
            if abs(shift) > rules.CERTAIN * error and abs(shift) > rest:
                text = f"{word} {limit:.4g} of {name} ({rules.TAIL:.0%} of the samples, {len(means)} occasions) the rest is {shift:+.3g}"
                found.append((-abs(shift) / max(error, 1e-300), f"{text} +- {error:.2g}"))
    return [text for _, text in sorted(found)[:3]]


def next_step(trace: OwnTrace) -> str:
    """What a person would do next."""
    verdict = trace.verdict
    pulses = [said(found, trace.balance.unit) for found in trace.events.values() if found]
    if verdict.alone:
        name, run = next(iter(verdict.alone.items()))
        return f"measure a second run in which {name} acts as in {run}"
    if pulses:
        return f"find what acts in pulses: {pulses[0]}"
    if trace.extremes:
        return f"look for what acts rarely: {trace.extremes[0]}; add it as a candidate with above, below or step"
    likely = [name for name in verdict.folds[0].tied if name not in verdict.named]
    if likely:
        return f"measure runs in which {' and '.join(likely)} move apart from the other terms, one at a time"
    name, r2 = verdict.depends_on
    if r2 > 0.1:
        return (
            f"add a candidate that depends on {name}: its curve explains {r2:.0%} of the rest on runs it has not seen"
        )
    if verdict.named:
        return f"check {' and '.join(verdict.named)} on the machine; the rest follows no single signal"
    return "the rest follows no single signal: better sensors or a richer motion would show more"
