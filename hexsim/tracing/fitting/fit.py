"""Refit by closed-loop simulation: bounded Gauss-Newton over declared parameters and the numbers of effects.

    minimise  sum ((measured - simulated)/noise)^2 + sum (deviation/prior sd)^2,   deviations within their half width

Columns are finite differences of whole simulations. A search takes long steps, which see past the oil's ringing; a fit that is
stated takes each number's own standard deviation: over more of it a tone turns, and two numbers that trade look as if they
could be told apart. Columns of declared parameters are kept between hypotheses (the shifts are small); those of effects are
made anew in every step, but where many small ones are fitted beside. Covariance: by the scatter of blocks, `covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from hexsim.declaration import Machine
from hexsim.tracing import rules
from hexsim.tracing.attempt import attempted
from hexsim.tracing.fitting.covariance import scattered
from hexsim.tracing.fitting.normal import Columns, fall_of, normal_equations, scores_of
from hexsim.tracing.fitting.parameters import (
    Candidate,
    Prior,
    coordinate_bounds,
    to_coordinate,
    to_value,
    with_settings,
)
from hexsim.tracing.problems.problem import FitProblem, chi2_of, drop_diverged

Array = np.ndarray
KEPT = 0.7  # of what a step promises: columns that give less, or as much more, are poor


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A fitted hypothesis. deviations per prior (relative); values per candidate; chi2 of the data, prior apart."""

    machine: Machine
    priors: tuple[Prior, ...]
    deviations: Array
    candidates: tuple[Candidate, ...]
    values: tuple[dict[str, float], ...]
    chi2: float
    n: int
    misfit: list[Array]
    covariance: Array | None = None  # of coordinates: deviations in half widths, then effect numbers
    columns: list[Array] | None = None  # of the declared parameters, a log: (n_priors, n_channels, n)
    # standard deviation of each coordinate if all others were known, (k,): the length of the steps of a stated fit
    alone: Array | None = None

    @property
    def reduced(self) -> float:
        """chi2 a sample."""
        return self.chi2 / max(self.n, 1)

    def fitted_machine(self) -> Machine:
        """The machine with fitted parameters and effects."""
        return with_settings(
            self.machine,
            dict(zip(self.priors, map(float, self.deviations), strict=True)),
            list(zip(self.candidates, self.values, strict=True)),
        )

    def built(self) -> Machine | None:
        """The same; None where no such machine can be declared. What a search proposes may be one."""
        return attempted(self.fitted_machine)

    def standard_errors(self) -> tuple[dict[str, float], ...]:
        """Standard error of each number of each effect, in its unit."""
        if self.covariance is None:
            return tuple({} for _ in self.candidates)
        errors = []
        for k, (candidate, values) in enumerate(zip(self.candidates, self.values, strict=True)):
            own = {}
            for place, parameter in enumerate(candidate.free(), self.places(k).start):
                sd = float(np.sqrt(max(self.covariance[place, place], 0.0)))
                here = to_coordinate(parameter, values[parameter.name])
                own[parameter.name] = abs(to_value(parameter, here + sd) - to_value(parameter, here)) or abs(
                    to_value(parameter, here - sd) - to_value(parameter, here)
                )
            errors.append(own)
        return tuple(errors)

    def places(self, k: int) -> slice:
        """Where the numbers of the k-th effect stand among the coordinates."""
        first = len(self.priors) + sum(len(candidate.free()) for candidate in self.candidates[:k])
        return slice(first, first + len(self.candidates[k].free()))


def evaluate(fit: Fit, problem: FitProblem) -> Fit:
    """The fit where it stands, with its misfit as the problem sees it."""
    misfit = [m[0] for m in problem.misfit([fit.built()])]
    return replace(fit, misfit=misfit, chi2=chi2_of(misfit), n=sum(m.size for m in misfit))


def start_fit(machine: Machine, priors: tuple[Prior, ...], problem: FitProblem) -> Fit:
    """The declared machine, nothing fitted."""
    nothing = np.zeros(len(priors))
    bare = Fit(
        machine=machine, priors=priors, deviations=nothing, candidates=(), values=(), chi2=np.inf, n=0, misfit=[]
    )
    return evaluate(bare, problem)


def start_fit_at(rival: Fit, problem: FitProblem) -> Fit:
    """A fit where it stands, as another problem sees it."""
    return evaluate(replace(rival, covariance=None, columns=None, alone=None), problem)


