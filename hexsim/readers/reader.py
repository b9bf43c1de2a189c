"""The interface of a log format: bytes of a file to columns of numbers. A format is one file of `hexsim/readers/formats`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from hexsim.readers.mapping import FileLayout

MAX_ROWS = 2_000_000  # rows of a file that are used: half an hour at 1 kHz
MAX_CELLS = 64_000_000  # of numbers that are kept in memory: half a gigabyte


@dataclass(kw_only=True)
class RawTable:
    """What stands in a file.

    columns: name -> (n,) float, NaN where a cell is missing. losses: what could not be read, a sentence each.
    first_row: the file's row of index 0. units: name -> unit where the file states it. rows_lost: are rows missing?
    odd_cells: name -> (index, text) of its first cell that is no number.
    """

    columns: dict[str, np.ndarray]
    losses: list[str] = field(default_factory=list)
    first_row: int = 1
    units: Mapping[str, str] = field(default_factory=dict)
    rows_lost: bool = False
    odd_cells: dict[str, tuple[int, str]] = field(default_factory=dict)

    def lose_rows(self, sentence: str) -> None:
        """State that rows are missing."""
        self.losses.append(sentence)
        self.rows_lost = True

    def cut(self, path: Path) -> RawTable:
        """The first `max_rows`, with a stated loss."""
        rows, most = max(map(len, self.columns.values()), default=0), max_rows(len(self.columns))
        if rows > most:
            self.columns = {name: values[:most] for name, values in self.columns.items()}
            self.lose_rows(
                f"{path.name} has more than {most:,} rows: only the first {most:,} are used; cut the file to choose others"
            )
        return self


def max_rows(n_columns: int) -> int:
    """Rows of a file with so many columns that are used."""
    return min(MAX_ROWS, MAX_CELLS // max(n_columns, 1))


class Reader(ABC):
    """One format. `name` as people say it; `suffixes` of its files, in small letters, a compressed text counts as a text."""

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def read(self, path: Path, layout: FileLayout) -> RawTable:
        """Columns of the file. Raises HexsimError that names the file, and row and column where there are such."""


def first_line(error: Exception) -> str:
    """The first line of a library's message."""
    return (str(error).splitlines() or [type(error).__name__])[0][:160]
