"""Coordinates of a second-order lag in which its answer is nearly linear, for the steps of a fit.

    1/(1 + a s + b s^2),   a = 2 zeta/omega (the delay of slow motion),   b = 1/omega^2

Slow motion is off in proportion to a and b. Logs know a well and b badly: in frequency and damping that is a bent, narrow valley, in
which a whole step leaves it and a damped one hardly moves. With the fit's coordinates x (of 1/frequency) and d (of damping) a step
is taken in (x d, x^2).
"""

from __future__ import annotations

import numpy as np

from hexsim.tracing.fitting.fit import Fit

Array = np.ndarray
LEAST = 1e-4  # x of a lag that is none: there d does nothing


def lags_of(fit: Fit) -> list[tuple[int, int]]:
    """Places of x and d of every lag of the fit whose frequency and damping are both free."""
    places, at = [], len(fit.priors)
    for candidate in fit.candidates:
        numbers = candidate.free()
        if candidate.effect.second_order_lag and len(numbers) == 2:
            places.append((at, at + 1))
        at += len(numbers)
    return places


def straight(coordinates: Array, lags: list[tuple[int, int]]) -> Array:
    """A fit's coordinates with (x d, x^2) in the place of each (x, d)."""
    found = coordinates.copy()
    for i, j in lags:
        found[i], found[j] = coordinates[i] * coordinates[j], coordinates[i] ** 2
    return found


def straight_bounds(low: Array, high: Array, lags: list[tuple[int, int]]) -> tuple[Array, Array]:
    """The box that holds all that the bounds of a fit's coordinates allow."""
    below = straight(low, lags)
    below[[j for _, j in lags]] = LEAST**2
    return below, straight(high, lags)


def slopes(coordinates: Array, lags: list[tuple[int, int]]) -> Array:
    """Derivative of a fit's coordinates by the straight ones, (k, k)."""
    found = np.eye(len(coordinates))
    for i, j in lags:
        x, d = max(coordinates[i], LEAST), coordinates[j]
        found[i, [i, j]] = 0.0, 0.5 / x
        found[j, [i, j]] = 1.0 / x, -0.5 * d / x**2
    return found


def bent(found: Array, lags: list[tuple[int, int]], low: Array, high: Array) -> Array:
    """The fit's coordinates, inside their bounds; where the damping would leave its own, the delay is kept."""
    coordinates = found.copy()
    for i, j in lags:
        damping = np.clip(found[i] / np.sqrt(max(found[j], LEAST**2)), low[j], high[j])
        coordinates[i], coordinates[j] = found[i] / damping, damping
    return np.clip(coordinates, low, high)
