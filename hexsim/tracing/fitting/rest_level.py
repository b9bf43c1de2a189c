"""Least squares where no model reaches the noise: rows of the balances in units of what is left in them.

    minimise  J = sum over rows N log(max(mean square of the row, 1)) + 3 sum (deviation/reach)^2

With noise as the unit the row that is violated most drowns the others, and with 60,000 samples every column is
significant. Here each balance counts by the share of its rest, and N is the number of its rest's correlation times in
the logs. Nuisance effects (`rules.ORDINARY`) are fitted beside every hypothesis, each within its reach, its ordinary size, as
a declared parameter is within its half width.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from hexsim.tracing import rules
from hexsim.tracing.fitting import lag_coordinates
from hexsim.tracing.fitting.covariance import inverse, scattered
from hexsim.tracing.fitting.fit import (
    KEPT,
    Fit,
    all_columns,
    bounds_of,
    coordinates_of,
    effect_columns,
    evaluate,
    fit_at,
    with_effects,
)
from hexsim.tracing.fitting.normal import fall_of, normal_equations, without_each
from hexsim.tracing.fitting.parameters import Candidate, to_coordinate
from hexsim.tracing.fitting.rest_priors import is_held, least_remarkable, middle_of, off_prior, prior_precision
from hexsim.tracing.fitting.screening import columns_of
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray
STARTS = (1.0, rules.START, 2.0)  # sizes at which an effect may begin, besides that of its column
LEAST_FALL = 1.0  # of J, for another step


@dataclass(frozen=True, kw_only=True, eq=False)
class RestFit:
    """A hypothesis at the level of the rest. columns: of every coordinate, a log (k, n_rows, n). cost: J."""

    fit: Fit
    columns: list[Array]
    cost: float

    @property
    def sizes(self) -> Array:
        """rms of every row (n_rows,), in units of its noise."""
        return row_sizes(self.fit.misfit)


def row_sizes(misfit: Sequence[Array]) -> Array:
    """rms of every row over all logs, (n_rows,)."""
    with np.errstate(over="ignore"):  # a trial that diverges is infinitely large, and not taken
        return np.sqrt(sum(np.sum(m**2, axis=1) for m in misfit) / sum(m.shape[1] for m in misfit))


def cost_of(fit: Fit, problem: FitProblem) -> float:
    """J of a fit."""
    return cost_of_rows(fit, problem) + float(prior_precision(fit) @ off_prior(fit) ** 2)


def cost_of_rows(fit: Fit, problem: FitProblem) -> float:
    """J of a fit without its priors."""
    sizes = row_sizes(fit.misfit)
    if not np.all(np.isfinite(sizes)):
        return np.inf
    return float(2.0 * independent(problem) * np.sum(row_counts(problem) * np.log(np.maximum(sizes, 1.0))))


def independent(problem: FitProblem) -> float:
    """Correlation times of a rest in the logs."""
    return sum(float(log.time[-1] - log.time[0]) for log in problem.logs) / rules.REST_TIME_S


def row_counts(problem: FitProblem) -> Array | float:
    """How much oftener than once in `REST_TIME_S` the rest of a row is new."""
    return rules.REST_TIME_S / problem.rest_times_s


def ordinary_effects(possible: Sequence[Candidate]) -> list[Candidate]:
    """The nuisance effects among these candidates, one number each, held to its ordinary size, and what the machine file
    means by it, which no log shows.

    A shape that was read off the logs stays; of several legs each would have its own, and no small one is asked for.
    """
    found, many = {}, any(candidate.where.startswith("leg") for candidate in possible)
    for candidate in possible:
        effect = candidate.effect
        shape = {key: value for key, value in candidate.shape.items() if not any(p.grid for p in effect.parameters)}
        if effect.name in rules.ORDINARY and candidate.where == "all legs" and not (shape and many):
            size, most = effect.parameters[0], rules.ORDINARY[effect.name]
            low, high = size.bounds
            low = 0.0 if effect.name in rules.FADES else max(low, -most)
            bounds = (most, high) if np.isinf(size.neutral) else (low, min(high, most))
            meant = tuple(number for number in effect.parameters if number.of_the_file)
            small = replace(effect, parameters=(replace(size, bounds=bounds), *meant))
            found[effect.name] = replace(candidate, effect=small, shape=shape | {n.name: middle_of(n) for n in meant})
    return list(found.values())


def start_rest_fit(bare: Fit, small: Sequence[Candidate], problem: FitProblem) -> RestFit:
    """The declared machine with its nuisance effects, refitted at the level of the rest.

    A spool that is there and one that is not are far apart: both are tried.
    """
    at_once = [candidate for candidate in small if not np.isinf(candidate.effect.parameters[0].neutral)]
    lagging = [candidate for candidate in small if np.isinf(candidate.effect.parameters[0].neutral)]
    without = refined(with_effects(replace(bare, columns=None), at_once, 0.0, problem), problem)
    if not lagging:
        return without
    return min(
        without, refined(with_effects(without.fit, lagging, rules.START, problem), problem), key=lambda own: own.cost
    )


def refined(fit: Fit, problem: FitProblem, columns: list[Array] | None = None, steps: int = rules.MAX_STEPS) -> RestFit:
    """Gauss-Newton on J, weights of the rows anew at every step.

    columns: of all coordinates but the last effect's, kept as they are; without them all are made anew at every other step.
    """
    cost = cost_of(fit, problem)
    whole: list[Array] = []
    anew = True
    for _ in range(steps):
        whole = _columns(fit, problem, columns) if anew else whole
        trial, fall = _step(fit, cost, whole, problem)
        fit, cost = (fit, cost) if trial is None else (trial, cost - fall)
        if anew and fall < LEAST_FALL:
            break
        anew = columns is not None or not anew or fall < LEAST_FALL
    return RestFit(fit=fit, columns=whole, cost=cost)


def renewed(found: RestFit, problem: FitProblem) -> RestFit:
    """A fit whose columns but the last effect's were kept, refitted with columns made anew until J falls no more."""
    for _ in range(rules.FEW_STEPS):
        own = len(found.fit.candidates[-1].free())
        better = refined(found.fit, problem, [X[:-own] for X in all_columns(found.fit, problem)])
        fall, found = found.cost - better.cost, better
        if fall < LEAST_FALL:
            break
    return found


