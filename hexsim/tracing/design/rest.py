"""What a motion would tell of a machine that no model fits: its hypotheses in the balances, at the level of their rest.

The motion is simulated with the best hypothesis, and at the points of that run every hypothesis is held against it with
the balances, rows, weights and nuisance effects that the trace will use. With columns X and rest s of each row, the normal
matrix A of the logs that there are, and the difference d of two hypotheses' residuals,

    step        (A + X'WX)^-1 X'W d, inside bounds         what the other hypothesis takes up, W = 1/s^2
    separation  sum over rows log(mean square it leaves/s^2), all logs together, as the tie rule reads it
    errors      diag (A + X'WX)^-1 over diag A^-1
    information mean log of that ratio over all coordinates, and where nothing is named over the sizes of every effect of
                the library: a motion that only tells two hypotheses apart shows little of what nobody has thought of;
                and that of the numbers that are not sharp

`rehearsed` then lets the trace's own refit, tie rule and errors judge the motion with the rest of the logs put on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.balances.null import used
from hexsim.tracing.design.believed import enters_a_cushion, hangs_on
from hexsim.tracing.design.information import KNOWING, Hypothesis, Promise, shrunk, with_load
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.covariance import inverse
from hexsim.tracing.fitting.fit import Fit, all_columns, bounds_of, coordinates_of, effect_columns, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.fitting.rest_evidence import more_of, own_rows
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.fitting.screening import columns_of
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray
SEPARATED = -float(np.log(1.0 - rules.TELLABLE))  # least separation that is no tie
MEASURE = "log_of_rest"
NOTHING = frozenset({""})  # no number is asked for


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenRest:
    """Hypotheses of a machine that no model fits, the best first, and what the logs know.

    first: the best, with its errors and the numbers that are asked for.  own: the effect whose rows the tie rule reads.
    known: of each hypothesis, normal matrix with priors.  possible: what else may be there, unseen.  library: where nothing is
    named, all other effects, with their columns over the logs.
    """

    labels: tuple[str, ...]
    found: tuple[RestFit, ...]
    first: Hypothesis
    own: Candidate
    problem: BalanceProblem
    simulated: SimulatedProblem
    known: tuple[Array, ...]
    possible: tuple[Candidate, ...]
    library: tuple[Candidate, ...]
    library_columns: tuple[list[Array], ...]

    @property
    def best(self) -> RestFit:
        return self.found[0]

    @property
    def rest(self) -> Array:
        """rms of every row, the noise at least (n_rows,)."""
        return np.maximum(self.best.sizes, 1.0)

    def promise(self, log: Log) -> Promise:
        return promise(self, log)

    def checked(self, log: Log, found: Promise) -> Promise:
        """The promise as the trace will judge the motion; of its information the linear one."""
        return replace(rehearsed(self, log), information=found.information)

    def with_load(self, load_kg: float) -> OpenRest:
        """About the machine that people can put this on."""
        own = tuple(replace(one, fit=with_load(one.fit, load_kg)) for one in self.found)
        return replace(self, found=own, first=replace(self.first, fit=with_load(self.first.fit, load_kg)))


def open_rest(
    found: Sequence[RestFit],
    named: frozenset[str],
    possible: Sequence[Candidate],
    problem: BalanceProblem,
    simulated: SimulatedProblem,
) -> OpenRest:
    """named: labels of the effects that are sure; the others of `found` are then ties, else rivals."""
    best = found[0]
    there = {c.label for c in best.fit.candidates if not rest_level.is_held(c)}
    once = {c.effect.name: c for c in reversed(possible) if c.label not in there}
    library = () if named else tuple(once.values())  # what nobody has thought of, where nothing is named
    columns = columns_of(best.fit, list(library), problem)
    kept = [k for k, own in enumerate(columns) if all(np.isfinite(c).all() and np.any(c) for c in own)]
    known = tuple(rest_level.weighted_system(one.fit, one.columns, problem)[0] for one in found)
    fit, labels = (
        replace(best.fit, covariance=rest_level.covariance_of(best, problem, possible)),
        labels_of(found, named),
    )
    return OpenRest(
        labels=tuple(labels),
        found=tuple(found),
        first=Hypothesis(label=labels[0], fit=fit, known=known[0], named=named or NOTHING),
        own=next((c for c in best.fit.candidates if c.label in named), best.fit.candidates[-1]),
        problem=problem,
        simulated=replace(simulated, feedback=0, volts_share=0.0),
        known=known,
        possible=tuple(possible),
        library=tuple(library[k] for k in kept),
        library_columns=tuple(columns[k] for k in kept),
    )


def labels_of(found: Sequence[RestFit], named: frozenset[str]) -> list[str]:
    """The effects of each hypothesis: of the first the sure ones; else what is sure or not in all, such as a scale's ripple
    that is fitted beside every name."""
    effects = [[c.label for c in one.fit.candidates if not rest_level.is_held(c)] for one in found]
    shared = set.intersection(*map(set, effects)) - named if len(found) > 1 else set()
    told = [[c for c in own if c not in shared] for own in effects]
    told[0] = [c for c in told[0] if c in named] or told[0]
    return [" and ".join(own) or "nuisance effects alone" for own in told]


def as_measured(one: Fit, problem: BalanceProblem, simulated: SimulatedProblem, log: Log) -> BalanceProblem | None:
    """The balances of a motion as this hypothesis would write it: its own residual there is 0. None after a divergence
    and where a piston comes into a cushion."""
    machine = one.fitted_machine()
    written = replace(simulated, logs=(log,), input_uncertainty=()).simulated(machine, 0)
    clean = [used(written, part.balance.residual(written, machine)) for part in problem.parts]
    if enters_a_cushion(machine, written.position) or not all(np.isfinite(own).all() for own in clean):
        return None
    parts = tuple(replace(part, clean=(own,)) for part, own in zip(problem.parts, clean, strict=True))
    return replace(problem, logs=(written,), parts=parts)


def promise(asked: OpenRest, log: Log) -> Promise:
    """What a motion, given as a log of its setpoints, would tell; linear."""
    fits = [one.fit for one in asked.found]
    seen = as_measured(fits[0], asked.problem, asked.simulated, log)
    if seen is None:
        return no_promise(asked)
    weights = rest_level.independent(seen) * rest_level.row_counts(seen) / asked.rest**2
    there = [start_fit_at(fit, seen) for fit in fits]
    columns = [all_columns(there[0], seen)[0]]
    columns += [columns_of_rival(fit, there[0], columns[0], seen) for fit in there[1:]]
    weights = weights / columns[0].shape[2]
    new = weighted(columns[0], columns[0], weights)
    after = asked.known[0] + new
    before = np.diag(inverse(asked.known[0]))
    known = before > 0.0  # a number at the end of its range, which no log moves, stays as it is
    share = np.sqrt(np.where(known, np.diag(inverse(after)) / np.where(known, before, 1.0), 1.0))
    told = discovery(asked, there[0], seen, columns[0], weights, after)
    dull = [share[number.place] for number in asked.first.numbers if number.relative > KNOWING.sharp]
    separations = {
        (asked.labels[0], asked.labels[k]): separation(asked, k, there[k].misfit[0], columns[k], weights)
        for k in range(1, len(asked.found))
    }
    return Promise(
        separations=separations,
        errors=shrunk(asked.first, share),
        information=2.0 * float(np.mean([*-np.log(share), *told]) - np.mean(np.log(dull or [1.0]))),
        needed=SEPARATED,
        measure=MEASURE,
        told=new,
    )


def coordinates(fit: Fit) -> list[tuple[str, str, bool]]:
    """What each coordinate of a fit is."""
    own = [(c.label, number.name, rest_level.is_held(c)) for c in fit.candidates for number in c.free()]
    return [("", prior.key, True) for prior in fit.priors] + own


def columns_of_rival(rival: Fit, first: Fit, columns: Array, seen: BalanceProblem) -> Array:
    """Columns of a rival: those that it shares with the first hypothesis are taken from there."""
    shared = dict(zip(coordinates(first), columns, strict=True))
    alone = {
        k
        for k, c in enumerate(rival.candidates)
        if any((c.label, n.name, rest_level.is_held(c)) not in shared for n in c.free())
    }
    for k in alone:
        own = effect_columns(rival, seen, only=k)[0]
        c = rival.candidates[k]
        shared |= {(c.label, number.name, rest_level.is_held(c)): x for number, x in zip(c.free(), own, strict=True)}
    return np.stack([shared[key] for key in coordinates(rival)])


def no_promise(asked: OpenRest) -> Promise:
    """Of a motion in which the best hypothesis diverges or comes into a cushion."""
    return Promise(
        separations={},
        errors=tuple(np.inf for _ in asked.first.numbers),
        information=-np.inf,
        needed=SEPARATED,
        measure=MEASURE,
    )


def weighted(X: Array, Y: Array, weights: Array) -> Array:
    """X W Y' over rows and samples, (k, m)."""
    return (X * weights[None, :, None]).reshape(len(X), -1) @ Y.reshape(len(Y), -1).T


