"""A uniform time base and finite values, each repair counted. Nothing is repaired silently."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from hexsim.errors import HexsimError
from hexsim.signals.table import places

FILL = 10  # samples: shorter gaps are filled by a straight line, longer ones end a stretch
SHORTEST_S = 0.5  # [s] shorter logs are refused
RATES_Hz = (5.0, 20_000.0)
RESTING_s = 0.25  # a quantised signal may stand still for longer when nothing moves
LARGEST = 1e30  # in any SI unit: beyond it a number is damage


@dataclass(kw_only=True)
class Cleaning:
    """A log on its way to a uniform table.

    row(i) is the file's row of sample i. foreign: of a machine of its own columns. repaired: see `Log`.
    """

    path: Path
    first_row: int
    time: np.ndarray
    signals: dict[str, np.ndarray]
    losses: list[str]
    foreign: bool = False
    kept: np.ndarray = field(init=False)
    repaired: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.kept = np.arange(len(self.time))

    def row(self, i: int) -> int:
        return int(self.kept[i]) + self.first_row

    def keep(self, mask: np.ndarray) -> None:
        self.time, self.kept = self.time[mask], self.kept[mask]
        self.signals = {name: values[mask] for name, values in self.signals.items()}


def held(name: str) -> bool:
    """May this column rightly stand still: a setpoint, a valve?"""
    return name in places() and places()[name][0].held


def clean_time(log: Cleaning) -> None:
    """Drop unusable time stamps: missing, wild, repeated, backward. Refuses a file that holds two runs."""
    finite = np.abs(log.time) < LARGEST  # False for NaN
    drop(log, finite, "rows without a time stamp")
    if len(log.time) < 10:
        raise HexsimError(f"{log.path} has {len(log.time)} usable rows: give at least {SHORTEST_S:g} s of data")
    spread_coarse_stamps(log)
    typical = np.median(np.abs(np.diff(log.time)))
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
    drop(log, np.append(True, steps != 0), "repeated time stamps")
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
    if size < 2 or np.mean(np.abs(groups - size) <= 1) < 0.95 or np.any(np.diff(t) < 0):
        return
    log.losses.append(f"time_s has too few digits ({size} rows share a stamp): stamps spread evenly")
    log.time = np.interp(np.arange(len(t)), changes, t[changes])
    inside = (np.arange(len(t)) >= changes[0]) & (np.arange(len(t)) <= changes[-1])
    log.keep(inside)


def blank_bad_values(log: Cleaning) -> None:
    """Infinite values, spikes of one sample and frozen stretches become missing; a channel that is dead is left out.

    Signals of a foreign machine (kind "own") may jump and stand still by right; only what is no number is blanked.
    """
    for name, values in list(log.signals.items()):
        x = values.copy()
        blank(log, name, x, np.abs(x) > LARGEST, "values beyond any measure")
        blank(log, name, x, np.isnan(x), "missing values")
        reason = why_dead(log, name, x)
        if reason:
            leave_out(log, name, reason)
            continue
        if not log.foreign:
            blank(log, name, x, spikes(x), "spikes of a single sample")
            blank(log, name, x, frozen(log, name, x), "rows of a frozen value")
        log.signals[name] = x


def blank(log: Cleaning, name: str, x: np.ndarray, bad: np.ndarray, what: str) -> None:
    """Mark samples as missing, with a stated loss."""
    if bad.any():
        log.losses.append(f"column {name}: {bad.sum()} {what}, the first in row {first(log, bad)}")
        x[bad] = np.nan


def why_dead(log: Cleaning, name: str, x: np.ndarray) -> str | None:
    """Why a whole channel cannot be used: missing, cut off, or standing still; None when it can."""
    missing = int(np.isnan(x).sum())
    if missing > 0.5 * len(x):
        return f"{missing} of {len(x)} values are missing"
    if log.foreign or held(name):
        return None
    clipped = saturated(x)
    if clipped is not None:
        limit, at = clipped
        return f"it is saturated at {limit:.6g} in {at.sum()} rows from row {first(log, at)}"
    still = longest_run(np.diff(x) == 0) + 1
    if still == len(x) and name != "pressure_supply_Pa":  # an ideal supply may be constant
        return "it never changes"
    return f"it stands still in {still} of {len(x)} rows" if 0.9 * len(x) < still < len(x) else None


def first(log: Cleaning, mask: np.ndarray) -> int:
    return log.row(int(np.flatnonzero(mask)[0]))


def leave_out(log: Cleaning, name: str, why: str) -> None:
    if name.startswith("position") and not log.foreign:
        raise HexsimError(f"{log.path}: column {name} cannot be used, {why}; nothing can be traced without it")
    log.losses.append(f"column {name} is left out: {why}")
    del log.signals[name]


def spikes(x: np.ndarray) -> np.ndarray:
    """Single samples further from their neighbours than half of what the signal otherwise spans.

    The two samples on either side must lie together (within a tenth of the spike): a jump that rings is no spike.
    """
    filled = np.where(np.isnan(x), np.nanmedian(x), x)
    low, high = np.quantile(filled, [0.002, 0.998])
    around = np.stack([filled[:-4], filled[1:-3], filled[3:-1], filled[4:]])
    away = np.abs(filled[2:-2] - around.mean(axis=0))
    alone = np.ptp(around, axis=0) < 0.1 * away
    found = np.zeros(len(x), dtype=bool)
    far = (away > 0.5 * max(float(high - low), 1e-300)) & (away > 40 * np.median(away))
    found[2:-2] = alone & far & ~np.isnan(x[2:-2])
    return found if found.sum() <= max(3, 1e-3 * len(x)) else np.zeros(len(x), dtype=bool)


def saturated(x: np.ndarray) -> tuple[float, np.ndarray] | None:
    """(limit, where) of a signal cut off at an end: more samples at the limit than in 1 % of the span next to it."""
    low, high = np.nanmin(x), np.nanmax(x)
    if not high > low:
        return None
    for limit in (high, low):
        at = x == limit
        near = (np.abs(x - limit) < 0.01 * (high - low)) & ~at
        if at.sum() > max(near.sum(), 20) and longest_run(at) >= 10 and len(np.unique(x[~at])) > 50:
            return float(limit), at
    return None


def longest_run(mask: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def frozen(log: Cleaning, name: str, x: np.ndarray) -> np.ndarray:
    """Stretches of one value that are longer than chance allows, in a noisy signal: a sensor that has stopped.

    With a share p of samples equal to the one before, a run of k has n p^k chances; k is where that is 1e-9. p is taken
    three times as large as seen, without the two longest runs. A run longer than RESTING_s counts only while another
    signal moves: a quantised sensor of a machine at rest stands still by right, as do held setpoints, noise-free logs.
    """
    none = np.zeros(len(x), dtype=bool)
    if held(name) or len(x) < 50 or not noisy(x):
        return none
    same = np.diff(x) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    runs = stops - starts
    chance = 3.0 * (np.sort(runs)[:-2].sum() + 1) / len(x)
    if chance > 0.7:
        return none
    least = max(5, int(np.ceil(np.log(1e-9 / len(x)) / np.log(chance))))
    for start, stop in zip(starts[runs >= least], stops[runs >= least], strict=True):
        if log.time[stop] - log.time[start] < RESTING_s or others_move(log, name, start, stop):
            none[start + 1 : stop + 1] = True
    return none


def others_move(log: Cleaning, name: str, start: int, stop: int) -> bool:
    """Does another signal change by a twentieth of its span between two samples?"""
    for other, values in log.signals.items():
        span = np.ptp(values[np.isfinite(values)]) if other != name else 0.0
        inside = values[start : stop + 1]
        inside = inside[np.isfinite(inside)]
        if span > 0 and len(inside) and np.ptp(inside) > 0.05 * span:
            return True
    return False


def noisy(x: np.ndarray) -> bool:
    """White noise under the signal: sixth differences larger than a smooth signal's (1e-6 of the span)."""
    differences = np.diff(x[np.isfinite(x)], 6)
    moving = np.abs(differences[differences != 0])
    return len(moving) > 20 and float(np.median(moving)) / 30.0 > 1e-6 * float(np.nanmax(x) - np.nanmin(x))


