"""Normal equations of a refit, and how they scatter from block to block. No copy is made of the columns of a long log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray
Columns = Sequence[Array]  # of one log, in parts (k_i, n_channels, n): of declared parameters, of effects
AT_ONCE = 65_536  # samples of a log whose columns are laid side by side at once


def rows_of(parts: Columns, samples: slice) -> Array:
    """All columns at some samples, (k, n_channels n_samples)."""
    own = [part[:, :, samples] for part in parts]
    whole = own[0] if len(own) == 1 else np.concatenate(own)
    return whole.reshape(len(whole), -1)


def flat(columns: Sequence[Array]) -> Array:
    """Columns of all logs as rows (n_columns, n)."""
    return np.concatenate([c.reshape(c.shape[0], -1) for c in columns], axis=1)


def normal_equations(columns: Sequence[Columns], misfit: Sequence[Array]) -> tuple[Array, Array]:
    """A = X'X and b = X'r over all logs and channels. columns: a log, in parts; misfit: a log (n_channels, n)."""
    k = sum(len(part) for part in columns[0])
    A, b = np.zeros((k, k)), np.zeros(k)
    for parts, r in zip(columns, misfit, strict=True):
        for first in range(0, r.shape[1], AT_ONCE):
            samples = slice(first, first + AT_ONCE)
            X = rows_of(parts, samples)
            A += X @ X.T
            b += X @ r[:, samples].ravel()
    return A, b


def fall_of(A: Array, b: Array, step: Array) -> float:
    """Of the sum of squares by a step, to first order about where A and b were taken."""
    return float(2.0 * step @ b - step @ A @ step)


def scores_of(
    columns: Sequence[Columns], misfit: Sequence[Array], problem: FitProblem, block_s: float = rules.BLOCK_S
) -> Array:
    """g = X'r of every block, (n_blocks, k)."""
    scores = []
    for parts, r, log in zip(columns, misfit, problem.logs, strict=True):
        count = max(int((log.time[-1] - log.time[0]) / block_s), 2)
        for places in np.array_split(np.arange(r.shape[1]), count):
            samples = slice(places[0], places[-1] + 1)
            scores.append(rows_of(parts, samples) @ r[:, samples].ravel())
    return np.array(scores)
