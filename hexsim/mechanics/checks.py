"""Checks of arguments: shapes of arrays, and piston positions within the strokes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError

Array = NDArray[np.float64]


def as_rows(values: ArrayLike, name: str, n: int) -> tuple[Array, tuple[int, ...]]:
    """`values` of shape (..., n) as contiguous rows (m, n), and the leading axes to give back."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != n:
        raise HexsimError(f"{name} has shape {array.shape}; it needs {n} numbers in its last axis, shape (..., {n}).")
    return array.reshape(-1, n), array.shape[:-1]


def check_reach(
    positions: ArrayLike,
    retracted_length_m: Array,
    stroke_m: Array,
    where: Callable[[int], str],
    margin_m: float = 0.0,
) -> None:
    """HexsimError naming leg, length and limits of the first row of positions (..., n) [m] outside the strokes.

    retracted_length_m, stroke_m: (n,). where(row) begins the sentence. margin_m is kept free at both ends of each stroke.
    """
    rows, _ = as_rows(positions, "piston positions", len(retracted_length_m))
    inside = (rows >= margin_m) & (rows <= stroke_m - margin_m)  # NaN is not inside
    if inside.all():
        return
    row = int(np.argmin(inside.all(axis=1)))
    beyond = np.where(inside[row], -1.0, np.nan_to_num(np.abs(rows[row] - 0.5 * stroke_m), nan=np.inf))
    leg = int(np.argmax(beyond >= beyond.max() - 1e-9))  # of legs alike to rounding, the first
    retracted = float(retracted_length_m[leg])
    low, high = retracted + margin_m, retracted + float(stroke_m[leg]) - margin_m
    raise HexsimError(
        f"{where(row)}: leg {leg + 1} would need to be {retracted + rows[row, leg]:.4f} m long, "
        f"allowed is {low:.4f} to {high:.4f} m; make the motion smaller or the stroke longer."
    )
