"""What speaks for an effect beside a rest: how much it takes, where, on what motion, with which number, and its rivals.

Everything is measured here and judged by `sure` alone, so that a limit can be moved over kept evidence afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.balances import library
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import Fit, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, in_range, to_coordinate, to_value
from hexsim.tracing.fitting.rest_level import RestFit, row_sizes
from hexsim.tracing.fitting.rest_priors import least_remarkable
from hexsim.tracing.problems.balance import BalanceProblem

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What speaks for one effect. Shares are of a mean square, all rows together or the effect's own.

    share, unseen: of the rest that it takes, in the fit runs and held out.
    own: share of what it takes that lies in its own balance.  restored: of its own balance above the noise that it
    takes, in the fit runs and held out.  remarkable: its size over that from which a machine is remarkable for it.
    harm: of a sensor's effect, by what share the mean square of any row grows: what is late is late in every balance.
    in_range: its size, and the time in which it settles, are inside their range: what asks for more is another thing.
    """

    candidate: Candidate
    share: float
    unseen: float
    own: float
    restored: tuple[float, float]
    remarkable: float
    tied: tuple[str, ...]
    harm: float = 0.0
    in_range: bool = True

    @property
    def label(self) -> str:
        return self.candidate.label


def sure(evidence: Evidence) -> bool:
    """Do all rules hold but that of size?"""
    e = evidence
    takes = e.share >= rules.EXPLAINS and e.unseen > 0.0
    return (
        (takes or min(e.restored) >= rules.RESTORES) and e.own > rules.MAIN and e.harm < rules.TELLABLE and e.in_range
    )


def evidence_of(
    base: RestFit, rival: RestFit, rivals: Sequence[RestFit], problem: BalanceProblem, unseen: BalanceProblem
) -> Evidence:
    """The evidence for the last effect of `rival` over the base. rivals: what else was tried in its place."""
    candidate, size = rival.fit.candidates[-1], rest_level.size_of(rival.fit)
    before, after = start_fit_at(base.fit, unseen).misfit, start_fit_at(rival.fit, unseen).misfit
    own, everywhere = own_rows(candidate, problem), list(range(len(base.sizes)))
    falls = np.log(np.maximum(base.sizes, 1.0)) - np.log(np.maximum(rival.sizes, 1.0))
    harm = harm_of(falls, problem, own) if candidate.effect.balance == "sensor" else 0.0
    others = [other for other in rivals if other.fit.candidates[-1].label != candidate.label]
    limits = [tie_limit(other, after, unseen) for other in others]
    tied = [
        other
        for other, limit in zip(others, limits, strict=True)
        if not any(worse(other, rival, rows, limit) for rows in (own, everywhere))
    ]
    return Evidence(
        candidate=candidate,
        share=share_of(base.fit.misfit, rival.fit.misfit),
        unseen=share_of(before, after),
        own=float(np.sum(falls[own])) / max(float(np.sum(falls)), 1e-12),
        restored=most_restored(
            [
                (base.sizes[rows], rival.sizes[rows], row_sizes(before)[rows], row_sizes(after)[rows])
                for rows in own_balances(candidate, problem)
            ]
        ),
        remarkable=abs(size + shared_size(rival.fit, candidate)) / least_remarkable(candidate),
        harm=harm,
        in_range=in_range(candidate, rival.fit.values[-1]),
        tied=tuple(sorted(other.fit.candidates[-1].label for other in tied)),
    )


def share_of(before: Sequence[Array], after: Sequence[Array]) -> float:
    """Share of the rest's mean square that a change takes, all rows together."""
    first, then = (np.log(np.maximum(row_sizes(misfit), 1.0)) for misfit in (before, after))
    return 1.0 - float(np.exp(2.0 * np.sum(then - first)))


def tie_limit(other: RestFit, after: Sequence[Array], unseen: BalanceProblem) -> float:
    """Share by which another must be worse to be no tie; wider where it leaves less of the held-out runs than `after`."""
    share = share_of(after, start_fit_at(other.fit, unseen).misfit)
    return rules.MAIN if share > 0.0 else rules.TELLABLE


