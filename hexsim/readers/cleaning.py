"""A log on its way from a file's columns to a uniform table. Nothing is repaired silently."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hexsim.signals.table import places


@dataclass(kw_only=True)
class Cleaning:
    """A log on its way to a uniform table.

    row(i) is the file's row of sample i. foreign: of a machine of its own columns. repaired: see `Log`.
    wanders: are the samples themselves off an even grid?
    """

    path: Path
    first_row: int
    time: np.ndarray
    signals: dict[str, np.ndarray]
    losses: list[str]
    foreign: bool = False
    wanders: bool = False
    kept: np.ndarray = field(init=False)
    repaired: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.kept = np.arange(len(self.time))

    def row(self, i: int) -> int:
        return int(self.kept[i]) + self.first_row

    def first(self, mask: np.ndarray) -> int:
        """The file's row of the first sample of a mask."""
        return self.row(int(np.flatnonzero(mask)[0]))

    def keep(self, mask: np.ndarray) -> None:
        self.time, self.kept = self.time[mask], self.kept[mask]
        self.signals = {name: values[mask] for name, values in self.signals.items()}


def held(name: str) -> bool:
    """May this column rightly stand still: a setpoint, a valve?"""
    return name in places() and places()[name][0].held


def runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(first, behind the last) of each run of a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2]