def separation(asked: OpenRest, k: int, d: Array, X: Array, weights: Array) -> float:
    """How much more hypothesis k would leave of the rest, refitted to all logs and the motion: as the tie rule reads it."""
    own, s = asked.found[k], asked.best.sizes
    here, (low, high) = coordinates_of(own.fit), bounds_of(own.fit)
    A = asked.known[k] + weighted(X, X, weights)
    step = rest_level.bounded(A, weighted(X, d[None], weights)[:, 0], low - here, high - here)
    left = d - np.tensordot(step, X, 1)
    count, total = left.shape[1], np.sum(left**2, axis=1) + left.shape[1] * s**2
    for m, columns in zip(own.fit.misfit, own.columns, strict=True):
        total, count = total + np.sum((m - np.tensordot(step, columns, 1)) ** 2, axis=1), count + m.shape[1]
    more = 2.0 * np.log(np.maximum(np.sqrt(total / count), 1.0) / asked.rest)
    rows = own_rows(asked.own, asked.problem)
    return max(float(np.sum(more[rows])), float(np.sum(more)), 0.0)


def discovery(asked: OpenRest, there: Fit, seen: BalanceProblem, X: Array, weights: Array, after: Array) -> list[float]:
    """Log of how much smaller the motion makes the error of the size of each effect of the library, beside all else."""
    if not asked.library:
        return []
    new = np.stack([own[0] for own in columns_of(there, list(asked.library), seen)]).astype(float)
    new[~np.isfinite(new).all(axis=(1, 2))] = 0.0
    counted = rest_level.independent(asked.problem) * rest_level.row_counts(asked.problem)
    old_weights = counted / asked.rest**2 / sum(m.shape[1] for m in asked.best.fit.misfit)
    gains = []
    for k, own in enumerate(asked.library_columns):
        cross, size = np.zeros(len(X)), 0.0
        for c, columns in zip(own, asked.best.columns, strict=True):
            cross += weighted(columns, c[None].astype(float), old_weights)[:, 0]
            size += weighted(c[None].astype(float), c[None].astype(float), old_weights)[0, 0]
        more = weighted(X, new[k][None], weights)[:, 0]
        size_after = size + weighted(new[k][None], new[k][None], weights)[0, 0]
        was = size - cross @ inverse(asked.known[0]) @ cross
        is_now = size_after - (cross + more) @ inverse(after) @ (cross + more)
        gains.append(0.5 * np.log(max(is_now, 1e-9 * size_after) / max(was, 1e-9 * size_after, 1e-300)))
    return [max(gain, 0.0) for gain in gains]