def parameter_columns(fit: Fit, problem: FitProblem, share: float = 1.0) -> Fit:
    """The fit with columns of its declared parameters about where it stands (per half width). share: of the usual step."""
    if not fit.priors:
        return replace(fit, columns=[np.zeros((0, *m.shape)) for m in fit.misfit])
    alone = np.inf if fit.alone is None else fit.alone[: len(fit.priors)]
    steps = np.where(fit.deviations > 0, -share, share) * np.minimum(alone, rules.LEAST_STEP)
    machines = []
    for j, prior in enumerate(fit.priors):
        deviations = fit.deviations.copy()
        deviations[j] += steps[j] * prior.half_width
        machines.append(replace(fit, deviations=deviations).built())
    columns = problem.misfit(machines)
    for base, own in zip(fit.misfit, columns, strict=True):  # in place: of a long log they are hundreds of megabytes
        np.subtract(base, own, out=own)
        own /= steps[:, None, None]
    return replace(fit, columns=drop_diverged(columns))


def effect_neighbours(
    fit: Fit, share: float = 1.0, only: int | None = None
) -> tuple[list[Machine | None], list[float]]:
    """Machines with one effect number a small step off, and the steps in coordinates. only: of this effect."""
    machines, steps, place = [], [], len(fit.priors) - 1
    for k, candidate in enumerate(fit.candidates):
        for parameter in candidate.free():
            place += 1
            if only is not None and k != only:
                continue
            here = to_coordinate(parameter, fit.values[k][parameter.name])
            least = rules.LEAST_STEP if math.isinf(parameter.neutral) else 0.1 * rules.LEAST_STEP
            step = parameter.step_share * share * max(rules.LEAST_STEP * abs(here), least)
            step = step if fit.alone is None else min(step, float(fit.alone[place]))
            if here + step > coordinate_bounds(parameter)[1]:
                step = -step
            values = dict(fit.values[k])
            values[parameter.name] = to_value(parameter, here + step)
            changed = (*fit.values[:k], values, *fit.values[k + 1 :])
            machines.append(replace(fit, values=changed).built())
            steps.append(step)
    return machines, steps


def effect_columns(fit: Fit, problem: FitProblem, share: float = 1.0, only: int | None = None) -> list[Array]:
    """Columns of every effect number about where the fit stands (per coordinate), a log: (n_numbers, channels, n)."""
    machines, steps = effect_neighbours(fit, share, only)
    if not machines:
        return []
    varied = problem.misfit(machines)
    return drop_diverged(
        [(base - v) / np.array(steps)[:, None, None] for base, v in zip(fit.misfit, varied, strict=True)]
    )


def all_columns(fit: Fit, problem: FitProblem, share: float = 1.0) -> list[Array]:
    """Columns of every coordinate where the fit stands, a log: (k, channels, n); those of declared parameters as it has them."""
    declared = (parameter_columns(fit, problem, share) if fit.columns is None else fit).columns or []
    if not fit.candidates:
        return declared
    return [np.concatenate(pair) for pair in zip(declared, effect_columns(fit, problem, share), strict=True)]


def with_effects(fit: Fit, candidates: Sequence[Candidate], size: float, problem: FitProblem) -> Fit:
    """The fit with more effects, each begun at this coordinate, nothing refitted."""
    numbers = [candidate.effect.parameters[0] for candidate in candidates]
    values = (c.start() | {n.name: to_value(n, size)} for c, n in zip(candidates, numbers, strict=True))
    grown = replace(fit, candidates=(*fit.candidates, *candidates), values=(*fit.values, *values), alone=None)
    return evaluate(grown, problem)


def without_effect(fit: Fit, k: int) -> Fit:
    """The fit without its k-th effect, all else as it is, with the errors that the other numbers have beside it."""
    candidates, values = fit.candidates[:k] + fit.candidates[k + 1 :], fit.values[:k] + fit.values[k + 1 :]
    covariance, gone = fit.covariance, fit.places(k)
    if covariance is not None:
        covariance = np.delete(np.delete(covariance, gone, 0), gone, 1)
    return replace(fit, candidates=candidates, values=values, covariance=covariance, columns=None, alone=None)


