"""Signals that were sampled together, on their way from a file to a log."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy

from hexsim.signals.table import places

Array = np.ndarray
HOLE = 1.5  # periods: a longer step between two samples is a hole


@dataclass(kw_only=True, eq=False)
class ClockGroup:
    """Signals on one clock.

    clock: its name in sentences. time: (n,) [s], as stamped, later as settled. signals: name -> (n,) in SI units, NaN
    where there is no sample. rows: (n,) places in the file, counted from first_row. tick_s: what one count of the clock is.
    place: (n,) whole numbers where the samples are even and were counted, else None.
    off_s: standard deviation of the stamps about the counted samples [s].
    held: signals that keep their value between samples. steady: those of them that do so however long.
    foreign: of a machine of its own columns. notes: signal or "" -> what was done, in the order in which it was done.
    """

    path: Path
    clock: str
    time: Array
    signals: dict[str, Array]
    first_row: int = 1
    tick_s: float = 1.0
    foreign: bool = False
    held: set[str] = field(default_factory=set)
    steady: set[str] = field(default_factory=set)
    place: Array | None = None
    off_s: float = 0.0
    notes: dict[str, list[str]] = field(default_factory=dict)
    rows: Array = field(init=False)

    def __post_init__(self) -> None:
        self.rows = np.arange(len(self.time))

    def note(self, sentence: str, name: str = "") -> None:
        self.notes.setdefault(name, []).append(sentence)

    def row(self, i: int) -> int:
        """The file's row of sample i."""
        return int(self.rows[i]) + self.first_row

    def first(self, mask: Array) -> int:
        """The file's row of the first sample of a mask."""
        return self.row(int(np.flatnonzero(mask)[0]))

    def keep(self, chosen: Array) -> None:
        """Samples of a mask, or in an order."""
        self.time, self.rows = self.time[chosen], self.rows[chosen]
        self.signals = {name: values[chosen] for name, values in self.signals.items()}

    def own_samples(self, name: str) -> Array:
        """Places in the group of the samples of a signal."""
        return np.flatnonzero(np.isfinite(self.signals[name]))


def periods(
    time: Array,
    *,
    around_steps: int = 101,  # steps whose median is the period of a signal there: a log may change its rate, jitter must not
) -> Array:
    """Time between samples (n - 1,) that is usual around each step."""
    steps = np.diff(time)
    return (
        scipy.ndimage.median_filter(steps, min(around_steps, len(steps) // 2 * 2 + 1), mode="nearest")
        if len(steps)
        else steps
    )


def is_held(name: str) -> bool:
    """May this column rightly stand still: a setpoint, a valve?"""
    return name in places() and places()[name][0].held


def runs(mask: Array) -> tuple[Array, Array]:
    """(first, behind the last) of each run of a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2]