def with_the_rest(asked: OpenRest, seen: BalanceProblem, seed: int = 0) -> BalanceProblem:
    """Old logs and the motion as one problem; on the motion lies the rest of the old logs, in blocks drawn anew."""
    rng = np.random.default_rng(seed)
    rest = np.concatenate(asked.best.fit.misfit, axis=1)
    every, n = seen.every(seen.logs[0]), seen.parts[0].clean[0][:, :: seen.every(seen.logs[0])].shape[1]
    length = min(max(round(rules.REST_BLOCK_S / seen.thin_s), 2), rest.shape[1])
    firsts = rng.integers(0, rest.shape[1] - length + 1, n // length + 1)
    drawn = np.concatenate([rest[:, first : first + length] for first in firsts], axis=1)[:, :n]
    parts, at = [], 0
    for part, own in zip(asked.problem.parts, seen.parts, strict=True):
        clean, rows = own.clean[0].copy(), list(part.rows)
        clean[rows, ::every] += drawn[at : at + len(rows)] * part.sigma[rows, None]
        at += len(rows)
        parts.append(replace(part, clean=(*part.clean, clean)))
    return replace(asked.problem, logs=(*asked.problem.logs, *seen.logs), parts=tuple(parts))


def rehearsed(asked: OpenRest, log: Log) -> Promise:
    """The motion as the trace will judge it: every hypothesis refitted to the old logs and to it, tie rule, errors."""
    seen = as_measured(asked.best.fit, asked.problem, asked.simulated, log)
    if seen is None:
        return no_promise(asked)
    whole = with_the_rest(asked, seen)

    def again(one: RestFit) -> RestFit:
        with np.errstate(over="ignore"):  # a step that goes too far is taken back
            return rest_level.renewed(RestFit(fit=start_fit_at(one.fit, whole), columns=[], cost=np.inf), whole)

    best, *others = in_parallel(again, asked.found)
    separations = {
        (asked.labels[0], label): apart(best, other, asked, whole)
        for label, other in zip(asked.labels[1:], others, strict=True)
    }
    fit = replace(best.fit, covariance=rest_level.covariance_of(best, whole, asked.possible))
    numbers = replace(asked.first, fit=fit).numbers
    return Promise(
        separations=separations, errors=tuple(n.standard_error for n in numbers), information=0.0, needed=SEPARATED,
        measure=MEASURE, hangs_on=hangs_on(asked.first.fit, fit, [n.place for n in numbers]),
    )  # fmt: skip


def apart(best: RestFit, other: RestFit, asked: OpenRest, problem: BalanceProblem) -> float:
    """-log of the share of the rest that the other leaves more by the tie rule."""
    rows = own_rows(asked.own, problem)
    more = max(more_of(other, best, these) for these in (rows, list(range(len(best.sizes)))))
    return max(-float(np.log(max(1.0 - more, 1e-9))), 0.0)
