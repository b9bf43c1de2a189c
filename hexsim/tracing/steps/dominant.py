"""Of a machine that no hypothesis brings to the noise: the effects that are sure all the same, and what is left beside them.

The balances decide, each in units of its own rest, with the small realities of any machine fitted beside (`rest_level`).
An effect is named if all of this holds; docs/tracing.md has the measured operating characteristic of the limits:

    share        it takes at least `PARTLY_SHARE` of the mean square of the rest, in its own balance too
    remarkable   it is larger than what any machine has of it
    unseen       it does so on the held-out runs, whole and in all but few of the resamples of their blocks
    invariant    each run alone gives the same number, within its errors or a fifth
    rivals       no other effect does as well within the scatter of blocks; those that do are a tie
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import Fit, start_fit, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds, named, to_coordinate
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.fitting.screening import columns_of
from hexsim.tracing.fitting.selection import residual_at_noise_level
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.state import NamedEffect, Step, Tell, Trace
from hexsim.tracing.steps.balance_search import joint_problem
from hexsim.tracing.steps.verdict import held_out_gains
from hexsim.tracing.steps.violations import own_machine

Array = np.ndarray
LARGEST_START = 3.0  # coordinate


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A named effect's evidence: share of the rest's mean square that it takes in the fit runs and held out, its ties."""

    candidate: Candidate
    share: float
    unseen: float
    apart: tuple[float, ...]  # its number from each run alone
    tied: tuple[str, ...]


def rivals_of(
    base: RestFit, possible: Sequence[Candidate], problem: BalanceProblem, named_already: bool
) -> list[RestFit]:
    """The candidates whose columns promise most, each added to the base and refitted, the best first."""
    asked: dict[str, tuple[float, Candidate, float]] = {}
    for candidate, own in zip(possible, columns_of(base.fit, list(possible), problem), strict=True):
        if not all(np.all(np.isfinite(column)) for column in own):
            continue
        bare, columns = rest_level.released(base, candidate)
        grown = [np.concatenate([X, x[None]]) for X, x in zip(columns, own, strict=True)]
        number = candidate.effect.parameters[0]
        size, fall = rest_level.asked_for(bare, grown, coordinate_bounds(number), problem)
        fall = np.inf if np.isinf(number.neutral) and not named_already else fall  # no column tells what it can do
        if fall > asked.get(candidate.label, (-np.inf,))[0]:
            asked[candidate.label] = (fall, candidate, float(np.clip(size, -LARGEST_START, LARGEST_START)) or 0.1)
    jobs = sorted(asked.values(), key=lambda job: -job[0])[: rules.PARTLY_REFITTED]
    tried = in_parallel(lambda job: rest_level.with_effect(base, job[1], problem, job[2]), jobs)
    return sorted((rival for rival in tried if rival is not None), key=lambda rival: rival.cost)


