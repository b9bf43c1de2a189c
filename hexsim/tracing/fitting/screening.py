"""Screening: how much of the misfit each effect of the library explains, by one column each, parameters free beside it.

The column of an effect is the change of the simulated answer with the effect's size, about the refitted machine. Normal
equations are kept in blocks of about a second, so that cross-validated gains, standard errors and detectable sizes of
all effects follow from small matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hexsim.tracing.fitting.fit import Fit, effect_columns, parameter_columns
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds, to_value
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray
BATCH = 8  # variants simulated at once: memory
SCREEN_STEP = 0.1  # size of the trial effect, in typical sizes
SCREEN_STEP_INVERSE = 0.5  # the same for effects that vanish at infinity
FOLDS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """One candidate's line of the screening table. Gains are shares of chi2; sizes are coordinates."""

    candidate: Candidate
    size: float
    gain_chi2: float
    gain_cv: float
    gain_se: float
    blocks: int
    sd: float  # of the size, from noise alone
    explained_by_others: float  # R^2 of the column on the declared parameters' columns
    reach: float  # chi2 of the channels that the effect changes: no size of it takes much more
    column: tuple[Array, ...]  # beside the declared parameters, a log: (n_channels, n); for ties

    @property
    def score(self) -> float:
        return self.gain_chi2


def trial_size(candidate: Candidate) -> float:
    """Coordinate at which the column is taken."""
    parameter = candidate.effect.parameters[0]
    step = SCREEN_STEP_INVERSE if np.isinf(parameter.neutral) else SCREEN_STEP
    low, high = coordinate_bounds(parameter)
    return min(step, high) if high > 0 else -min(step, -low)


def columns_of(
    fit: Fit,
    candidates: list[Candidate],
    problem: FitProblem,
    tick: Callable[[int], None] = lambda n: None,
    share: float = 1.0,
) -> list[list[Array]]:
    """d answer / d size of each candidate about the fit: a list over candidates of a list over logs.

    share: of the trial size, for a column at the point and not across it.
    """
    found: list[list[Array]] = []
    for first in range(0, len(candidates), BATCH):
        batch = candidates[first : first + BATCH]
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


def block_slices(fit: Fit, problem: FitProblem) -> list[tuple[int, slice]]:
    """Blocks of about a second over all logs: (log, samples)."""
    blocks = []
    for i, misfit in enumerate(fit.misfit):
        n = misfit.shape[1]
        count = problem.blocks(i)
        edges = np.linspace(0, n, count + 1).astype(int)
        blocks += [(i, slice(a, b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return blocks


def screen(
    fit: Fit, candidates: list[Candidate], problem: FitProblem, tick: Callable[[int], None] = lambda n: None
) -> list[Screened]:
    """All candidates, best first. `fit` must hold the columns of its parameters (and of its effects, if any)."""
    columns = columns_of(fit, candidates, problem, tick)
    base = base_columns(fit, problem)
    blocks = block_slices(fit, problem)
    lines = []
    free = free_columns(fit)
    for candidate, own in zip(candidates, columns, strict=True):
        if not all(np.all(np.isfinite(c)) for c in own):
            continue
        lines.append(_line(candidate, own, base, fit, blocks, free))
    return sorted(lines, key=lambda line: -line.score)


def base_columns(fit: Fit, problem: FitProblem) -> list[Array]:
    """Columns of everything that is free already: declared parameters and the numbers of effects that were added."""

    if fit.columns is None:
        fit = parameter_columns(fit, problem)
    assert fit.columns is not None
    if not fit.candidates:
        return fit.columns
    return [np.concatenate(pair) for pair in zip(fit.columns, effect_columns(fit, problem), strict=True)]


def free_columns(fit: Fit) -> Array:
    """Which columns may move: not the parameters that stand at their bound."""
    half_widths = np.array([prior.half_width for prior in fit.priors])
    inside = np.abs(fit.deviations) < 0.999 * half_widths if len(fit.priors) else np.zeros(0, bool)
    numbers = sum(len(c.free()) for c in fit.candidates)
    return np.concatenate([inside, np.ones(numbers, bool)])


def _line(
    candidate: Candidate, own: list[Array], base: list[Array], fit: Fit, blocks: list[tuple[int, slice]], free: Array
) -> Screened:
    """One candidate: gain in chi2 beside the free parameters, cross-validated in blocks."""
    k = base[0].shape[0] + 1
    A, b = np.zeros((len(blocks), k, k)), np.zeros((len(blocks), k))
    for j, (i, samples) in enumerate(blocks):
        X = np.concatenate([base[i][:, :, samples], own[i][None, :, samples]]).reshape(k, -1)
        A[j] = X @ X.T
        b[j] = X @ fit.misfit[i][:, samples].ravel()
    prior = np.zeros(k)
    prior[: len(fit.priors)] = 3.0
    whole = A.sum(0) + np.diag(prior)  # what can be known of a size: also beside parameters that stand at a bound here
    beside = _least(whole[:-1, :-1], whole[:-1, -1])
    rest = whole[-1, -1] - whole[-1, :-1] @ beside
    rest = max(rest, 1e-12 * max(whole[-1, -1], 1e-300))
    use = np.concatenate([free, [True]])
    A, b, prior = A[:, use][:, :, use], b[:, use], prior[use]
    total_A, total_b = A.sum(0) + np.diag(prior), b.sum(0)
    low, high = coordinate_bounds(candidate.effect.parameters[0])
    with_own, size = _solve(total_A, total_b, low, high)
    without = np.append(_least(total_A[:-1, :-1], total_b[:-1]), 0.0)
    gain = _gain(total_A, total_b, with_own) - _gain(total_A, total_b, without)
    gains = []
    for fold in range(FOLDS):
        out = np.arange(len(blocks)) % FOLDS == fold
        if not out.any():
            continue
        A_in, b_in = total_A - A[out].sum(0), total_b - b[out].sum(0)
        theta, _ = _solve(A_in, b_in, low, high)
        plain = np.append(_least(A_in[:-1, :-1], b_in[:-1]), 0.0)
        gains.append(_gain(A[out].sum(0), b[out].sum(0), theta) - _gain(A[out].sum(0), b[out].sum(0), plain))
    shares = np.array(gains) * len(gains) / max(fit.chi2, 1e-300)
    return Screened(
        candidate=candidate,
        size=size,
        gain_chi2=float(gain),
        gain_cv=float(np.mean(shares)),
        gain_se=float(np.std(shares, ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else np.inf,
        blocks=len(gains),
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


def _gain(A: Array, b: Array, theta: Array) -> float:
    """Fall of the sum of squares by theta."""
    return float(2.0 * theta @ b - theta @ A @ theta)