def short_gaps(values: np.ndarray) -> np.ndarray:
    """Samples (n,) bool of missing runs of at most FILL samples between samples that are there."""
    missing = np.isnan(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    short = np.zeros(len(values), dtype=bool)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start <= FILL and start > 0 and stop < len(values):
            short[start:stop] = True
    return short


def uniform(log: Cleaning) -> float:
    """Put all signals on one uniform grid; returns the rate [Hz]. Gaps longer than FILL samples stay missing."""
    t = log.time
    steps = np.diff(t)
    typical = float(np.median(steps))
    regular = steps[steps < 1.5 * typical]
    period = float(np.mean(regular))
    rate = 1.0 / period
    if abs(rate - round(rate)) < 1e-4 * rate:
        rate = float(round(rate))
    if not RATES_Hz[0] <= rate <= RATES_Hz[1]:
        raise HexsimError(
            f"{log.path}: time_s steps by {period:.4g}, that is {rate:.4g} Hz; allowed are {RATES_Hz[0]:g} to "
            f"{RATES_Hz[1]:g} Hz: "
            "is the column in seconds? name its unit in a mapping file"
        )
    gaps = np.flatnonzero(steps > 1.5 * typical)
    if len(gaps):
        lost = int(np.sum(np.round(steps[gaps] * rate) - 1))
        if lost > 50 * len(t):
            raise HexsimError(
                f"{log.path}: time_s has gaps of {lost} samples, the first after row {log.row(int(gaps[0]))}: cut it"
            )
        log.losses.append(
            f"{len(gaps)} gaps in time_s, {lost} samples in all, the first after row {log.row(int(gaps[0]))}"
        )
    place = np.concatenate([[0.0], np.cumsum(np.where(steps > 1.5 * typical, np.round(steps * rate), steps * rate))])
    n = round(place[-1]) + 1
    grid = np.arange(n)
    if n == len(t) and np.max(np.abs(place - grid)) < 0.1:  # uniform but for rounding of the stamps
        log.time = t[0] + grid / rate
        return rate
    jitter = np.abs(place - np.round(place))
    if np.max(jitter) >= 0.1:
        log.losses.append(
            f"time stamps wander by up to {np.max(jitter) / rate * 1e3:.3g} ms: signals put on an even grid, linearly"
        )
    before = np.clip(np.searchsorted(place, grid, side="right") - 1, 0, len(t) - 1)
    after = np.minimum(before + 1, len(t) - 1)
    inside = (place[after] - place[before]) < 1.5
    on_stamp = np.abs(place[before] - grid) < 0.1
    for name, values in log.signals.items():
        new = np.interp(grid, place, values)
        nearest = np.where(np.abs(place[after] - grid) < np.abs(place[before] - grid), after, before)
        exact = np.abs(place[nearest] - grid) < 0.1
        new[exact] = values[nearest[exact]]
        new[~(inside | on_stamp | exact)] = np.nan
        log.signals[name] = new
    log.kept = log.kept[np.minimum(before, len(log.kept) - 1)]
    log.time = t[0] + grid / rate
    return rate


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


def held_values(x: np.ndarray) -> np.ndarray | None:
    """A signal (n,) that a computer holds between its ticks, with missing samples from the same tick; None for others.

    A tick whose samples are all missing lies on the straight line between its neighbours.
    """
    there = np.isfinite(x)
    changes = np.flatnonzero((np.diff(x) != 0) & there[1:] & there[:-1]) + 1
    hold = int(np.median(np.diff(changes))) if len(changes) > 50 else 1
    if hold < 2:
        return None
    phase = int(np.bincount(changes % hold).argmax())
    if np.mean(changes % hold == phase) < 0.98:
        return None
    tick = (np.arange(len(x)) - phase) // hold + 1
    known, first = np.unique(tick[there], return_index=True)
    return np.interp(tick, known, x[there][first])


def filled(name: str, x: np.ndarray, short: np.ndarray) -> tuple[np.ndarray, str]:
    """(the signal with its short gaps filled, how): straight lines; a held signal by what was held."""
    good = ~np.isnan(x)
    new = held_values(x) if held(name) else None
    how = "straight lines" if new is None else "the values held"
    if new is None:
        new = np.interp(np.arange(len(x)), np.flatnonzero(good), x[good])
    return np.where(short, new, x), how


def stretches(log: Cleaning, rate: float) -> list[slice]:
    """Slices without a missing value, longest first, after filling short gaps."""
    for name, values in log.signals.items():
        short = short_gaps(values)
        if short.any():
            log.signals[name], how = filled(name, values, short)
            log.repaired[name] = short
            log.losses.append(f"column {name}: {short.sum()} samples filled by {how} (gaps of at most {FILL} samples)")
    whole = np.ones(len(log.time), dtype=bool)
    for values in log.signals.values():
        whole &= np.isfinite(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(np.int8)))
    found = [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= SHORTEST_S * rate]
    return sorted(found, key=lambda part: (part.start - part.stop, part.start))