def prior_terms(fit: Fit) -> tuple[Array, Array]:
    """Prior in units of half widths: precision and pull of each declared parameter (uniform: sd = 1/sqrt(3))."""
    precision = np.full(len(fit.priors), 3.0)
    half_widths = np.array([prior.half_width for prior in fit.priors])
    return precision, -precision * (fit.deviations / half_widths if len(fit.priors) else fit.deviations)


def refine(
    fit: Fit,
    problem: FitProblem,
    steps: int = rules.MAX_STEPS,
    tolerance: float = 0.5,
    relative: float = 0.0,
    fresh: bool = False,
    stated: bool = False,
    worth: Callable[[Fit, float], bool] | None = None,
    made_here: bool = False,
    many: bool = False,
) -> Fit:
    """Damped Gauss-Newton from where the fit stands until the cost falls by less than `tolerance`, or by less than the share
    `relative` of the excess; a step that promises less is not tried.

    fresh: correct the columns of the declared parameters by what each step shows; make them anew where they are poor all the same,
    and before the last step. Those that the fit brings are old, unless made_here. stated: its numbers are told to people: fresh, and
    by steps of standard deviations.
    worth: is a fit worth a step that promises so much, as the last one kept its promise?
    many: effects, most of them small: their columns are corrected and made anew as those of the declared parameters.
    """
    if not fit.priors and not fit.candidates:
        return fit
    if stated:
        alone = np.full(len(coordinates_of(fit)), 0.1 * rules.LEAST_STEP)
        fresh, fit = True, replace(fit, alone=alone)
    age, shared = 0 if fit.columns is None or made_here else 1, fit.columns is not None
    fit = parameter_columns(fit, problem) if fit.columns is None else fit
    damping, trust, effects = 0.0, 1.0, None
    A, scores = np.zeros((0, 0)), np.zeros((0, 0))
    for _ in range(steps):
        columns = _columns(fit, effect_columns(fit, problem) if effects is None else effects)
        A, b, scores = _system(fit, columns, problem)
        better = None
        first = fall_of(A, b, _step(fit, A, b, damping)[1])
        least = max(tolerance, relative * (fit.chi2 - fit.n))
        if worth is not None and not worth(fit, trust * first):
            break
        for _ in range(6):
            coordinates, step = _step(fit, A, b, damping)
            promise = fall_of(A, b, step)
            if promise < max(0.2 * tolerance, relative * (fit.chi2 - fit.n)):
                break
            trial = evaluate(fit_at(fit, coordinates), problem)
            if _cost(trial) < _cost(fit):
                better, damping = trial, damping / 30 if damping > 1e-3 else 0.0
                break
            damping = max(damping * 30, 1e-3)
        stale = fresh and age > 0
        gain = 0.0 if better is None else _cost(fit) - _cost(better)
        if better is not None and fresh and gain >= least:
            found = corrected(columns, step, np.diag(A), fit, better, shared, many)
            better, shared = replace(better, columns=[own[0] for own in found]), False
            effects = [own[-1] for own in found] if many else None
        fit, trust = better or fit, min(gain / max(first, 1e-300), 1.0)
        fit = replace(fit, alone=np.maximum(np.diag(A), 1e-300) ** -0.5) if stated else fit
        if gain < least and not stale:
            break
        age += 1
        if stale and (gain < least or not KEPT < gain / promise < 2.0 - KEPT):
            hope = math.inf if gain < least or worth is None else trust * promise_of(fit, problem)
            if worth is not None and not worth(fit, hope):
                break
            # gone before the new ones are made: of a long log both are large
            fit, better, trial, columns, effects = replace(fit, columns=None), None, None, None, None
            fit, age, damping, shared = parameter_columns(fit, problem), 0, 0.0, False
    covariance = scattered(A, prior_terms(fit)[0], scores)
    # of a long log they are made anew where they are asked for
    columns = fit.columns if problem.duration_s <= rules.LONG_S else None
    return replace(fit, covariance=covariance, columns=columns)


def promise_of(fit: Fit, problem: FitProblem) -> float:
    """Fall of the cost that the columns which a fit holds promise."""
    A, b, _ = _system(fit, _columns(fit, effect_columns(fit, problem)), problem)
    return fall_of(A, b, _step(fit, A, b, 0.0)[1])


