"""How well a number is known at the level of the rest: by the scatter of blocks, and from part of the logs alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, coordinates_of
from hexsim.tracing.fitting.rest_level import RestFit, independent, row_counts, row_sizes
from hexsim.tracing.fitting.rest_priors import off_prior, prior_precision
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray


def sandwich(found: RestFit, problem: FitProblem) -> Array:
    """Covariance of all coordinates from the scatter of blocks, with the priors' freedom inside: H^-1 (S + c P) H^-1.

    c: samples for one that counts as independent; H holds c P, J's prior. A nuisance effect is known to its ordinary size.
    """
    return _sandwich(*_curvature(found.fit, found.columns, problem))


def _sandwich(H: Array, P: Array, scores: Array) -> Array:
    S = scores.T @ scores
    inverse = np.linalg.pinv(H, rcond=1e-12, hermitian=True)
    return inverse @ (S + P) @ inverse


def _curvature(
    fit: Fit,
    columns: list[Array],
    problem: FitProblem,
    runs: Sequence[int] | None = None,
) -> tuple[Array, Array, Array]:
    """(H of J's tangent, c times its prior's part, score of each block (n_blocks, k)). runs: only these."""
    k = columns[0].shape[0]
    size = np.maximum(row_sizes(fit.misfit), 1.0) / np.sqrt(row_counts(problem))
    counted = sum(r.shape[1] for r in fit.misfit) / independent(problem)
    P = counted * np.diag(prior_precision(fit))
    H, scores = P.copy(), []
    for i, (X, r) in enumerate(zip(columns, fit.misfit, strict=True)):
        if runs is not None and i not in runs:
            continue
        count = max(int((problem.logs[i].time[-1] - problem.logs[i].time[0]) / rules.PARTLY_BLOCK_S), 2)
        for part in np.array_split(np.arange(r.shape[1]), count):
            own = X[:, :, part]
            scaled = (own / size[None, :, None] ** 2).reshape(k, -1)
            H += scaled @ own.reshape(k, -1).T
            scores.append(scaled @ r[:, part].ravel())
    return H, counted * P, np.array(scores)


def estimate(found: RestFit, place: int, problem: FitProblem, runs: Sequence[int]) -> tuple[float, float]:
    """(value, standard error) of one coordinate from these logs alone, linear about the fit of all of them."""
    fit = found.fit
    H, P, scores = _curvature(fit, found.columns, problem, runs)
    here = coordinates_of(fit)
    held = prior_precision(fit) * off_prior(fit) * sum(r.shape[1] for r in fit.misfit) / independent(problem)
    step = np.linalg.pinv(H, rcond=1e-12, hermitian=True) @ (scores.sum(axis=0) - held)
    covariance = _sandwich(H, P, scores)
    return float(here[place] + step[place]), float(np.sqrt(max(covariance[place, place], 0.0)))