def block_squares(misfit: Sequence[Array], thin_s: float) -> Array:
    """Mean square of every row in blocks longer than the rest's correlation, (n_rows, n_blocks)."""
    length = max(round(rules.PARTLY_BLOCK_S / thin_s), 2)
    blocks = []
    for m in misfit:
        count = max(m.shape[1] // length, 1)
        blocks += [np.mean(part**2, axis=1) for part in np.array_split(m, count, axis=1)]
    return np.stack(blocks, axis=1)


def shares_of(before: Sequence[Array], after: Sequence[Array], thin_s: float) -> tuple[float, Array]:
    """Share of the rest's mean square that a change takes, all rows together, and that of resampled blocks."""
    a, b = block_squares(before, thin_s), block_squares(after, thin_s)
    draws = np.random.default_rng(0).integers(0, a.shape[1], (rules.PARTLY_DRAWS, a.shape[1]))

    def share(places: Array) -> float:
        ms = [np.maximum(x[:, places].mean(axis=1), 1.0) for x in (a, b)]
        return 1.0 - float(np.exp(np.sum(np.log(ms[1])) - np.sum(np.log(ms[0]))))

    return share(np.arange(a.shape[1])), np.array([share(own) for own in draws])


def surely(resampled: Array) -> bool:
    """Is the share above 0 in all but few resamples?"""
    return bool(np.quantile(resampled, rules.PARTLY_DOUBT) > 0.0)


def remarkable(rival: RestFit, k: int) -> bool:
    """Is effect k larger than what any machine has of it?"""
    candidate = rival.fit.candidates[k]
    size = candidate.effect.parameters[0]
    ordinary = rules.ORDINARY.get(candidate.effect.name)
    least = abs(to_coordinate(size, ordinary)) * rules.REMARKABLE if ordinary else rules.REMARKABLE_SHARE
    return abs(rest_level.size_of(rival.fit, k)) > least


def own_rows(candidate: Candidate, problem: BalanceProblem) -> list[int]:
    """Rows of the balance that the effect is of: `valve` is a name of continuity, a sensor's effect may show in any."""
    rows, first = [], 0
    for part in problem.parts:
        names = (part.balance.name, *part.balance.other_names)
        if candidate.effect.balance in names or candidate.effect.balance == "sensor":
            rows += range(first, first + len(part.rows))
        first += len(part.rows)
    return rows


def takes_its_own(before: RestFit, after: RestFit, candidate: Candidate, problem: BalanceProblem) -> bool:
    """Does the effect make its own balance's rest smaller, and most of what it takes there?"""
    falls = np.log(np.maximum(before.sizes, 1.0)) - np.log(np.maximum(after.sizes, 1.0))
    own = own_rows(candidate, problem)
    return bool(own) and float(np.sum(falls[own])) > 0.5 * float(np.sum(falls))


def apart(fit: RestFit, k: int, problem: BalanceProblem) -> list[tuple[float, float]]:
    """(coordinate, standard error) of effect k's first number from each run alone."""
    place = len(fit.fit.priors) + sum(len(c.free()) for c in fit.fit.candidates[:k])
    return [rest_level.estimate(fit, place, problem, (i,)) for i in range(len(problem.logs))]


def invariant(found: Sequence[tuple[float, float]], size: float) -> bool:
    """Do the runs agree on the number, within three standard errors or a fifth of it?"""
    return all(abs(x - size) < max(3.0 * sd, rules.PARTLY_SPREAD * abs(size)) for x, sd in found)


def grown_by_one(
    base: RestFit, trace: Trace, problem: BalanceProblem, unseen: BalanceProblem
) -> tuple[RestFit, Judged | None] | None:
    """The base with the next sure effect, and its evidence where it is larger than what any machine has; else None."""
    there = {c.label for c in base.fit.candidates if is_named(c)}
    possible = [c for c in trace.candidates if c.label not in there]
    rivals = rivals_of(base, possible, problem, bool(there))
    for rival in rivals[: rules.PARTLY_TRIED]:
        better = rest_level.refined(rival.fit, problem)
        found = judged(base, better if better.cost < rival.cost else rival, rivals, problem, unseen)
        if found is not None:
            return found if remarkable(found[0], -1) else (found[0], None)
    return None


def is_named(candidate: Candidate) -> bool:
    """Is it free, not a small reality held to its ordinary size?"""
    return candidate.effect.name not in rules.ORDINARY or candidate.effect == named(candidate.effect.name).effect


def judged(
    base: RestFit, rival: RestFit, rivals: Sequence[RestFit], problem: BalanceProblem, unseen: BalanceProblem
) -> tuple[RestFit, Judged] | None:
    """The rival with its evidence when every rule but that of size holds, else None."""
    candidate, thin = rival.fit.candidates[-1], problem.thin_s
    share, resampled = shares_of(base.fit.misfit, rival.fit.misfit, thin)
    if share < rules.PARTLY_SHARE or not surely(resampled):
        return None
    if not takes_its_own(base, rival, candidate, problem):
        return None
    before, after = start_fit_at(base.fit, unseen), start_fit_at(rival.fit, unseen)
    held_out, resampled = shares_of(before.misfit, after.misfit, thin)
    if held_out < rules.PARTLY_SHARE_UNSEEN or not surely(resampled):
        return None
    runs = apart(rival, len(rival.fit.candidates) - 1, problem)
    if not invariant(runs, rest_level.size_of(rival.fit)):
        return None
    tied = []
    for other in rivals:
        label = other.fit.candidates[-1].label
        if label != candidate.label and not surely(shares_of(other.fit.misfit, rival.fit.misfit, thin)[1]):
            tied.append(label)
    return rival, Judged(
        candidate=candidate, share=share, unseen=held_out, apart=tuple(x for x, _ in runs), tied=tuple(sorted(tied))
    )


def sure_effects(trace: Trace, tell: Tell) -> tuple[RestFit, list[Judged], BalanceProblem]:
    """Forward selection at the level of the rest; the base where nothing is sure."""
    machine = own_machine(trace.machine, trace.violations)
    problem = joint_problem(trace.fit_problem, trace.violations, machine)
    unseen = joint_problem(trace.validate_problem, trace.violations, machine)
    small = rest_level.ordinary_effects(trace.candidates)
    base = rest_level.start_rest_fit(start_fit(trace.machine, trace.base.priors, problem), small, problem)
    found: list[Judged] = []
    for _ in range(rules.MOST_EFFECTS + rules.MOST_UNREMARKABLE):
        tell(f"looking for sure effects, {len(found)} found")
        step = grown_by_one(base, trace, problem, unseen) if len(found) < rules.MOST_EFFECTS else None
        if step is None:
            break
        base = step[0]
        found += [] if step[1] is None else [step[1]]
    return base, found, problem


def name_the_sure(trace: Trace, tell: Tell) -> Trace:
    """Verdict `partly` where an effect is sure: the machine with it and with its small realities."""
    if residual_at_noise_level(trace.final.misfit) or not trace.violations:
        return replace(trace, decided="not needed: nothing but noise is left")
    best, found, problem = sure_effects(trace, tell)
    if not found:
        return replace(trace, decided="no effect is sure beside what is left")
    fit = replace(best.fit, covariance=rest_level.sandwich(best, problem))
    final = replace(start_fit_at(fit, trace.fit_problem), covariance=fit.covariance)
    gains = tuple(held_out_gains(final, trace.base, trace.validate_problem))
    effects = [named_effect(final, own, trace, gains) for own in found]
    words = "; ".join(
        f"{own.candidate.label} takes {own.share:.0%} of the rest, {own.unseen:.0%} held out" for own in found
    )
    return replace(trace, final=final, verdict="partly", effects=effects, ties=[{} for _ in effects], decided=words)


def named_effect(final: Fit, own: Judged, trace: Trace, gains: tuple[float, ...]) -> NamedEffect:
    """A sure effect with its evidence."""
    k = final.candidates.index(own.candidate)
    gain = trace.base.chi2 - final.chi2
    return NamedEffect(
        candidate=own.candidate,
        values=final.values[k],
        standard_errors=final.standard_errors()[k],
        tied_with=own.tied,
        gain_chi2=gain,
        gain_cv=own.unseen,
        blocks=round(trace.validate_problem.duration_s / rules.PARTLY_BLOCK_S),
        d_bic=float(-gain + len(own.candidate.free()) * np.log(final.n)),
        held_out=gains,
        single_leg=final.machine.n_legs == 1,
        share=own.share,
    )


STEP = Step(name="sure effects", doing="looking for sure effects", share=0.15, run=name_the_sure)