def without_lag(found: RestFit, problem: FitProblem) -> RestFit | None:
    """The hypothesis without the nuisance effects that vanish at infinity, else where it stood; None where it has none.

    A spool that is there and one that is not are far apart, and the base may have taken one for the effect.
    """
    fit, values, any_there = found.fit, [], False
    for candidate, own in zip(fit.candidates, found.fit.values, strict=True):
        number = candidate.effect.parameters[0]
        lags = is_held(candidate) and np.isinf(number.neutral)
        any_there |= lags and to_coordinate(number, own[number.name]) > rules.LEAST_STEP
        values.append(own | {number.name: number.neutral} if lags else own)
    if not any_there:
        return None
    bare = evaluate(replace(fit, values=tuple(values)), problem)
    return RestFit(fit=bare, columns=found.columns, cost=cost_of(bare, problem))


def _columns(fit: Fit, problem: FitProblem, kept: list[Array] | None) -> list[Array]:
    if kept is None:
        return all_columns(fit, problem)
    own = effect_columns(fit, problem, only=len(fit.candidates) - 1)
    return [np.concatenate(pair) for pair in zip(kept, own, strict=True)]


def _step(fit: Fit, cost: float, columns: list[Array], problem: FitProblem) -> tuple[Fit | None, float]:
    """The first bounded step, damped more and more, with which J falls; None when it does not. Of a lag in straight coordinates."""
    A, b = weighted_system(fit, columns, problem)
    coordinates, (low, high), lags = coordinates_of(fit), bounds_of(fit), lag_coordinates.lags_of(fit)
    turn, here = lag_coordinates.slopes(coordinates, lags), lag_coordinates.straight(coordinates, lags)
    A, b, (least, most) = turn.T @ A @ turn, turn.T @ b, lag_coordinates.straight_bounds(low, high, lags)
    for damping in (0.0, 0.1, 1.0, 10.0, 100.0):  # until J falls
        step = bounded(A + damping * np.diag(np.diag(A)), b, least - here, most - here)
        trial = evaluate(fit_at(fit, lag_coordinates.bent(here + step, lags, low, high)), problem)
        fall = cost - cost_of(trial, problem)
        if fall > 0.0:
            return trial, fall
    return None, 0.0


