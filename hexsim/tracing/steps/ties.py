"""Ties: which other effect of the library does as well as a named one, with the same other effects beside it.

Where the hypothesis stands, the column of every candidate is held against what the named effect does: how much of it is
left when declared parameters, the other effects and the candidate may move. What leaves little is refitted by simulation
in the place of the named effect. A tie is a refit within SIGNIFICANT, whatever led the search to the named one; and any
effect whose column is the named one's in every balance, sample by sample: both are one term there, so that no refit of
these logs says more (a hose and a dead volume add one constant to the capacity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.balances.controller import Loop
from hexsim.tracing.fitting.fit import Fit, effect_columns, parameter_columns, start_fit_at, without_effect
from hexsim.tracing.fitting.limits import limits_of, reached
from hexsim.tracing.fitting.normal import flat
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds, to_coordinate, to_value
from hexsim.tracing.fitting.screening import Screened, columns_of
from hexsim.tracing.fitting.selection import cut, inert, information, scale_of, try_candidate
from hexsim.tracing.held_out import refused
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace
from hexsim.tracing.steps.hypotheses import simulated_fit
from hexsim.tracing.steps.one_term import with_readings
from hexsim.tracing.steps.verdict import held_out_gains, named_effect

Array = np.ndarray
TANGENT = rules.LEAST_STEP / rules.TELLABLE  # of the trial size: near a resonance the answer is soon nonlinear


def with_columns(fit: Fit, whole: SimulatedProblem, head: SimulatedProblem) -> Fit:
    """The fit over the opening seconds, with the columns of its parameters that it has over the whole, else with new ones."""
    seen = start_fit_at(fit, head)
    known = cut(fit, whole, head).columns
    return parameter_columns(seen, head) if known is None else replace(seen, columns=known)


def bare_at(fit: Fit, k: int, problem: SimulatedProblem) -> Fit:
    """The fit with effect k taken away, nothing refitted, its columns as they are: what stands in for the effect acts as it did."""
    return replace(start_fit_at(without_effect(fit, k), problem), columns=fit.columns)


def stand_ins(
    fit: Fit, k: int, possible: Sequence[Candidate], problem: SimulatedProblem
) -> list[tuple[Candidate, float]]:
    """Candidates whose column does what effect k does, with the size that does it, the best first.

    No simulated channel shows the volts: what they say of the loop that runs, nothing beside the loop can say. The fit holds
    the columns of its parameters.
    """
    counts = [len(candidate.free()) for candidate in fit.candidates]
    first = sum(counts[:k])
    numbers = flat(effect_columns(fit, problem))
    assert fit.columns is not None
    beside = np.concatenate([flat(fit.columns), numbers[:first], numbers[first + counts[k] :]])
    size = fit.candidates[k].effect.parameters[0]
    does = numbers[first] * to_coordinate(size, fit.values[k][size.name])
    weak = np.concatenate([np.full(len(fit.priors), 3.0), np.full(len(beside) - len(fit.priors), 1e-6)])
    of_loop = fit.candidates[k].effect.balance == Loop.name
    others = [c for c in possible if c.label not in {own.label for own in fit.candidates}]
    others = [c for c in others if (c.effect.balance == Loop.name) == of_loop]

    def left(columns: Array, ridge: Array) -> tuple[float, float]:
        A = columns @ columns.T + np.diag(ridge)
        b = columns @ does
        theta = np.linalg.lstsq(A, b, rcond=1e-12)[0]
        return float(does @ does - b @ theta), float(theta[-1]) if len(theta) else 0.0

    alone = left(beside, weak)[0]
    found: dict[str, tuple[float, Candidate, float]] = {}
    for candidate, columns in zip(others, columns_of(fit, others, problem, share=TANGENT), strict=True):
        own = np.concatenate([c.ravel() for c in columns]).astype(float)
        if not np.all(np.isfinite(own)) or not np.any(own):
            continue
        rest, theta = left(np.concatenate([beside, own[None]]), np.append(weak, 1e-6))
        if rest < rules.TELLABLE * alone and rest < found.get(candidate.label, (np.inf,))[0]:
            found[candidate.label] = (rest, candidate, theta)
    best = sorted(found.values(), key=lambda entry: entry[0])[: rules.FEW]
    return [(candidate, theta) for _, candidate, theta in best]


def alike_in_balances(own: Candidate, possible: Sequence[Candidate], lines: Sequence[Screened]) -> list[Candidate]:
    """Candidates that may do in the balances what an effect does there: two that give the same signals leave them alike.

    All of them where the balances do not show the effect; and those that the balances do not show. lines: of a screening.
    """
    columns = {id(line.candidate): np.concatenate([x.ravel() for x in line.column]) for line in lines}
    directions = {key: x / np.linalg.norm(x) for key, x in columns.items() if np.any(x)}
    there = [line.candidate for line in lines if line.candidate.label == own.label]
    does = [directions[id(candidate)] for candidate in there if id(candidate) in directions]
    alike = {key: max((float(x @ one) ** 2 for one in does), default=1.0) for key, x in directions.items()}
    return [candidate for candidate in possible if alike.get(id(candidate), 1.0) > rules.MAIN]


def ties_of(fit: Fit, k: int, possible: Sequence[Candidate], problem: SimulatedProblem) -> dict[str, Fit]:
    """Effects that can stand for effect k: label -> the hypothesis with it, refitted on the whole runs."""
    head = problem.head(rules.OPENING_S)
    seen = with_columns(fit, problem, head)
    near = stand_ins(seen, k, possible, head)
    bare = bare_at(seen, k, head) if near else seen

    def refitted(entry: tuple[Candidate, float]) -> Fit | None:
        opening = try_candidate(bare, *entry, head, rules.FEW_STEPS)
        return None if opening is None else simulated_fit(opening, problem, fit)

    tied = {}
    for (candidate, _), rival in zip(near, in_parallel(refitted, near), strict=True):
        near_enough = rival is not None and rival.chi2 - fit.chi2 < rules.SIGNIFICANT * scale_of(fit)
        if rival is not None and near_enough and not inert(rival, problem):
            tied[candidate.label] = rival
    return dict(sorted(tied.items()))


def better_limit(fit: Fit, k: int, trace: Trace) -> Fit | None:
    """The hypothesis with a limit in the place of effect k, where that is better by more than a tie and the limit itself is worth
    an alarm, else None.

    A search that begins where no motion takes a limit does not find it, and ends with what is nearest: a spool whose speed is
    limited was named one of another lag.
    """
    problem, balances, own = trace.fit_problem, trace.balance_problem, fit.candidates[k].effect
    limits = [candidate for candidate in limits_of(trace.candidates, fit) if candidate.effect.balance == own.balance]
    if balances is None or own.limit or not limits:
        return None
    head, margin = problem.head(rules.OPENING_S), rules.SIGNIFICANT * scale_of(fit)
    seen, alarm = with_columns(fit, problem, head), rules.alarm(trace.screened)
    bare = bare_at(seen, k, head)
    here, at_balances = seen.chi2, start_fit_at(bare, balances)
    found = None
    for candidate in limits:
        begun = to_coordinate(candidate.effect.parameters[0], reached(at_balances, candidate, balances, alarm))
        opening = try_candidate(bare, candidate, begun, head, rules.FEW_STEPS)
        if opening is None or opening.chi2 > here + margin:
            continue
        rival = simulated_fit(opening, problem, fit)
        if rival is not None and rival.chi2 < (found or fit).chi2 - margin and not inert(rival, problem, alarm):
            found = rival
    return found


def same_terms(
    fit: Fit, k: int, possible: Sequence[Candidate], balances: BalanceProblem, problem: SimulatedProblem
) -> dict[str, Fit]:
    """Effects of one number that are the same term as effect k in every balance: label -> the hypothesis with it."""
    if len(fit.candidates[k].free()) != 1:
        return {}
    here, size = start_fit_at(fit, balances), fit.candidates[k].effect.parameters[0]
    does = flat(effect_columns(here, balances, only=k))[0] * to_coordinate(size, fit.values[k][size.name])
    others = [c for c in possible if len(c.free()) == 1 and c.label not in {own.label for own in fit.candidates}]
    found = {}
    for candidate, columns in zip(others, columns_of(here, others, balances), strict=True):
        own = np.concatenate([c.ravel() for c in columns]).astype(float)
        scale = float(own @ own)
        if not np.isfinite(scale) or scale == 0.0:
            continue
        coordinate = float(own @ does) / scale
        if np.sum((does - coordinate * own) ** 2) > rules.SAME**2 * (does @ does):
            continue
        number = candidate.effect.parameters[0]
        low, high = coordinate_bounds(number)
        if not low <= coordinate <= high:  # an incline pushes one way only
            continue
        values = (*fit.values[:k], {number.name: to_value(number, coordinate)}, *fit.values[k + 1 :])
        swapped = replace(fit, candidates=(*fit.candidates[:k], candidate, *fit.candidates[k + 1 :]), values=values)
        found[candidate.label] = replace(start_fit_at(swapped, problem), covariance=fit.covariance)
    return found


def with_ties(fit: Fit, trace: Trace) -> tuple[Fit, list[dict[str, Fit]]]:
    """The hypothesis and the ties of each of its effects; a limit that is better goes before what the search ended with, a
    physical cause before one that stands for any of its form."""
    problem, balances = trace.fit_problem, trace.balance_problem
    ties = []
    for k in range(len(fit.candidates)):
        if (better := better_limit(fit, k, trace)) is not None:
            return with_ties(better, trace)
    for k, own in enumerate(fit.candidates):
        near = alike_in_balances(own, trace.candidates, trace.screening)
        same = {} if balances is None else same_terms(fit, k, near, balances, problem)
        ties.append(same | ties_of(fit, k, near, problem))
    for k, tied in enumerate(ties):
        physical = [rival for rival in tied.values() if not rival.candidates[-1].effect.generic]
        if fit.candidates[k].effect.generic and physical:
            return with_ties(min(physical, key=information), trace)
    return fit, ties


def look_for_ties(trace: Trace, tell: Tell) -> Trace:
    """Of an explained machine: the ties of each effect, and each effect with its evidence. The balances have told those of
    a partly explained one."""
    if trace.verdict == "partly" and trace.rest_problem is not None:
        effects = with_readings(trace.effects, trace.final, trace.candidates, trace.rest_problem)
        return replace(trace, effects=effects, decided="not needed: the balances have told")
    if trace.verdict != "explained":
        return replace(trace, decided="not needed: no effect is named")
    final, ties = with_ties(trace.final, trace)
    if final is not trace.final and refused(final, trace.base, trace.validate_problem) is not None:
        final, ties = trace.final, [{} for _ in trace.final.candidates]  # the verdict has judged that one
    trace = replace(trace, final=final, ties=ties)
    gains = held_out_gains(final, trace.base, trace.validate_problem)
    effects = [
        named_effect(trace, final, own, tuple(tied), gains) for own, tied in zip(final.candidates, ties, strict=True)
    ]
    if trace.balance_problem is not None:
        effects = with_readings(effects, final, trace.candidates, trace.balance_problem)
    tied = sorted({label for own in ties for label in own})
    return replace(
        trace,
        effects=effects,
        decided=f"{' and '.join(e.candidate.label for e in effects)}; tied with {', '.join(tied) or 'nothing'}",
    )


STEP = Step(name="ties", doing="looking for ties", share=0.1, run=look_for_ties)
