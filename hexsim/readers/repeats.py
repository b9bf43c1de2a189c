"""A channel of a slower rate whose value a logger repeats: its samples are few, and have times of their own.

A value that is held between samples P rows apart changes in the first row at or after each of them alone:

    u_(i-1) < phi + k P <= u_i        u: place of a row that changes, in rows by the clock

Taken for samples, the repeated values would be late by (P - 1)/2 rows in the mean.
"""

from __future__ import annotations

import numpy as np
import scipy

from hexsim.readers.clock_group import ClockGroup, is_held
from hexsim.readers.clocks import STAMPS, long_period

Array = np.ndarray


def set_apart(group: ClockGroup) -> list[ClockGroup]:
    """The group without its slower channels, and groups of these by the samples they have, each with a note."""
    if group.foreign:  # of its own columns: may jump and stand still
        return [group]
    u = group.time / long_period(group.time) if group.place is None else group.place
    apart: list[tuple[Array, ClockGroup]] = []
    for name in [name for name in group.signals if not is_held(name) and name not in group.held]:
        found = samples_of(u - u[0], group.signals[name])
        if found is None:
            continue
        at, rows = found
        group.note(
            f"repeats its value, which changes in every {np.ptp(at) / (len(at) - 1):.5g}. row: {len(at)} samples", name
        )
        own = next((own for there, own in apart if np.array_equal(there, at)), None)
        if own is None:
            times = np.interp(at, u - u[0], group.time)
            own = ClockGroup(
                path=group.path,
                clock=group.clock,
                time=times,
                signals={},
                first_row=group.first_row,
                tick_s=group.tick_s,
            )
            own.rows = group.rows[rows]
            apart.append((at, own))
        own.signals[name] = group.signals.pop(name)[rows]
    return [group, *(own for _, own in apart)]


def samples_of(
    u: Array,
    x: Array,
    *,
    least: int = 50,  # changes, and repeats that no samples of the rows themselves would leave
    enough: int = 50_000,  # changes that tell a rate
    outside_share: float = 0.02,  # of the changes that chance would put between samples: lost rows, damage
) -> tuple[Array, Array] | None:
    """(places of the samples, the row that shows each) of a signal x (n,) in rows at u (n,); None where every row is a sample."""
    there = np.flatnonzero(np.isfinite(x))
    both = np.isfinite(x[1:]) & np.isfinite(x[:-1])  # a change is seen in its own row
    c = u[1:][both & (x[1:] != x[:-1])]
    if len(c) <= least or len(there) - len(c) <= least:
        return None
    head = c[:enough]
    for frequency in frequencies(head):
        found = pattern(c, head, frequency)
        if found is None:
            continue
        period, first = found
        late = np.mod(c - first + STAMPS.even, period) >= 1.0
        by_chance = len(c) * (1.0 - 1.0 / period)
        if by_chance > least and late.sum() <= outside_share * by_chance:
            first = first % period if first % period < period - STAMPS.even else 0.0
            at = np.arange(first, u[-1] + STAMPS.even, period)
            rows = there[np.minimum(np.searchsorted(u[there], at - STAMPS.even), len(there) - 1)]
            shown = u[rows] - at < period - STAMPS.even  # else all rows that show it are missing
            return at[shown], rows[shown]
    return None


def frequencies(
    c: Array,
    *,
    strong_share: float = 0.5,  # of the strongest line: the lines of a comb are alike, those of 2.5 rows are not
    by_chance: float = 6.0,  # times the rms of all lines: chance has one once in 10^15
    most: int = 4,
) -> list[float]:
    """Rates [1/row] at which changes at c may come, the slowest first; more than half of the rows: as what is less than 1."""
    marks = np.zeros(scipy.fft.next_fast_len(int(c[-1]) + 2))
    np.add.at(marks, np.round(c).astype(int), 1.0)
    size = np.abs(scipy.fft.rfft(marks - marks.mean()))
    if size.max() <= by_chance * np.sqrt(np.mean(size**2)):
        return []
    around = np.concatenate([[np.inf], size, [0.0]])
    line = np.flatnonzero((size >= strong_share * size.max()) & (size >= around[:-2]) & (size > around[2:]))
    line = line[:most] / len(marks)
    return [f for f in (*line, *(1.0 - line[::-1])) if 1.1 * f * np.ptp(c) > len(c)]


def pattern(c: Array, head: Array, frequency: float) -> tuple[float, float] | None:
    """(rows between samples, place of the first) by changes at c, about a rate [1/row] of the first; None where there is none.

    Changes say between which rows a sample lies. Of the places that all allow it has the latest: in a row, where it can be.
    """
    near = frequency + np.linspace(-1.0, 1.0, 33) / np.ptp(head)
    turned, turn = np.exp(2j * np.pi * near[0] * head), np.exp(2j * np.pi * (near[1] - near[0]) * head)
    strengths = np.empty(len(near))
    for i in range(len(near)):
        strengths[i] = abs(turned.sum())
        turned *= turn
    period = 1.0 / near[np.argmax(strengths)]
    if period <= 1.0:
        return None
    for seen in (head, head, c, c):
        middle = float(np.angle(np.exp(2j * np.pi * seen / period).sum())) / (2.0 * np.pi) * period
        k = np.round((seen - middle) / period)
        if np.ptp(k) < 1:
            return None
        period = float(np.polyfit(k, seen, 1)[0])
    e = np.sort(np.mod(c - middle + 0.5 * period, period))
    inside = np.searchsorted(e, e + 1.0 - STAMPS.even, side="right") - np.arange(len(e))
    first = e[int(np.argmax(inside))] + middle - 0.5 * period
    return period, float(first)
