"""From signals with times of their own to one grid: what is between samples, what is missing, where the samples of slower signals are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from hexsim.errors import HexsimError
from hexsim.readers.clock_group import HOLE, ClockGroup, periods, runs
from hexsim.readers.clocks import STAMPS, long_period
from hexsim.readers.repeats import samples_of
from hexsim.signals.log import Log

Array = np.ndarray


class Grids(NamedTuple):
    """The grid that all signals of a log are put on."""

    slowest_own_Hz: float = 1e-4  # a machine of one's own may be a tank that fills for hours
    # of a log: below it shows no valve, above it its time is in another unit
    rates_Hz: tuple[float, ...] = (5.0, 20_000.0)
    fill: int = 10  # samples: shorter gaps are filled, longer ones end a stretch
    # steps of the grid by which a signal goes on at its ends: a grid begins beside samples that wander
    at_end: float = 0.1
    # values at most, share of steps that are none: a switch or a mode, which holds between samples
    flag: tuple[int, float] = (16, 0.9)


GRID = Grids()


@dataclass(kw_only=True, eq=False)
class Grid:
    """Signals on one even grid. columns: name -> (n,), NaN where there is none. sampled: name -> places (m,) of its
    samples on the grid, where they are fewer than its points. repaired: name -> (n,) bool, filled."""

    start: float
    rate: float
    n: int
    path: Path
    finer: int = 1  # points for each sample of its clock
    slack: int = 1  # samples at the ends that some clock may not reach: its own period
    columns: dict[str, Array] = field(default_factory=dict)
    sampled: dict[str, Array] = field(default_factory=dict)
    repaired: dict[str, Array] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)

    @property
    def time(self) -> Array:
        return self.start + np.arange(self.n) / self.rate


def on_one_grid(groups: Sequence[ClockGroup], delays: dict[str, float], slowest_Hz: float = GRID.rates_Hz[0]) -> Grid:
    """All signals on a grid of the fastest clock. delays: signal -> [s] by which it is late."""
    base = min(groups, key=lambda group: long_period(group.time))
    grid = grid_of(base, slowest_Hz)
    if len(groups) > 1:
        grid = grid if base.foreign else with_all_samples(grid, groups)
        grid.notes.setdefault("", []).append(
            f"{len(groups)} clocks: signals are on that of {', '.join(sorted(base.signals)[:3])}"
        )
    for group in groups:
        place = place_on(grid, group, base)
        for name in group.signals:
            own = group.own_samples(name)
            late = delays.get(name, 0.0)
            if abs(late) * grid.rate >= grid.n - 1:
                raise HexsimError(
                    f"{grid.path}: [columns.{name}] delay_s = {late:g} in the mapping is longer than the log "
                    f"({(grid.n - 1) / grid.rate:.3g} s): give the delay in seconds"
                )
            if late:
                grid.notes.setdefault(name, []).append(f"was late by {late * 1e3:g} ms (mapping): moved forward")
            put(grid, group, name, place[own] - late * grid.rate, group.signals[name][own])
    return grid


def grid_of(
    base: ClockGroup,
    slowest_Hz: float = GRID.rates_Hz[0],
    *,
    most_samples: int = 50,  # samples of the grid a sample of the file
) -> Grid:
    """The grid of a clock: its counted samples, or one that its stamps lie about."""
    t, usual = base.time, periods(base.time)
    period, doubt = long_period(t), np.inf
    if base.place is not None:
        period = float(np.polyfit(base.place, t - t[0], 1)[0])
        error = base.off_s / period * np.sqrt(12.0 / len(t))  # of the log's length, in periods: least squares
        doubt = max(0.01, 4.0 * error)  # periods that the stamps do not tell: a round rate is the likelier one
    elif np.quantile(usual, 0.1) < 0.8 * period:  # two rates: the finer one
        period = float(np.quantile(usual, 0.1))
    rate = 1.0 / max(period, 1e-12)
    whole = float(round(rate))
    if abs(rate - whole) < 1e-4 * rate and abs(rate - whole) / rate * np.ptp(t) * rate < doubt:
        rate = whole
    if not slowest_Hz <= rate <= GRID.rates_Hz[1]:
        raise HexsimError(
            f"{base.path}: {base.clock} steps by {1 / rate:.4g}, that is {rate:.4g} Hz; allowed are {slowest_Hz:g} to "
            f"{GRID.rates_Hz[1]:g} Hz: is the column in seconds? name its unit in a mapping file"
        )
    place = (t - t[0]) * rate - (0.0 if base.place is None else base.place)
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * place)))) / (2 * np.pi)
    phase = phase if abs(phase) > STAMPS.even else 0.0
    phase += float(phase < -GRID.at_end and base.place is None)
    start = float(t[0]) + phase / rate
    last = int((t[-1] - start) * rate + GRID.at_end) if base.place is None else int(base.place[-1])
    long = np.flatnonzero(np.diff(t) > HOLE * usual)
    if last + 1 > most_samples * len(t):
        raise HexsimError(
            f"{base.path}: {base.clock} has gaps of {last + 1 - len(t)} samples, the first after row "
            f"{base.row(int(long[0])) if len(long) else 1}: cut it"
        )
    return Grid(start=start, rate=rate, n=last + 1, path=base.path)


def with_all_samples(
    grid: Grid,
    groups: Sequence[ClockGroup],
    *,
    most: int = 3,  # points a sample: a simulation has to be written so often
) -> Grid:
    """The grid, finer where slower samples then lie on it, 200 Hz beside 500: between its points no simulation is known."""
    places = [(group.time - grid.start) * grid.rate for group in groups]
    for finer in range(1, most + 1):
        off = [np.quantile(np.abs(place * finer - np.round(place * finer)), 0.98) for place in places]
        if max(off) < 2 * finer * STAMPS.even:
            return replace(grid, finer=finer, rate=grid.rate * finer, n=(grid.n - 1) * finer + 1)
    return grid


def place_on(grid: Grid, group: ClockGroup, base: ClockGroup) -> Array:
    """Samples of a group in steps of the grid; whole numbers for those that lie on it. Notes its holes."""
    place = (group.time - grid.start) * grid.rate
    if group is base and group.place is not None:
        place = grid.finer * group.place + float(np.mean(place - grid.finer * group.place))
    near = np.round(place)
    place = np.where(np.abs(place - near) < 2 * STAMPS.even, near, place)
    steps = np.diff(place)
    long = np.flatnonzero(steps > HOLE * periods(place))
    if len(long):
        lost = int(np.sum(np.round(steps[long] / periods(place)[long]) - 1))
        group.note(
            f"{len(long)} gaps in {group.clock}, {lost} samples in all, the first after row {group.row(int(long[0]))}"
        )
    return place


def put(grid: Grid, group: ClockGroup, name: str, place: Array, x: Array) -> None:
    """A signal at places (m,) on the grid: held, or between its samples, missing in its holes."""
    apart = np.append(True, np.diff(place) > 2 * STAMPS.even)  # stamps that fall together are one
    place, x = place[apart], x[apart]
    points = np.arange(grid.n, dtype=float)
    if len(place) < 2:
        grid.columns[name] = np.full(grid.n, np.nan)
        grid.notes.setdefault(name, []).append("all samples have the same time: left out")
        return
    usual, steps = periods(place), np.diff(place)
    after = np.clip(np.searchsorted(place, points), 1, len(place) - 1)
    before = after - 1
    near = np.minimum(np.abs(points - place[before]), np.abs(place[after] - points))
    inside = (points >= place[0] - 1e-9) & (points <= place[-1] + 1e-9)
    hold = is_flag(x) if group.foreign else name in group.held
    if name in group.steady:
        inside, hold = points >= place[0] - 1e-9, True
    else:
        hole = steps > HOLE * usual
        reach = np.where(
            steps > GRID.fill * usual, GRID.at_end * np.minimum(usual, 1.0), 0.5 * usual
        )  # of a sample into a hole
        inside &= ~hole[before] | (near < reach[before])
        inside |= near < GRID.at_end * np.minimum(usual[before], 1.0)
    on = np.where(np.abs(points - place[before]) < np.abs(place[after] - points), before, after)
    exact = np.abs(place[on] - points) < 2 * STAMPS.even
    ticks = held_between_ticks(place, x, points) if hold and group.place is None and name not in group.steady else None
    if ticks is not None:
        new = ticks
    elif hold:
        new = x[np.clip(np.searchsorted(place, points + 2 * STAMPS.even, side="right") - 1, 0, len(place) - 1)]
    else:
        new = np.where(exact, x[on], between(points, place, x))
    grid.columns[name] = np.where(inside, new, np.nan)
    grid.slack = max(grid.slack, int(np.ceil(HOLE * max(usual[0], usual[-1]))))
    if place[0] > HOLE * usual[0] or place[-1] < grid.n - 1 - HOLE * usual[-1]:
        times = grid.start + place[[0, -1]] / grid.rate
        grid.notes.setdefault(name, []).append(
            f"lasts from {times[0]:.3f} to {times[1]:.3f} s: missing before and after"
        )
    slow = (usual > HOLE)[before]
    if not hold and slow.any():
        grid.sampled[name] = place[(place >= 0.0) & (place <= grid.n - 1)]
        grid.notes.setdefault(name, []).append(
            f"{len(x)} samples, the grid has {grid.n} points: compared at its samples alone"
        )
    elif hold and len(steps) and np.median(usual) > HOLE:
        grid.notes.setdefault(name, []).append(f"{len(x)} samples, the grid has {grid.n} points: held between them")


def splined(x: Array, place: Array, noise: Array | None = None) -> Array:
    """A signal (n,) by its samples at `place` (m,), and a spline between. noise (n,): of samples."""
    points = np.arange(len(x), dtype=float)
    own = scipy.interpolate.make_interp_spline(points, x, k=3)(place)
    own += 0.0 if noise is None else noise[np.round(place).astype(int)]
    return np.where((points >= place[0]) & (points <= place[-1]), between(points, place, own), x)


def as_read(log: Log, noise: Log | None = None) -> Log:
    """A log of as many samples as points, simulated along a measured one, as a reader would have put that on the grid: its slower
    channels by their own samples. noise: the same with noise."""
    seen = noise or log
    slower = {
        name: splined(log.columns[name], place, seen.columns[name] - log.columns[name])
        for name, place in log.sampled.items()
        if name in log.columns
    }
    return replace(seen, columns={**seen.columns, **slower}) if slower else seen


def is_flag(x: Array) -> bool:
    """A switch or a mode: few values that seldom change."""
    return len(x) > 1 and float(np.mean(np.diff(x) == 0)) > GRID.flag[1] and len(np.unique(x)) <= GRID.flag[0]


def between(
    points: Array,
    place: Array,
    x: Array,
    *,
    stands_share: float = 0.3,  # share of steps that are none, above which a signal is no smooth curve: straight lines
) -> Array:
    """x (m,) at places between its samples (n,): a cubic spline of each stretch without a long hole, which keeps what is
    fast; straight lines where it has few samples or stands still often."""
    new = np.interp(points, place, x)
    if np.mean(np.diff(x) == 0) > stands_share or (np.all(place == np.round(place)) and np.max(np.diff(place)) < HOLE):
        return new
    ends = np.flatnonzero(np.diff(place) > GRID.fill * periods(place)) + 1
    for start, stop in zip(np.append(0, ends), np.append(ends, len(place)), strict=True):
        if stop - start >= 8:
            own = (points >= place[start] - GRID.at_end) & (points <= place[stop - 1] + GRID.at_end)
            new[own] = scipy.interpolate.make_interp_spline(place[start:stop], x[start:stop], k=3)(points[own])
    return new


def held_between_ticks(place: Array, x: Array, grid: Array) -> Array | None:
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


def fill(grid: Grid, held: set[str]) -> None:
    """Short gaps between samples that are there, in place and marked."""
    for name, values in grid.columns.items():
        short = short_gaps(values)
        if short.any():
            grid.columns[name], how = filled(values, short, name in held)
            grid.repaired[name] = short
            grid.notes.setdefault(name, []).append(
                f"{short.sum()} samples filled by {how} (gaps of at most {GRID.fill} samples)"
            )


def short_gaps(values: Array) -> Array:
    """Samples (n,) bool of missing runs of at most fill samples between samples that are there."""
    short = np.zeros(len(values), dtype=bool)
    for start, stop in zip(*runs(np.isnan(values)), strict=True):
        if stop - start <= GRID.fill and start > 0 and stop < len(values):
            short[start:stop] = True
    return short


def held_values(x: Array) -> Array | None:
    """A signal (n,) that a computer holds between its ticks, with missing samples from the same tick; None for others.

    A tick whose samples are all missing lies on a cubic spline through the others.
    """
    points = np.arange(len(x), dtype=float)
    found = samples_of(points, x)
    if found is None:
        return None
    ticks, rows = found
    period = float(np.min(np.diff(ticks)))
    tick = np.floor((points - ticks[0]) / period + STAMPS.even)
    known = np.round((ticks - ticks[0]) / period)
    value = scipy.interpolate.make_interp_spline(known, x[rows], k=3)(tick)
    there = np.isin(tick, known)
    value[there] = x[rows][np.searchsorted(known, tick[there])]
    return value


def filled(
    x: Array,
    short: Array,
    held: bool,
    *,
    smooth_samples: int = 2,  # samples: up to here a cubic through four neighbours is as good as a sample, beyond it its slope is noise
) -> tuple[Array, str]:
    """(the signal with its short gaps filled, how): cubic splines, straight lines; a held signal by what was held."""
    good = ~np.isnan(x)
    new = held_values(x) if held else None
    how = "the values held"
    if new is None:
        at, there, values = np.arange(len(x)), np.flatnonzero(good), x[good]
        starts, stops = runs(short)
        how = "straight lines" if np.any(stops - starts > smooth_samples) else "cubic splines"
        new = np.interp(at, there, values)
        for start, stop in zip(starts, stops, strict=True):
            i = int(np.searchsorted(there, start))
            near = slice(max(i - 2, 0), i + 2)
            if stop - start <= smooth_samples and len(there[near]) == 4:
                new[start:stop] = np.polyval(np.polyfit(there[near] - start, values[near], 3), at[start:stop] - start)
    return np.where(short, new, x), how


def stretches(grid: Grid, shortest_s: float) -> list[slice]:
    """Slices without a missing value, longest first."""
    whole = np.ones(grid.n, dtype=bool)
    for values in grid.columns.values():
        whole &= np.isfinite(values)
    starts, stops = runs(whole)
    found = [slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True) if b - a >= shortest_s * grid.rate]
    return sorted(found, key=lambda part: (part.start - part.stop, part.start))
