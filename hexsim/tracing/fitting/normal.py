"""Normal equations of a refit, and how they scatter from block to block. No copy is made of the columns of a long log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import ndtr, stdtrit

from hexsim.tracing import rules
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray
Columns = Sequence[Array]  # of one log, in parts (k_i, n_channels, n): of declared parameters, of effects


def rows_of(parts: Columns, samples: slice) -> Array:
    """All columns at some samples, (k, n_channels n_samples)."""
    own = [part[:, :, samples] for part in parts]
    whole = own[0] if len(own) == 1 else np.concatenate(own)
    return whole.reshape(len(whole), -1)


def flat(columns: Sequence[Array]) -> Array:
    """Columns of all logs as rows (n_columns, n)."""
    return np.concatenate([c.reshape(c.shape[0], -1) for c in columns], axis=1)


def normal_equations(columns: Sequence[Columns], misfit: Sequence[Array], at_once: int = 65_536) -> tuple[Array, Array]:
    """A = X'X and b = X'r over all logs and channels. columns: a log, in parts; misfit: a log (n_channels, n).

    at_once: samples whose columns are laid side by side, for memory.
    """
    k = sum(len(part) for part in columns[0])
    A, b = np.zeros((k, k)), np.zeros(k)
    for parts, r in zip(columns, misfit, strict=True):
        for first in range(0, r.shape[1], at_once):
            samples = slice(first, first + at_once)
            X = rows_of(parts, samples)
            A += X @ X.T
            b += X @ r[:, samples].ravel()
    return A, b


def fall_of(A: Array, b: Array, step: Array) -> float:
    """Of the sum of squares by a step, to first order about where A and b were taken."""
    return float(2.0 * step @ b - step @ A @ step)


def blocks_of(
    columns: Sequence[Columns], misfit: Sequence[Array], problem: FitProblem, block_s: float
) -> Iterator[tuple[Array, Array]]:
    """X (k, .) and r (.,) of every block."""
    for parts, r, log in zip(columns, misfit, problem.logs, strict=True):
        count = max(int((log.time[-1] - log.time[0]) / block_s), 2)
        for places in np.array_split(np.arange(r.shape[1]), count):
            samples = slice(places[0], places[-1] + 1)
            yield rows_of(parts, samples), r[:, samples].ravel()


def scores_of(columns: Sequence[Columns], misfit: Sequence[Array], problem: FitProblem) -> Array:
    """g = X'r of every block, (n_blocks, k)."""
    return np.array([X @ r for X, r in blocks_of(columns, misfit, problem, rules.BLOCK_S)])


def without_each(
    A: Array, columns: Sequence[Columns], misfit: Sequence[Array], problem: FitProblem, block_s: float
) -> Array:
    """Scores of blocks so few that each has drawn the fit towards itself (n_blocks, k): A (A - X'X)^-1 X'r is how far the fit
    moves without it, as A moves it. Of blocks all alike that is n/(n - 1) times X'r. Times Student's t beyond two errors."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    moved = []
    for X, r in blocks_of(columns, misfit, problem, block_s):
        left = (A - X @ X.T) * scale[:, None] * scale
        moved.append(A @ (scale * (np.linalg.pinv(left, rcond=1e-12, hermitian=True) @ (scale * (X @ r)))))
    t = stdtrit(len(moved) - 1, ndtr(2.0)) / 2.0
    return np.array(moved) * t * (1.0 - 1.0 / len(moved))
