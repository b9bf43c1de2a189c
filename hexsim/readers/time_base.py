"""The time base of a log: usable stamps, one rate, late channels moved."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import median_filter

from hexsim.errors import HexsimError
from hexsim.readers.cleaning import Cleaning, held
from hexsim.readers.faulty_values import LARGEST
from hexsim.readers.gaps import SHORTEST_S
from hexsim.readers.stamps import long_period, recount_rows

WANDERS = 2.5  # steps between samples that wander, above which rows are missing
RATES_Hz = (5.0, 20_000.0)


def clean_time(log: Cleaning) -> None:
    """Drop unusable time stamps: missing, wild, repeated, backward. Refuses a file that holds two runs."""
    finite = np.abs(log.time) < LARGEST  # False for NaN
    drop(log, finite, "rows without a time stamp")
    if len(log.time) < 10:
        raise HexsimError(f"{log.path} has {len(log.time)} usable rows: give at least {SHORTEST_S:g} s of data")
    spread_coarse_stamps(log)
    typical = (log.time[-1] - log.time[0]) / (len(log.time) - 1) if np.ptp(log.time) else 0.0
    typical = float(np.median(np.abs(np.diff(log.time)))) or abs(typical)
    if not typical > 0:
        raise HexsimError(f"{log.path}: time_s stands still (row {log.row(1)} and after): is it a column of time?")
    wild = np.abs(log.time - median_filter(log.time, 5, mode="nearest")) > 20 * typical
    wild[[0, 1, -2, -1]] = False
    drop(log, ~wild, "time stamps that fit neither neighbour")
    steps = np.diff(log.time)
    back = np.flatnonzero(steps < -20 * typical)
    if len(back):
        i = int(back[0])
        raise HexsimError(
            f"{log.path}: time_s goes back from {log.time[i]:.6g} to {log.time[i + 1]:.6g} s in row {log.row(i + 1)}: "
            "two runs in one file? split it there"
        )
    recount_rows(log)
    drop(log, np.append(True, np.diff(log.time) != 0), "repeated time stamps")
    highest = np.maximum.accumulate(log.time)
    drop(log, np.append(True, log.time[1:] > highest[:-1]), "backward time stamps")


def drop(log: Cleaning, good: np.ndarray, what: str) -> None:
    """Drop rows with a stated loss; refuse when that is more than a fifth."""
    bad = np.flatnonzero(~good)
    if len(bad) == 0:
        return
    sentence = f"{len(bad)} {what}, the first in row {log.row(int(bad[0]))}"
    if len(bad) > 0.2 * len(good):
        raise HexsimError(
            f"{log.path}: time_s has {sentence}, of {len(good)} rows: this is no time base; give one that rises"
        )
    log.losses.append(f"{sentence}: dropped")
    log.keep(good)


def spread_coarse_stamps(log: Cleaning) -> None:
    """Stamps with too few digits repeat in groups of one size: spread each group evenly."""
    t = log.time
    changes = np.flatnonzero(np.diff(t) != 0) + 1
    if len(changes) < 10 or len(changes) > 0.6 * len(t):
        return
    groups = np.diff(changes)
    size = int(np.median(groups))
    if size < 3 or np.mean(np.abs(groups - size) <= 1) < 0.95 or np.any(np.diff(t) < 0):
        return
    log.losses.append(f"time_s has too few digits ({size} rows share a stamp): stamps spread evenly")
    log.time = np.interp(np.arange(len(t)), changes, t[changes])
    inside = (np.arange(len(t)) >= changes[0]) & (np.arange(len(t)) <= changes[-1])
    log.keep(inside)


def uniform(log: Cleaning) -> float:
    """Put all signals on one uniform grid; returns the rate [Hz]. Gaps longer than FILL samples stay missing."""
    t = log.time
    steps = np.diff(t)
    typical = float(np.median(steps))
    period = long_period(t) if log.wanders else float(np.mean(steps[steps < 1.5 * typical]))
    hole = WANDERS if log.wanders else 1.5  # of a step
    rate = 1.0 / period
    if abs(rate - round(rate)) < 1e-4 * rate:
        rate = float(round(rate))
    if not RATES_Hz[0] <= rate <= RATES_Hz[1]:
        raise HexsimError(
            f"{log.path}: time_s steps by {period:.4g}, that is {rate:.4g} Hz; allowed are {RATES_Hz[0]:g} to "
            f"{RATES_Hz[1]:g} Hz: "
            "is the column in seconds? name its unit in a mapping file"
        )
    gaps = np.flatnonzero(steps > hole * typical)
    if len(gaps):
        lost = int(np.sum(np.round(steps[gaps] * rate) - 1))
        if lost > 50 * len(t):
            raise HexsimError(
                f"{log.path}: time_s has gaps of {lost} samples, the first after row {log.row(int(gaps[0]))}: cut it"
            )
        log.losses.append(
            f"{len(gaps)} gaps in time_s, {lost} samples in all, the first after row {log.row(int(gaps[0]))}"
        )
    whole = np.zeros(len(steps), bool) if log.wanders else steps > hole * typical
    place = np.concatenate([[0.0], np.cumsum(np.where(whole, np.round(steps * rate), steps * rate))])
    if log.wanders:  # about the grid that the samples wander about
        place -= float(np.angle(np.mean(np.exp(2j * np.pi * place)))) / (2 * np.pi)
    n = round(place[-1]) + 1
    grid = np.arange(n)
    if n == len(t) and np.max(np.abs(place - grid)) < 0.1:  # uniform but for rounding of the stamps
        log.time = t[0] + grid / rate
        return rate
    jitter = np.abs(place - np.round(place))
    if np.max(jitter) >= 0.1:
        log.losses.append(
            f"time stamps wander by up to {np.max(jitter) / rate * 1e3:.3g} ms: signals put on an even grid"
        )
    before = np.clip(np.searchsorted(place, grid, side="right") - 1, 0, len(t) - 1)
    after = np.minimum(before + 1, len(t) - 1)
    inside = (place[after] - place[before]) < hole
    on_stamp = np.abs(place[before] - grid) < 0.1
    for name, values in log.signals.items():
        new = between(grid, place, values, smooth=log.wanders and not held(name))
        nearest = np.where(np.abs(place[after] - grid) < np.abs(place[before] - grid), after, before)
        exact = np.abs(place[nearest] - grid) < 0.1
        new[exact] = values[nearest[exact]]
        ticks = held_between_ticks(place, values, grid) if held(name) and np.max(jitter) >= 0.1 else None
        new = new if ticks is None else ticks
        new[~(inside | on_stamp | exact)] = np.nan
        log.signals[name] = new
    log.kept = log.kept[np.minimum(before, len(log.kept) - 1)]
    log.time = t[0] + grid / rate
    return rate


def between(grid: np.ndarray, place: np.ndarray, x: np.ndarray, smooth: bool) -> np.ndarray:
    """x (n,) at places, on the grid (m,): straight lines, or a cubic spline, which keeps what is fast. NaN spreads."""
    good = np.isfinite(x)
    if not smooth or good.sum() < 8:
        return np.interp(grid, place, x)
    new = make_interp_spline(place[good], x[good], k=3)(np.clip(grid, place[good][0], place[good][-1]))
    new[np.isnan(np.interp(grid, place, x))] = np.nan
    return new


def held_between_ticks(place: np.ndarray, x: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """A signal (n,) that a computer holds between even ticks, sampled at places that wander, on the grid (m,); None for others.

    A tick lies between the two samples of every change. Of the samples of a tick the one nearest its middle counts.
    """
    changes = np.flatnonzero(np.diff(x) != 0)
    hold = round(float(np.median(np.diff(changes)))) if len(changes) > 50 else 1
    if hold < 2:
        return None
    behind = [hold * np.ceil((place[changes] - first) / hold) + first <= place[changes + 1] for first in range(hold)]
    first = int(np.argmax([np.mean(found) for found in behind]))
    if np.mean(behind[first]) < 0.95:
        return None
    tick = np.floor((place - first) / hold).astype(int)
    order = np.lexsort((np.abs(place - first - hold * (tick + 0.5)), tick))
    known, at = np.unique(tick[order], return_index=True)
    asked = np.floor((grid - first) / hold + 1e-9).astype(int)
    return x[order][at][np.clip(np.searchsorted(known, asked), 0, len(known) - 1)]


def shift_delays(log: Cleaning, delays: dict[str, float], rate: float) -> None:
    """Move late channels forward; the end that has no value is cut."""
    if not any(delays.values()):
        return
    n = len(log.time)
    for name, delay in delays.items():
        if delay and name in log.signals:
            if abs(delay) * rate >= n - 1:
                raise HexsimError(
                    f"{log.path}: [columns.{name}] delay_s = {delay:g} in the mapping is longer than the log "
                    f"({(n - 1) / rate:.3g} s): give the delay in seconds"
                )
            log.signals[name] = np.interp(
                np.arange(n) + delay * rate, np.arange(n), log.signals[name], left=np.nan, right=np.nan
            )
            log.losses.append(f"column {name} was late by {delay * 1e3:g} ms (mapping): moved forward")
