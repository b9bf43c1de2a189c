"""Time stamps that are off, of samples that are even: rows are counted instead.

Row k of an even logger is taken at T (k + rows lost before it). Its stamp is that plus an error: jitter of the computer
that stamps, or a resolution that is too coarse. Whether samples really wander is seen in the signals: a sample that is
late by j reads dx/dt j more than an even one, a stamp that is late reads nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from hexsim.readers.cleaning import Cleaning, held, runs
from hexsim.signals.weak_form import Window

WIDESPREAD = 0.2  # share of steps that are off; fewer are single faults, which are dropped
OFF = 0.02  # of a period: a step that is off
NEAR = 24  # rows on either side, at least, that tell how many are missing between them
KNOWN = 0.2  # standard error of the share of jitter that is in the signals, above which it does not matter


def recount_rows(log: Cleaning) -> None:
    """Even time stamps for even samples, in place and with a stated loss; what really wanders keeps its stamps."""
    t, n = log.time, len(log.time)
    period = long_period(t)
    steps = np.diff(t) / max(period, 1e-300)
    if not period > 0 or np.mean(np.abs(steps - np.maximum(np.round(steps), 1.0)) > OFF) < WIDESPREAD:
        return
    place = np.arange(n) + lost_rows(t, period)
    slope, start = np.polyfit(place, t, 1)
    start += float(np.median(t - start - slope * place))
    jitter = t - start - slope * place
    if np.std(jitter) > NEAR * period:
        return
    share, error = share_in_signals(log, place, jitter - uniform_filter1d(jitter, 4 * NEAR), slope)
    if share > 0.5 and error < KNOWN:
        log.wanders = True
        return
    log.time = start + slope * place
    log.losses.append(
        f"time stamps are off by {np.std(jitter) * 1e3:.3g} ms (one standard deviation) where the samples are even: "
        f"rows counted instead, {1 / slope:.6g} Hz"
    )


def long_period(t: np.ndarray) -> float:
    """Time between two rows by rows a hundred apart: neither jitter nor a hole moves it."""
    lag = min(100, len(t) // 4)
    return float(np.median(t[lag:] - t[:-lag])) / lag


def lost_rows(t: np.ndarray, period: float) -> np.ndarray:
    """Rows (n,) that are missing before each row, by the means of the stamps' errors on either side.

    Means over as many rows as make jitter a tenth of a period; a resolution of any step is even over 24 rows.
    """
    error = t - period * np.arange(len(t))
    wander = float(np.std(np.diff(t))) / np.sqrt(2.0)
    near = 2 * round(np.clip((10.0 * wander / period) ** 2, NEAR // 2, 8 * NEAR))
    lost, sums = np.zeros(len(t)), np.append(0.0, np.cumsum(error))
    if len(t) < 3 * near:
        return lost
    means = (sums[near:] - sums[:-near]) / near
    step = np.zeros(len(t))
    step[near : len(t) - near + 1] = means[near:] - means[:-near]
    for start, stop in zip(*runs(step > 0.6 * period), strict=True):
        k = start + int(np.argmax(step[start:stop]))
        before, after, beside = means[k - near], means[k], error[k - NEAR // 2 : k + NEAR // 2]
        misfit = np.append(0.0, np.cumsum(np.abs(beside - before) - np.abs(beside - after)))
        lost[k - NEAR // 2 + int(np.argmin(misfit))] += np.round(step[k] / period)
    return np.cumsum(lost)


def share_in_signals(log: Cleaning, place: np.ndarray, jitter: np.ndarray, period: float) -> tuple[float, float]:
    """(share of the jitter that the signals show, its standard error): 1 samples wander, 0 only their stamps do."""
    together = cross = 0.0
    whole = np.lib.stride_tricks.sliding_window_view(np.diff(place), 6).max(axis=-1) == 1
    window = Window(1.0 / period)
    for name, values in log.signals.items():
        good = np.isfinite(values)
        if held(name) or good.sum() < 0.5 * len(values):
            continue
        x = np.interp(place, place[good], values[good])
        seen, asked = np.diff(x, 6), np.diff(window.rate(x) * jitter, 6)
        use = whole & good[3:-3]
        size = 1.4826 * float(np.median(np.abs(seen[use]))) if use.any() else 0.0
        use &= np.abs(seen) < 5 * size
        if size > 0:
            cross += float(seen[use] @ asked[use]) / size**2
            together += float(asked[use] @ asked[use]) / size**2
    return cross / max(together, 1e-300), 1.0 / np.sqrt(max(together, 1e-300))
