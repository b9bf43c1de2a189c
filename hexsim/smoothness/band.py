"""Acceleration in a stated band: a zero-phase low-pass, and the check that a record can be filtered at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.compiled import compiled
from hexsim.errors import HexsimError

Array = NDArray[np.float64]

BANDWIDTH_Hz = 50.0  # default band of every acceleration figure
PADDING_PERIODS = 5.0  # padding at either end, in periods of the bandwidth: 0.1 s at 50 Hz


def sample_rate_Hz(
    time_s: ArrayLike,
    *,
    tolerance: float = 0.01,  # a step may differ by 1 % from the mean step: time stamps rounded in a text file
) -> float:
    """Rate of an evenly sampled record; HexsimError naming the row where it is not even."""
    time = np.asarray(time_s, dtype=float)
    if time.ndim != 1 or len(time) < 2:
        raise HexsimError(f"A record of {time.size} samples has no sample rate; give at least two time stamps.")
    step = (time[-1] - time[0]) / (len(time) - 1)
    uneven = ~(np.abs(np.diff(time) - step) <= tolerance * abs(step))
    if not step > 0.0 or uneven.any():
        row = int(np.argmax(uneven)) + 1
        raise HexsimError(
            f"time_s is not evenly sampled: row {row + 1} comes {time[row] - time[row - 1]:g} s after the row before, "
            f"the mean step is {step:g} s; resample the record first."
        )
    return 1.0 / step


def inner_span_s(
    time_s: ArrayLike,
    bandwidth_Hz: float | None,
    *,
    edge_periods: float = 2.0,  # in which the result leans on the padding: 40 ms at 50 Hz
) -> tuple[float, float]:
    """From when to when a band-limited record stands on its own: 2 / bandwidth (40 ms at 50 Hz) inside its ends."""
    time = np.asarray(time_s, dtype=float)
    edge = 0.0 if bandwidth_Hz is None else edge_periods / bandwidth_Hz
    half_step = 0.5 * (time[-1] - time[0]) / (len(time) - 1)
    return float(time[0] + edge - half_step), float(time[-1] - edge + half_step)


def band_limit(
    time_s: ArrayLike,
    signal: ArrayLike,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    *,
    order: int = 4,  # of the Butterworth filter, run forward and backward
) -> Array:
    """The signal (n, ...) below `bandwidth_Hz`, without phase shift; None leaves it as it is.

    A 4th-order Butterworth low-pass run forward and backward: |H| = 1 / (1 + (f/fb)^8), so the gain is 1/2 (-6 dB) at
    the bandwidth itself, 0.9998 at 0.35 of it and 0.004 at twice it. A record sampled at less than twice the bandwidth
    is returned as it is: it holds nothing above the band.

    Ends: the record is continued over 5 periods of the bandwidth (0.1 s at 50 Hz) by its reflection about the straight
    line fitted to as much of it. Lines stay lines; a wave above 10 Hz is off by up to a third of its size at the
    very end (109 Hz ringing too, though little of it belongs in the band), and by less than 0.5 % 40 ms inside (see
    `inner_span_s`). The figures of this package leave the ends out, or continue a periodic record by its own period.
    """

    values = np.asarray(signal, dtype=float)
    rate = sample_rate_Hz(time_s)
    if len(values) != len(np.asarray(time_s)):
        raise HexsimError(f"The signal has {len(values)} samples, time_s has {len(np.asarray(time_s))}; give as many.")
    finite = np.isfinite(values)
    if not finite.all():
        raise HexsimError(f"The signal is not finite in row {int(np.argwhere(~finite)[0][0]) + 1}; cut or mend it.")
    if bandwidth_Hz is None or bandwidth_Hz >= 0.5 * rate:
        return values.copy()
    if not bandwidth_Hz > 0.0:
        raise HexsimError(f"bandwidth_Hz is {bandwidth_Hz}; it must be greater than 0.")
    samples = min(int(np.ceil(PADDING_PERIODS * rate / bandwidth_Hz)), len(values) - 1)
    before, after = _continued(values[::-1], samples)[::-1], _continued(values, samples)
    padded = np.concatenate([before, values, after])
    columns = padded.reshape(len(padded), -1).T.copy()
    _run_both_ways(low_pass_sections(order, bandwidth_Hz / rate), columns)
    return columns.T.reshape(padded.shape)[samples : samples + len(values)]


def low_pass_sections(order: int, cut_off: float) -> Array:
    """(b0, b1, b2, a1, a2) of each second-order section of a Butterworth low-pass of even order, by the bilinear rule.

    cut_off: over the sample rate. As `scipy.signal.butter` (which is 0.5 s of start-up in every run), gain 1 in each section.
    """
    omega = np.tan(np.pi * cut_off)
    damping = np.cos(np.pi * (np.arange(order // 2) + 0.5) / order)
    below = 1.0 + 2.0 * damping * omega + omega**2
    gain = omega**2 / below
    a2 = (1.0 - 2.0 * damping * omega + omega**2) / below
    return np.column_stack([gain, 2.0 * gain, gain, 2.0 * (omega**2 - 1.0) / below, a2])


@compiled
def _run_both_ways(sections, columns):
    """Filter each column (n,) of (k, n) forward and backward in place, each way from rest at its first value."""
    n = columns.shape[1]
    for column in columns:
        for way in range(2):
            first, step = (0, 1) if way == 0 else (n - 1, -1)
            for b0, b1, b2, a1, a2 in sections:
                x = column[first]
                s1, s2 = (1.0 - b0) * x, (b2 - a2) * x
                for k in range(n):
                    x = column[first + step * k]
                    y = b0 * x + s1
                    s1 = b1 * x - a1 * y + s2
                    s2 = b2 * x - a2 * y
                    column[first + step * k] = y


def _continued(values: Array, samples: int) -> Array:
    """`samples` more of a signal (n, ...): its last ones backwards, tilted so that their fitted slope goes on."""
    last = values[-samples - 1 :]
    steps = np.arange(samples + 1) - 0.5 * samples
    slope = np.tensordot(steps, last, axes=1) / np.sum(steps**2)
    return last[-2::-1] + 2.0 * np.multiply.outer(np.arange(1.0, samples + 1.0), slope)
