"""Errors of a refit hold the numbers where what is left is not white."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hexsim.tracing.fitting import covariance, normal

RATE_Hz, N, DRAWS = 1000.0, 20000, 60
PROBLEM = SimpleNamespace(logs=[SimpleNamespace(time=np.arange(N) / RATE_Hz)])
RING_Hz, RING_S = 80.0, 0.02  # oil that rings, and how long


def columns_of(rng):
    """A ring that random kicks excite, as a hose shows, and a slow wave (2, 1, N)."""
    pole = np.exp((-1.0 / RING_S + 2j * np.pi * RING_Hz) / RATE_Hz)
    ring = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(N))
    return np.stack([ring / ring.std(), np.sin(2 * np.pi * 0.3 * np.arange(N) / RATE_Hz)])[:, None, :]


def left_over(rng, share):
    """White noise; a share of its variance rings as the oil does (1, N)."""
    return np.sqrt(1.0 - share) * rng.standard_normal((1, N)) + np.sqrt(share) * columns_of(rng)[0]


@pytest.mark.parametrize(("share", "times"), [(0.0, 1.0), (0.3, 1.6)])
def test_an_error_is_the_scatter_of_the_number(share, times):
    """Of 60 logs the first number scatters by its mean error within a quarter (chi of 60 draws: 9 %), 1.6 times as much as white
    noise makes of it where a third of what is left rings; the slow wave's error stays as it was."""
    rng = np.random.default_rng(1)
    X = columns_of(rng)
    A = np.einsum("kcn,lcn->kl", X, X)
    errors, numbers = [], []
    for _ in range(DRAWS):
        r = left_over(rng, share)
        numbers.append(covariance.inverse(A) @ np.einsum("kcn,cn->k", X, r))
        left = r - np.einsum("k,kcn->cn", numbers[-1], X)
        errors.append(np.sqrt(np.diag(covariance.scattered(A, np.zeros(0), normal.scores_of([[X]], [left], PROBLEM)))))
    white = np.sqrt(np.diag(covariance.inverse(A)))
    assert np.std(numbers, axis=0)[0] == pytest.approx(np.mean(errors, axis=0)[0], rel=0.25)
    assert np.mean(errors, axis=0)[0] > times * white[0]
    assert np.mean(errors, axis=0)[1] == pytest.approx(white[1], rel=0.25)


def test_no_error_is_less_than_that_of_white_noise():
    """Blocks that agree by chance, nothing left at all, and a prior on the first number."""
    X = columns_of(np.random.default_rng(2))
    A = np.einsum("kcn,lcn->kl", X, X) + np.diag([3.0, 0.0])
    found = covariance.scattered(A, np.array([3.0]), normal.scores_of([[X]], [np.zeros((1, N))], PROBLEM))
    assert np.diag(found) == pytest.approx(np.diag(covariance.inverse(A)), rel=1e-9)


def test_columns_in_parts_and_blocks_give_the_normal_equations_of_the_whole():
    """Parts of a log's columns, taken block by block as of a long log, sum to X'X and X'r of all in one: to rounding, 1e-12."""
    rng = np.random.default_rng(3)
    X, r = rng.standard_normal((5, 3, 1000)), rng.standard_normal((3, 1000))
    flat = X.reshape(5, -1)
    A, b = normal.normal_equations([(X[:3], X[3:])], [r], at_once=300)
    assert pytest.approx(flat @ flat.T, rel=1e-12, abs=1e-12 * flat.size) == A
    assert b == pytest.approx(flat @ r.ravel(), rel=1e-12, abs=1e-12 * flat.size)


def test_errors_of_few_blocks_hold_the_truth_as_often_as_they_say():
    """Nine blocks of 2 s, each off by an offset of its own, 2000 times: the mean is within 2 errors in 95.4 % (chance 0.5 %)."""
    n, rng, misfit_of = 9, np.random.default_rng(0), lambda offsets: np.repeat(offsets, 20)[None] - offsets.mean()
    log = SimpleNamespace(time=np.arange(n * 20 + 1) * 0.1)
    problem: Any = SimpleNamespace(logs=(log,))
    columns = [[np.ones((1, 1, n * 20))]]
    A = np.array([[float(n * 20)]])
    held = []
    for offsets in rng.standard_normal((2000, n)):
        scores = normal.without_each(A, columns, [misfit_of(offsets)], problem, 2.0)
        held.append(abs(offsets.mean()) < 2.0 * covariance.scattered(A, np.zeros(1), scores)[0, 0] ** 0.5)
    assert np.mean(held) == pytest.approx(0.954, abs=0.015)
