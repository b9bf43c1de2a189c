"""When samples were taken: from a clock's stamps as they stand in a file to times that rise.

Stamps may be right, jittered or coarse. The step between two stamps of a logger is

    d_k = T + w_k + e_k - e_(k-1)        w: wander of the sampling, e: error of the stamp

so that variances of steps over one and over L rows tell both apart, var(t_(k+L) - t_k) = L var(w) + 2 var(e). What looks
like an error of the stamp may still be the sampling (a loop that sleeps until the next tick and wakes up late). Only the
signals tell: a sample that is late by j reads dx/dt j more than an even one, a stamp that is late reads nothing.
Without evidence that stamps are wrong they are kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from hexsim.errors import HexsimError
from hexsim.readers.clock_group import ClockGroup, is_held, runs
from hexsim.signals.weak_form import Window

Array = np.ndarray


class Stamps(NamedTuple):
    """Limits of time stamps."""

    least: int = 10  # samples of a clock
    largest: float = 1e30  # in any SI unit: beyond it a number is damage
    far: int = 20  # periods: a stamp that is alone so far off is wild; a log that falls back by more begins anew
    even: float = 1e-3  # of a period: stamps as near as this to an even grid are on it
    near: int = 24  # rows on either side, at least, that tell how many are missing between them
    long: int = 100  # rows over which wander and jitter are told apart


STAMPS = Stamps()

COUNTS = tuple(2.0**bits for bits in (15, 16, 24, 31, 32))  # values at which counters wrap


def settle(group: ClockGroup) -> None:
    """Settle when the samples of a group were taken, with a note of all that was changed. HexsimError where the stamps
    are no time base."""
    start_at_the_clock(group)
    drop(group, np.abs(group.time) < STAMPS.largest, "without a time stamp")  # False for NaN
    if len(group.time) < STAMPS.least:
        raise HexsimError(
            f"{group.path} has {len(group.time)} usable rows of {group.clock}: give at least 0.5 s of data"
        )
    typical = typical_step(group)
    if np.median(np.sign(np.diff(group.time))) < 0:
        group.keep(np.arange(len(group.time))[::-1])
        group.note("the newest row stood first: turned round")
    unwrap(group, typical)
    wild = np.abs(group.time - scipy.ndimage.median_filter(group.time, 5, mode="nearest")) > STAMPS.far * typical
    wild[[0, 1, -2, -1]] = False
    drop(group, ~wild, "with time stamps that fit neither neighbour")
    back = np.flatnonzero(np.diff(group.time) < -STAMPS.far * typical)
    if len(back):
        i = int(back[0])
        raise HexsimError(
            f"{group.path}: {group.clock} goes back from {group.time[i]:.6g} to {group.time[i + 1]:.6g} s in row "
            f"{group.row(i + 1)}: two runs in one file? split it there"
        )
    if not judge(group):
        in_order(group)


def typical_step(group: ClockGroup) -> float:
    """Usual time between rows, whatever their order [s]."""
    steps = np.abs(np.diff(group.time))
    typical = float(np.median(steps)) or float(np.ptp(group.time)) / (len(group.time) - 1)
    if not typical > 0:
        raise HexsimError(f"{group.path}: {group.clock} stands still (row {group.row(1)} and after): is it a clock?")
    return typical


def drop(group: ClockGroup, good: Array, what: str) -> None:
    """Drop rows with a note; refuse when that is more than half."""
    bad = np.flatnonzero(~good)
    if len(bad) == 0:
        return
    sentence = f"{len(bad)} rows {what}, the first in row {group.row(int(bad[0]))}"
    if len(bad) > 0.5 * len(good):
        raise HexsimError(
            f"{group.path}: {group.clock} has {sentence}, of {len(good)} rows: this is no time base; give one that rises"
        )
    group.note(f"{sentence}: dropped")
    group.keep(good)


def start_at_the_clock(group: ClockGroup) -> None:
    """Stamps of zero before the first other one were written before the clock was set."""
    t = group.time
    other = np.flatnonzero(t != 0)
    if len(other) and other[0] > 1 and len(other) > STAMPS.least:
        steps = np.abs(np.diff(t[other]))
        usual = max(float(np.median(steps)), float(np.median(steps[steps > 0])) if steps.any() else 0.0)
        if usual > 0 and abs(t[other[0]]) > STAMPS.far * usual:
            drop(group, np.arange(len(t)) >= other[0], "before the clock was set (stamp 0)")


def unwrap(
    group: ClockGroup,
    typical: float,
    *,
    wrap_periods: int = 10,  # periods: a wrap with at most so many rows lost
    day_s: float = 86_400.0,  # at which a time of day does
) -> None:
    """Go on where a counter begins anew: it falls by all of its counts but for the time that has passed."""
    falls = np.flatnonzero(np.diff(group.time) < -STAMPS.far * typical)
    scales = (group.tick_s,) if group.tick_s != 1.0 else (1.0, 1e-3, 1e-6, 1e-9)
    ends = sorted({count * scale for count in COUNTS for scale in scales} | {day_s})
    for end in ends if len(falls) else ():
        step = np.diff(group.time)[falls] + end
        if np.all((step > 0) & (step < wrap_periods * typical)):
            group.time = group.time + end * np.searchsorted(falls, np.arange(len(group.time)))
            what = "the time of day passes midnight" if end == day_s else f"the counter wraps at {end:.9g} s"
            group.note(f"{what}, {len(falls)} times, the first after row {group.row(int(falls[0]))}: it goes on there")
            return


def in_order(group: ClockGroup) -> None:
    """Rows by their stamps, the first of those that share one."""
    order = np.argsort(group.time, kind="stable")
    moved = np.flatnonzero(np.diff(group.time) < 0)
    if len(moved):
        group.note(f"{len(moved)} rows are out of order, the first in row {group.row(int(moved[0]) + 1)}: sorted")
        group.keep(order)
    drop(group, np.append(True, np.diff(group.time) > 0), "repeat a time stamp")
    snap(group)


def snap(group: ClockGroup) -> None:
    """Stamps on an even grid, but for their rounding, are whole numbers of rows."""
    t = group.time
    period = long_period(t)
    place = np.append(0.0, np.cumsum(np.round(np.diff(t) / period)))
    if len(t) < STAMPS.least or np.any(np.diff(place) < 1):
        return
    slope, start = np.polyfit(place, t - t[0], 1)
    if np.max(np.abs(t - t[0] - start - slope * place)) < STAMPS.even * period:
        group.place = place


def judge(
    group: ClockGroup,
    *,
    widest_rows: int = 201,  # rows that a jittered stamp is averaged over, at most: a seventh of the jitter is left
    drift_order: int = 3,  # order of the curve by which the rate of a clock changes over a log
    widespread: float = 0.2,  # share of steps that are off; fewer are single faults, not the clock's way
    known_error: float = 0.15,  # standard error of the share of jitter that is in the signals, above which they say nothing
) -> bool:
    """Are the stamps off where the samples are even? Then, in place and with a note, the samples are counted."""
    t, n = group.time, len(group.time)
    period = long_period(t)
    steps = np.diff(t) / max(period, 1e-300)
    off = np.abs(steps - np.maximum(np.round(steps), 1.0)) > STAMPS.even
    if not period > 0 or np.mean(off) < widespread:
        return False
    place = np.arange(n) + lost_rows(t, period)
    slope, start = np.polyfit(place, t - t[0], 1)
    line = t[0] + start + slope * place
    rest = t - line
    drift = np.polynomial.Polynomial.fit(place, rest, drift_order)(place)
    wander, jitter = wander_and_jitter(rest - drift, place)
    resolution = resolution_of(t)
    rounded = float(np.ptp(rest)) < 1.05 * resolution
    shared = np.mean(np.diff(t) == 0) > widespread / 4  # no two samples are taken at once
    width = widest_rows if wander == 0 else int(np.sqrt(48.0) * jitter / wander)  # where both errors are equal
    width = min(width, widest_rows, n // 2) // 2 * 2 + 1
    if not (rounded or shared) and (jitter < STAMPS.even * period or width < 2 * STAMPS.near // 3):
        return False
    local: Array = np.asarray(scipy.signal.savgol_filter(rest - drift, width, 1)) if width > 2 else rest - drift
    slow = drift + local
    evidence = f"their error is below their resolution of {resolution * 1e3:.3g} ms"
    if not rounded:
        share, error = share_in_signals(group, place, rest - slow, slope)
        told = error < known_error
        if not shared and told and share > 0.5:
            group.note(
                f"stamps wander by {np.std(rest - slow) * 1e3:.3g} ms and so do the samples ({share:.2f} +- {error:.2f} "
                "of it is seen in the signals): kept"
            )
            return False
        if not shared and not (told and share + 2 * error < 0.5):
            group.note(f"stamps may be off by {np.std(rest - slow) * 1e3:.3g} ms; the signals do not tell: kept")
            return False
        evidence = f"{share:.2f} +- {error:.2f} of it is seen in the signals" if told else "rows share their stamps"
    chance = jitter * np.sqrt(1.0 / width + (drift_order + 1) / n)  # of the smoothed stamps of an even clock
    drifts = float(np.std(slow)) > 3.0 * chance and not rounded
    group.time = line + (slow if drifts else 0.0)
    group.off_s = float(np.std(rest - slow if drifts else rest))
    group.place = None if drifts and float(np.ptp(slow)) > 2 * STAMPS.even * period else place
    group.note(
        f"time stamps are off by {group.off_s * 1e3:.3g} ms (one standard deviation) where the "
        f"samples are even ({evidence}): rows counted instead, {1 / slope:.6g} Hz"
        + (f", with a drift of {np.ptp(slow) * 1e3:.3g} ms" if drifts else "")
    )
    return True


def wander_and_jitter(rest: Array, place: Array) -> tuple[float, float]:
    """(wander of a step, jitter of a stamp), standard deviations, from stamps (n,) less a smooth curve; over no
    lost rows. 0 where unseen."""
    lag = max(min(STAMPS.long, len(rest) // 10), 2)
    whole = {k: place[k:] - place[:-k] == k for k in (1, lag)}
    if min(map(np.sum, whole.values())) < STAMPS.least:
        return 0.0, 0.0
    one, many = (float(np.var((rest[k:] - rest[:-k])[there])) for k, there in whole.items())
    square = (many - one) / (lag - 1)
    unsure = many * np.sqrt(2.0 * lag / len(rest)) / lag  # one standard error of the square
    wander = max(square, 0.0) if square > 2.0 * unsure else 0.0
    return float(np.sqrt(wander)), float(np.sqrt(max(one - wander, 0.0) / 2.0))


def resolution_of(t: Array) -> float:
    """The step of which all differences of the stamps are multiples; 0 where there is none."""
    steps = np.abs(np.diff(t))
    steps = steps[steps > 0]
    least = float(np.min(steps, initial=np.inf))
    if not np.isfinite(least):
        return 0.0
    size = float(np.mean(steps[steps < 1.5 * least]))
    multiples = steps / size
    return (
        size if np.mean(np.abs(multiples - np.round(multiples)) < 0.1 * STAMPS.even + 1e-6 * multiples) > 0.99 else 0.0
    )


def long_period(t: Array) -> float:
    """Time between two rows by rows a hundred apart: neither jitter nor a hole moves it."""
    lag = max(min(STAMPS.long, len(t) // 4), 1)
    return float(np.median(t[lag:] - t[:-lag])) / lag


def lost_rows(t: Array, period: float) -> Array:
    """Rows (n,) that are missing before each row, by the means of the stamps' errors on either side.

    Means over as many rows as make jitter a tenth of a period; a resolution of any step is even over 24 rows.
    """
    error = t - period * np.arange(len(t))
    wander = 1.4826 * float(np.median(np.abs(np.diff(t) - period))) / np.sqrt(2.0)
    near = 2 * round(np.clip((10.0 * wander / period) ** 2, STAMPS.near // 2, 8 * STAMPS.near))
    lost, sums = np.zeros(len(t)), np.append(0.0, np.cumsum(error))
    if len(t) < 3 * near:
        return lost
    means = (sums[near:] - sums[:-near]) / near
    step = np.zeros(len(t))
    step[near : len(t) - near + 1] = means[near:] - means[:-near]
    for start, stop in zip(*runs(step > 0.6 * period), strict=True):
        k = start + int(np.argmax(step[start:stop]))
        before, after, beside = means[k - near], means[k], error[k - STAMPS.near // 2 : k + STAMPS.near // 2]
        misfit = np.append(0.0, np.cumsum(np.abs(beside - before) - np.abs(beside - after)))
        lost[k - STAMPS.near // 2 + int(np.argmin(misfit))] += np.round(step[k] / period)
    return np.cumsum(lost)


def share_in_signals(group: ClockGroup, place: Array, jitter: Array, period: float) -> tuple[float, float]:
    """(share of the jitter that the signals show, its standard error): 1 samples wander, 0 only their stamps do."""
    together = cross = 0.0
    whole = np.lib.stride_tricks.sliding_window_view(np.diff(place), 6).max(axis=-1) == 1
    window = Window(1.0 / period)
    for name, values in group.signals.items():
        good = np.isfinite(values)
        if is_held(name) or name in group.held or good.sum() < 0.5 * len(values):
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