def row_weights(fit: Fit, problem: FitProblem) -> Array:
    """Of every row in J's tangent: one over its mean square, N samples in all (n_rows,)."""
    counted = independent(problem) * row_counts(problem)
    return counted / (np.maximum(row_sizes(fit.misfit), 1.0) ** 2 * sum(r.shape[1] for r in fit.misfit))


def weighted_system(fit: Fit, columns: list[Array], problem: FitProblem) -> tuple[Array, Array]:
    """Normal equations of J's tangent, priors included."""
    held, roots = prior_precision(fit), np.sqrt(row_weights(fit, problem))
    m = len(held)  # a column more is of an effect that is only asked for
    weighted = [roots[:, None] * r for r in fit.misfit]
    A, b = normal_equations([[roots[None, :, None] * X] for X in columns], weighted)
    A[range(m), range(m)] += held
    b[:m] -= held * off_prior(fit)
    return A, b


def covariance_of(found: RestFit, problem: FitProblem, possible: Sequence[Candidate]) -> Array:
    """Covariance of all coordinates (`covariance.scattered`), its blocks longer than the rest's correlation; a nuisance effect is
    known to its ordinary size.

    What shifts a number may do so alike in every block: then the blocks agree, and J's curvature alone says how far.
    possible: effects that may be there as well (`unseen`).
    """
    fit, roots = found.fit, np.sqrt(row_weights(found.fit, problem))
    weighted = [roots[:, None] * r for r in fit.misfit]
    columns = [[roots[None, :, None] * X] for X in found.columns]
    A = weighted_system(fit, found.columns, problem)[0]
    own = scattered(A, prior_precision(fit), without_each(A, columns, weighted, problem, rules.REST_BLOCK_S))
    return own + unseen(found, A, possible, problem)


def unseen(found: RestFit, A: Array, possible: Sequence[Candidate], problem: FitProblem) -> Array:
    """What the coordinates' covariance gains by effects that are not fitted, for each may be there below the size that is
    remarkable (considered parameters, Schmidt 1966):

        T (D - B'T)^-1 T',   T = A^-1 B    the coordinates' move by a unit of each effect
                             B, D          of J beside them, D with 3 over the square of the least remarkable size

    D - B'T is what the logs and that size know of the effects together. A number that trades with one of them is not sharp.
    """
    there = {candidate.label for candidate in found.fit.candidates}
    others = [candidate for candidate in possible if candidate.label not in there]
    columns = zip(others, columns_of(found.fit, others, problem), strict=True)
    seen = [(one, own) for one, own in columns if all(np.isfinite(X).all() for X in own)]
    if not seen:
        return np.zeros_like(A)
    whole = [np.concatenate([X, *(own[i][None] for _, own in seen)]) for i, X in enumerate(found.columns)]
    m, joint = len(A), weighted_system(found.fit, whole, problem)[0]
    T = inverse(A) @ joint[:m, m:]
    held = [3.0 / least_remarkable(one) ** 2 for one, _ in seen]
    return T @ inverse(joint[m:, m:] + np.diag(held) - joint[m:, :m] @ T) @ T.T


def bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    """argmin x'Ax/2 - b'x inside bounds; a coordinate without a column stays."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    flat = np.diag(A) < 1e-200
    scale[flat] = 1.0
    root = np.linalg.cholesky(A * scale[:, None] * scale + 1e-9 * np.eye(len(b)))
    low, high = low / scale, np.maximum(high / scale, low / scale + 1e-9)
    low[flat], high[flat] = -1e-9, 1e-9
    found = lsq_linear(root.T, np.linalg.solve(root, b * scale), bounds=(low, high), method="bvls", tol=1e-9)
    return found.x * scale


def without_nuisance(base: RestFit, candidate: Candidate) -> tuple[Fit, list[Array]]:
    """The base without the nuisance effect of the same effect, and its columns."""
    fit = base.fit
    keep = [k for k, own in enumerate(fit.candidates) if own.label != candidate.label]
    places = np.r_[: len(fit.priors), *(fit.places(k) for k in keep)].astype(int)
    bare = replace(fit, candidates=tuple(fit.candidates[k] for k in keep), values=tuple(fit.values[k] for k in keep))
    return bare, [X[places] for X in base.columns]


def with_effect(base: RestFit, candidate: Candidate, problem: FitProblem, size: float) -> RestFit:
    """The base with one more effect of this size, refitted, the base's columns kept."""
    begun = begun_with(base, candidate, problem, size, -np.inf, -np.inf)
    assert begun is not None
    return ended(base, begun, problem)


def begun_with(
    base: RestFit, candidate: Candidate, problem: FitProblem, start: Array | float, least: float, promised: float
) -> RestFit | None:
    """The base with one more effect, refitted without quick rows, which make many valleys, the base's columns kept; None when J
    does not begin lower by `least`.

    start: coordinates that the columns ask for, the effect's first number last, or that number alone. Begun there where J
    falls as they promised, else with this effect alone, at this size or at a larger one, whatever leaves least: a delay's
    column tells little of a delay ten times as long.
    """
    bare, columns = without_nuisance(base, candidate)
    here, size = coordinates_of(bare), float(np.atleast_1d(start)[-1])
    start = np.append(here, size) if np.ndim(start) == 0 else np.asarray(start)
    side = -1.0 if size < 0.0 and candidate.effect.parameters[0].bounds[0] < 0.0 else 1.0
    slow, fit = problem.slow_alone(), initialise(bare, candidate, start, problem)
    cost = cost_of(base.fit, slow)
    if cost - cost_of(fit, slow) < KEPT * promised:
        sizes = (size, *(side * start for start in (STARTS if least < 0.0 else STARTS[:1])))
        alone = [initialise(bare, candidate, np.append(here, size), problem) for size in sizes]
        fit = min((fit, *alone), key=lambda fit: cost_of(fit, slow))
    return refined(fit, slow, columns) if cost - cost_of(fit, slow) > least else None


def ended(base: RestFit, begun: RestFit, problem: FitProblem, near: bool = True) -> RestFit:
    """What was begun without quick rows, as all rows see it; near: refitted to them, too."""
    if problem.slow_alone() is problem:
        return begun
    if near:
        return refined(begun.fit, problem, without_nuisance(base, begun.fit.candidates[-1])[1])
    return replace(begun, cost=cost_of(begun.fit, problem))


def initialise(bare: Fit, candidate: Candidate, start: Array, problem: FitProblem) -> Fit:
    """A fit with one more effect. start: coordinates of all, the effect's first number last."""
    return with_effects(fit_at(bare, start[:-1]), [candidate], float(start[-1]), problem)


def newton_step(fit: Fit, system: tuple[Array, Array], own: tuple[float, float]) -> tuple[Array, float]:
    """(coordinates that the columns of a weighted system ask for, the effect's number last, which stands at 0; what J's
    tangent promises for them). own: its bounds."""
    A, b = system
    here, (low, high) = coordinates_of(fit), bounds_of(fit)
    x = bounded(A, b, np.append(low - here, own[0]), np.append(high - here, own[1]))
    return np.append(here, 0.0) + x, fall_of(A, b, x)


def size_of(fit: Fit, k: int = -1) -> float:
    """Coordinate of an effect's first number."""
    number = fit.candidates[k].effect.parameters[0]
    return to_coordinate(number, fit.values[k][number.name])