def worse(other: RestFit, rival: RestFit, rows: Sequence[int], limit: float = rules.TELLABLE) -> bool:
    """Does the other leave more in these rows, by more than the rest can hide?"""
    return more_of(other, rival, rows) > limit


def more_of(other: RestFit, rival: RestFit, rows: Sequence[int]) -> float:
    """Share of the mean square of these rows that a hypothesis takes and another leaves."""
    before, after = ([m[rows] for m in found.fit.misfit] for found in (other, rival))
    return share_of(before, after)


def harm_of(falls: Array, problem: BalanceProblem, own: list[int] | slice = slice(None)) -> float:
    """By what share the mean square of any of its own rows grows; falls: of the logarithm of the sizes of all (n_rows,).

    What all legs share shifts with an effect in one of them: another leg's rows are no witness. Of a balance whose fast
    part has rows of its own both count together: they are one residual.
    """
    whole, first, places = falls.copy(), 0, {}
    for part in problem.parts:
        places[part.balance.name] = range(first, first + len(part.rows))
        for name in part.balance.other_names.keys() & places.keys():
            whole[list(places[name])] += falls[list(places[part.balance.name])]
        first += len(part.rows)
    return float(np.max(np.exp(-2.0 * whole[own]), initial=1.0)) - 1.0


def own_rows(candidate: Candidate, problem: BalanceProblem) -> list[int]:
    """Rows of all balances that the effect is of."""
    return [row for rows in own_balances(candidate, problem) for row in rows]


def own_balances(candidate: Candidate, problem: BalanceProblem) -> list[list[int]]:
    """Rows of the balances that the effect is of, a balance a list: `valve` is a name of continuity, a sensor's effect may show in any.

    The force of a hexapod's leg is the platform's. Rows of other legs are not its own: what restores them is no rival.
    """
    rows, first, of = [], 0, {candidate.effect.balance}
    of |= {balance.shared_out for balance in library() if balance.name in of}
    for part in problem.parts:
        if of & {part.balance.name, *part.balance.other_names} or "sensor" in of:
            places = [part.balance.places(problem.logs[0])[k] for k in part.rows]
            rows.append([first + k for k, place in enumerate(places) if not of_another_leg(place, candidate.where)])
        first += len(part.rows)
    return rows


def of_another_leg(place: str, where: str) -> bool:
    return place.startswith("leg") and where.startswith("leg") and place != where


def most_restored(sizes: Sequence[tuple[Array, Array, Array, Array]]) -> tuple[float, float]:
    """`restored` in the fit runs and held out, of the balance where the lesser of both is largest.

    sizes: of a balance's rows before and after in the fit runs, before and after held out.
    """
    return max(((restored(a, b), restored(c, d)) for a, b, c, d in sizes), key=min, default=(0.0, 0.0))


def restored(before: Array, after: Array) -> float:
    """Share of the mean square above the noise that is gone from rows of these sizes; 0 where there is none."""
    above = [float(np.sum(np.maximum(sizes**2 - 1.0, 0.0))) for sizes in (before, after)]
    return 1.0 - above[1] / above[0] if above[0] > rules.TELLABLE else 0.0


def shared_size(fit: Fit, candidate: Candidate) -> float:
    """Coordinate of the nuisance effect of all legs beside an effect in one of them: that leg has both together."""
    for k, other in enumerate(fit.candidates):
        shared = other.where == "all legs" and rest_level.is_held(other)
        if other is not candidate and shared and other.effect.name == candidate.effect.name:
            return rest_level.size_of(fit, k)
    return 0.0


def values_in_leg(fit: Fit, candidate: Candidate) -> dict[str, float]:
    """Numbers of an effect as its leg has it: of the first, what all legs share is added where such things add up."""
    values, number = fit.values[fit.candidates.index(candidate)], candidate.effect.parameters[0]
    if np.isinf(number.neutral):
        return values
    whole = to_coordinate(number, values[number.name]) + shared_size(fit, candidate)
    return values | {number.name: to_value(number, whole)}
