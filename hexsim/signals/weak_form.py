"""Weak form: balances under a window, so that no noisy signal is differentiated.

w(s) = (1 - s^2)^3 of unit sum on |s| < 1;   <w, dP/dt> = -<w', P>,   <w, C dP/dt> = -<w', C P> - <w, C' P>
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

Array = np.ndarray
WHOLE = slice(None)
HALF_WIDTH_S = 0.02  # [s] of the window: 4 periods of noise at 109 Hz fall out, reversals stay
SHORT_S = 0.006  # [s] of one under which the oil's own motion is seen, and that few reversals meet
WIDE_S = 2.0 * HALF_WIDTH_S  # under it d2y/dt2 of a position of 3 um noise is about as quiet as an accelerometer


@cache
def _kernels(half: int, dt: float) -> tuple[Array, Array, Array]:
    """w and its first two time derivatives, (2 half + 1,) each."""
    s = np.arange(-half, half + 1) / (half + 1.0)
    scale = dt * (half + 1.0)
    w = (1 - s**2) ** 3
    total = w.sum()
    first = -6 * s * (1 - s**2) ** 2 / scale / total
    second = (-6 * (1 - s**2) ** 2 + 24 * s**2 * (1 - s**2)) / scale**2 / total
    # discrete moments made exact: a ramp has slope 1, a constant none, a parabola 2
    t = dt * np.arange(-half, half + 1)
    first /= -np.sum(first * t)
    second -= second.mean()
    second *= 2.0 / np.sum(second * t**2)
    return w / total, first, second


class Window:
    """The window at a sample rate. Arrays (..., n) in, (..., n) out; `half` samples at either end are not valid.

    at: the samples that are asked for, (..., n_at) out. Few of them cost less.
    """

    def __init__(
        self,
        rate: float,
        half_width_s: float = HALF_WIDTH_S,
        at: slice = WHOLE,
    ):
        self.half = max(round(half_width_s * rate), 2)
        self.dt = 1.0 / rate
        self.at = at

    def _apply(self, x: Array, kernel: Array) -> Array:
        x = np.asarray(x, dtype=float)
        first, stop, every = self.at.indices(x.shape[-1])
        if every == 1 or first < self.half or stop + self.half > x.shape[-1]:
            return scipy.ndimage.convolve1d(x, kernel, axis=-1, mode="nearest")[..., self.at]
        seen = sliding_window_view(x, 2 * self.half + 1, axis=-1)
        return seen[..., first - self.half : stop - self.half : every, :] @ kernel[::-1]

    def mean(self, x: Array) -> Array:
        """<w, x>."""
        return self._apply(x, _kernels(self.half, self.dt)[0])

    def rate(self, x: Array) -> Array:
        """<w, dx/dt> = -<w', x>."""
        reference = x[..., :1]
        return self._apply(x - reference, -_kernels(self.half, self.dt)[1][::-1])

    @property
    def roughness(self) -> float:
        """Noise of `rate` over noise of `mean`, of a white signal [1/s]."""
        w, first, _ = _kernels(self.half, self.dt)
        return float(np.sqrt(np.sum(first**2) / np.sum(w**2)))

    def second_rate(self, x: Array) -> Array:
        """<w, d2x/dt2> = <w'', x>."""
        reference = x[..., :1]
        return self._apply(x - reference, _kernels(self.half, self.dt)[2])


def velocity(position: Array, acceleration: Array | None, rate: float, half_width_s: float = WIDE_S) -> Array:
    """Velocity [m/s]: slow part from the position, fast part from the integrated acceleration where there is one."""
    window = Window(rate, half_width_s)
    slow = window.rate(position)
    if acceleration is None:
        return slow
    integral = (
        np.concatenate(
            [
                np.zeros((*acceleration.shape[:-1], 1)),
                np.cumsum(0.5 * (acceleration[..., 1:] + acceleration[..., :-1]), axis=-1),
            ],
            axis=-1,
        )
        / rate
    )
    return slow + integral - window.mean(integral)