def corrected(
    columns: Sequence[Columns], step: Array, scale: Array, fit: Fit, after: Fit, shared: bool = True, many: bool = False
) -> list[list[Array]]:
    """The columns of the declared parameters, many: and those of effects, by what a step has shown (Broyden's least change,
    coordinates scaled).

    columns: of all coordinates, a log in parts; scale (k,): the diagonal of the normal matrix. Those that are not shared are
    changed in place: of a long log they are hundreds of megabytes.
    """
    weight = scale * step / (step @ (scale * step))
    found = []
    for parts, before, now in zip(columns, fit.misfit, after.misfit, strict=True):
        off, first = before - now, 0
        for part in parts:
            off -= np.tensordot(step[first : first + len(part)], part, 1)
            first += len(part)
        own = [parts[0].copy() if shared else parts[0], *(parts[1:] if many else ())]
        for column, share in zip((column for part in own for column in part), weight, strict=False):
            column += share * off
        found.append(own)
    return found


def _columns(fit: Fit, effects: list[Array]) -> list[Columns]:
    """Columns of all coordinates, a log: the kept ones of declared parameters, and those of effects."""
    assert fit.columns is not None
    return list(zip(fit.columns, effects, strict=True)) if fit.candidates else [(own,) for own in fit.columns]


def _system(fit: Fit, columns: Sequence[Columns], problem: FitProblem) -> tuple[Array, Array, Array]:
    """Normal equations of all coordinates, prior included; the scores of their blocks, which say how well they are known."""
    A, b = normal_equations(columns, fit.misfit)
    m = len(fit.priors)
    precision, pull = prior_terms(fit)
    A[range(m), range(m)] += precision
    b[:m] += pull
    return A, b, scores_of(columns, fit.misfit, problem)


def _cost(fit: Fit) -> float:
    half_widths = np.array([prior.half_width for prior in fit.priors])
    return fit.chi2 + float(3.0 * np.sum((fit.deviations / half_widths) ** 2)) if len(fit.priors) else fit.chi2


def coordinates_of(fit: Fit) -> Array:
    """Coordinates: deviations in half widths, then effect numbers."""
    half_widths = np.array([prior.half_width for prior in fit.priors])
    numbers = [to_coordinate(p, v[p.name]) for c, v in zip(fit.candidates, fit.values, strict=True) for p in c.free()]
    return np.concatenate([fit.deviations / half_widths if len(fit.priors) else fit.deviations, numbers])


def bounds_of(fit: Fit) -> tuple[Array, Array]:
    effect = [coordinate_bounds(p) for c in fit.candidates for p in c.free()]
    pairs = [(-1.0, 1.0)] * len(fit.priors) + effect
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])


def _step(fit: Fit, A: Array, b: Array, damping: float) -> tuple[Array, Array]:
    """Bounded step: new coordinates and the step taken. An effect's number changes at most threefold at once."""
    here, (low, high) = coordinates_of(fit), bounds_of(fit)
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    scaled = A / scale[:, None] / scale + (1e-10 + damping) * np.eye(len(b))
    root = np.linalg.cholesky(scaled)
    target = np.linalg.solve(root, b / scale)
    reach = np.full(len(here), np.inf)
    m = len(fit.priors)
    reach[m:] = 2.0 * np.maximum(np.abs(here[m:]), 0.5)
    lower, upper = np.maximum(low - here, -reach), np.minimum(high - here, reach)
    upper = np.maximum(upper, lower + 1e-12)
    solution = lsq_linear(root.T, target, bounds=(lower * scale, upper * scale), method="bvls", tol=1e-12)
    step = solution.x / scale
    if fit.alone is None:
        return here + step, step
    straight = [prior.after(*pair) for prior, *pair in zip(fit.priors, here[:m], step[:m], strict=True)]
    return np.concatenate([straight, (here + step)[m:]]), step


def fit_at(fit: Fit, coordinates: Array) -> Fit:
    """The fit at other coordinates; its misfit is still the old one."""
    half_widths = np.array([prior.half_width for prior in fit.priors])
    m = len(fit.priors)
    values, place = [], m
    for candidate in fit.candidates:
        own = {}
        for parameter in candidate.free():
            own[parameter.name] = to_value(parameter, float(coordinates[place]))
            place += 1
        values.append(own)
    return replace(fit, deviations=coordinates[:m] * half_widths if m else fit.deviations, values=tuple(values))
