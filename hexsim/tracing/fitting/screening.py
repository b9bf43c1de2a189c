"""Screening: how much of the misfit each effect of the library explains, by one column each, parameters free beside it.

The column of an effect is the change of the simulated answer with the effect's size, about the refitted machine. Gains,
errors and detectable sizes of all effects follow from small normal matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, all_columns
from hexsim.tracing.fitting.normal import fall_of, normal_equations
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds, to_value
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """One candidate's line of the screening table. Sizes are coordinates."""

    candidate: Candidate
    size: float
    gain_chi2: float
    share: float  # of chi2
    sd: float  # of the size, from noise alone
    explained_by_others: float  # R^2 of the column on the declared parameters' columns
    reach: float  # chi2 of the channels that the effect changes: no size of it takes much more
    column: tuple[Array, ...]  # beside the declared parameters, a log: (n_channels, n); for ties


def trial_size(candidate: Candidate) -> float:
    """Coordinate at which the column is taken: typical sizes that are just told apart."""
    parameter = candidate.effect.parameters[0]
    step = rules.START if np.isinf(parameter.neutral) else rules.TELLABLE
    low, high = coordinate_bounds(parameter)
    return min(step, high) if high > 0 else -min(step, -low)


def columns_of(
    fit: Fit,
    candidates: list[Candidate],
    problem: FitProblem,
    tick: Callable[[int], None] = lambda n: None,
    share: float = 1.0,
    at_once: int = 8,
) -> list[list[Array]]:
    """d answer / d size of each candidate about the fit: a list over candidates of a list over logs.

    share: of the trial size, for a column at the point and not across it. at_once: variants that are simulated together, for memory.
    """
    found: list[list[Array]] = []
    for first in range(0, len(candidates), at_once):
        batch = candidates[first : first + at_once]
        machines, sizes = [], []
        for candidate in batch:
            size = share * trial_size(candidate)
            parameter = candidate.effect.parameters[0]
            values = candidate.start() | {parameter.name: to_value(parameter, size)}
            machines.append(replace(fit, candidates=(*fit.candidates, candidate), values=(*fit.values, values)).built())
            sizes.append(size)
        varied = problem.misfit(machines)
        for i, size in enumerate(sizes):
            columns = [((base - v[i]) / size).astype(np.float32) for base, v in zip(fit.misfit, varied, strict=True)]
            found.append(columns)
        tick(len(batch))
    return found


def screen(
    fit: Fit, candidates: list[Candidate], problem: FitProblem, tick: Callable[[int], None] = lambda n: None
) -> list[Screened]:
    """All candidates, best first. `fit` must hold the columns of its parameters (and of its effects, if any)."""
    columns = columns_of(fit, candidates, problem, tick)
    base = all_columns(fit, problem)
    lines = []
    free = free_columns(fit)
    for candidate, own in zip(candidates, columns, strict=True):
        if not all(np.all(np.isfinite(c)) for c in own):
            continue
        lines.append(_line(candidate, own, base, fit, free))
    return sorted(lines, key=lambda line: -line.gain_chi2)


def free_columns(fit: Fit) -> Array:
    """Which columns may move: not the parameters that stand at their bound."""
    half_widths = np.array([prior.half_width for prior in fit.priors])
    inside = np.abs(fit.deviations) < 0.999 * half_widths if len(fit.priors) else np.zeros(0, bool)
    numbers = sum(len(c.free()) for c in fit.candidates)
    return np.concatenate([inside, np.ones(numbers, bool)])


def _line(candidate: Candidate, own: list[Array], base: list[Array], fit: Fit, free: Array) -> Screened:
    """One candidate: gain in chi2 beside the free parameters."""
    A, b = normal_equations([(X, x[None]) for X, x in zip(base, own, strict=True)], fit.misfit)
    k = len(b)
    prior = np.zeros(k)
    prior[: len(fit.priors)] = 3.0
    whole = A + np.diag(prior)  # what can be known of a size: also beside parameters that stand at a bound here
    beside = _least(whole[:-1, :-1], whole[:-1, -1])
    rest = whole[-1, -1] - whole[-1, :-1] @ beside
    rest = max(rest, 1e-12 * max(whole[-1, -1], 1e-300))
    use = np.concatenate([free, [True]])
    A, b = whole[use][:, use], b[use]
    theta, size = _solve(A, b, *coordinate_bounds(candidate.effect.parameters[0]))
    gain = fall_of(A, b, theta) - fall_of(A[:-1, :-1], b[:-1], _least(A[:-1, :-1], b[:-1]))
    return Screened(
        candidate=candidate,
        size=size,
        gain_chi2=gain,
        share=gain / max(fit.chi2, 1e-300),
        sd=float(1.0 / np.sqrt(rest)),
        explained_by_others=float(1.0 - rest / max(whole[-1, -1], 1e-300)),
        reach=float(sum(np.sum(m[np.any(x, axis=1)] ** 2) for x, m in zip(own, fit.misfit, strict=True))),
        column=tuple(x - np.tensordot(beside, X, 1).astype(np.float32) for x, X in zip(own, base, strict=True)),
    )


def _least(A: Array, b: Array) -> Array:
    if not len(b):
        return b
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    return scale * np.linalg.lstsq(A * scale[:, None] * scale, b * scale, rcond=1e-11)[0]


def _solve(A: Array, b: Array, low: float, high: float) -> tuple[Array, float]:
    """Least squares with the last unknown (the effect's size) inside its bounds."""
    theta = _least(A, b)
    size = min(max(theta[-1], low), high)
    if size != theta[-1]:
        theta = np.append(_least(A[:-1, :-1], b[:-1] - A[:-1, -1] * size), size)
    return theta, float(size)
