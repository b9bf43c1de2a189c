"""How well a refit knows its coordinates, where what is left of the logs is not white.

A controller reads its transducer's noise and shakes the machine with it, most at the frequency of the oil, at which a hose
or a mass shows. So the errors come from the scatter of blocks of the logs:

    A^-1 (S + P) A^-1,   S = sum g g' over blocks of `rules.BLOCK_S`,   g = X'r of a block,   P: the priors' precision

A: normal matrix with P. No error is less than that of white noise, A^-1: of 12 s on a bench it came out 2 to 4 times too
small for a hose and for friction. Beside a misfit the blocks scatter more, and the errors grow with it.
"""

from __future__ import annotations

import math

import numpy as np

Array = np.ndarray


def inverse(A: Array) -> Array:
    """Of a normal matrix whose coordinates have sizes of their own; directions that no log knows stay unknown."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.linalg.pinv(A * scale[:, None] * scale, rcond=1e-12, hermitian=True) * scale[:, None] * scale


def scattered(A: Array, precision: Array, scores: Array) -> Array:
    """Covariance (k, k) of all coordinates. precision: P's diagonal, of the first coordinates; scores: g of every block."""
    g = scores * math.sqrt(len(scores) / (len(scores) - 1))
    S, own = g.T @ g, np.arange(len(precision))
    S[own, own] += precision
    white = inverse(A)
    found = white @ S @ white
    grown = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(found), 1e-300), 1.0))
    return found * grown[:, None] * grown
