"""The interface of a log format: a file to signals, each with its own time stamps. A format is one file of `readers/formats`.

A reader judges nothing: it sorts, fills and repairs nothing, and brings no signals onto one clock. That is done once for
all formats, behind it (`hexsim.readers.measured`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from hexsim.errors import HexsimError, shortened
from hexsim.readers.mapping import FileLayout


class Largest(NamedTuple):
    """Largest sizes of a log: a file of a few bytes can ask for all memory."""

    rows: int = 2_000_000  # samples of a signal that are used: half an hour at 1 kHz
    cells: int = 32_000_000  # numbers of a file that are kept in memory: a quarter of a gigabyte
    piece: int = 1 << 20  # bytes that are inflated at once
    part: int = 1 << 26  # bytes of a chunk or a message, unpacked: rosbag writes chunks of 0.75 MB, MCAP of 1 to 16 MB
    log: int = 1 << 30  # bytes of a whole log, unpacked
    columns: int = 200  # of a matrix
    unpacked: int = 8 * cells  # bytes
    elements: int = 200_000  # arrays of a MAT-file, those in structs and cells too
    listed_cells: int = cells // 4  # numbers that are collected one by one: a Python number takes four times its place
    items: int = 100_000  # of an array in a message, arrays in it multiplied
    text_columns: int = 20_000  # of a text table


LARGEST = Largest()

Array = np.ndarray


@dataclass(kw_only=True, eq=False)
class RawSignal:
    """One signal as a file holds it.

    name: its full path in the file, parts joined by dots. values: (n,) float, NaN where a sample is invalid or missing.
    stamps: clock -> (n,) time stamps [s], NaN for none. Signals of one clock share the array itself. A file may know
    several clocks (the header's time of a message, the time it was received). Without any, sample k stands in row k of
    a table, whose column of time is a signal like others.
    unit: where the file states it. aliases: other names that it goes by. odd: (index, text) of its first cell that is
    no number.
    """

    name: str
    values: Array
    stamps: Mapping[str, Array] = field(default_factory=dict)
    unit: str = ""
    aliases: tuple[str, ...] = ()
    odd: tuple[int, str] | None = None

    @property
    def short(self) -> str:
        """The last part of its path."""
        return self.name.rpartition(".")[2]


@dataclass(kw_only=True)
class RawLog:
    """What stands in a file.

    losses: what could not be read, a sentence each. left_out: what is there and is no signal of numbers, a sentence each;
    a refusal lists it. first_row: the file's row of sample 0. rows_lost: are rows missing?
    """

    signals: list[RawSignal]
    losses: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    first_row: int = 1
    rows_lost: bool = False

    @classmethod
    def of_table(cls, columns: Mapping[str, Array], **other: object) -> RawLog:
        """Columns of numbers, (n,) each."""
        signals = [RawSignal(name=name, values=np.asarray(values, dtype=float)) for name, values in columns.items()]
        return cls(signals=signals, **other)  # pyright: ignore[reportArgumentType]

    def find(self, name: str) -> list[RawSignal]:
        """Signals of this name: by its whole path, else by its end, or by another name of it."""
        whole = [signal for signal in self.signals if signal.name == name]
        return whole or [s for s in self.signals if s.name.endswith(f".{name}") or name in s.aliases]

    def one(self, name: str, what: str, path: Path) -> RawSignal:
        """The signal of this name. HexsimError where there is none, or where it is not clear which one."""
        found = self.find(name)
        if len(found) == 1:
            return found[0]
        if found:
            raise HexsimError(
                f"{path}: {name!r} for {what} may be {listed(signal.name for signal in found)}: give the whole name"
            )
        raise HexsimError(
            f"{path} has no column {name!r} for {what}: it has {listed(sorted(s.name for s in self.signals), 40)}"
            f"{self.unread()}"
        )

    def unread(self) -> str:
        """What was found and not read, as the end of a sentence."""
        return (
            f". Not read: {'; '.join(shortened(one, 160) for one in self.left_out[:6])}{'; ...' if len(self.left_out) > 6 else ''}"
            if self.left_out
            else ""
        )

    def lose_rows(self, sentence: str) -> None:
        """State that rows are missing."""
        self.losses.append(sentence)
        self.rows_lost = True

    def cut(self, path: Path) -> RawLog:
        """The first `max_rows` of every signal, with a stated loss."""
        most = max_rows(len(self.signals))
        if max((len(signal.values) for signal in self.signals), default=0) > most:
            short: dict[int, Array] = {}
            for signal in self.signals:
                signal.values = signal.values[:most]
                signal.stamps = {key: short.setdefault(id(t), t[:most]) for key, t in signal.stamps.items()}
            self.lose_rows(
                f"{path.name} has more than {most:,} rows: only the first {most:,} are used; cut the file to choose others"
            )
        return self


def listed(
    names: Iterable[str],
    most: int = 12,  # signals that a sentence lists
    *,
    most_characters: int = 80,  # characters of a name in a sentence
) -> str:
    """Names in a sentence, the first few of many."""
    names = [shortened(name, most_characters) for name in names]
    return ", ".join(names[:most]) + (f" and {len(names) - most} others" if len(names) > most else "")


def max_rows(n_columns: int) -> int:
    """Rows of a file with so many columns that are used."""
    return min(LARGEST.rows, LARGEST.cells // max(n_columns, 1))


class Reader(ABC):
    """One format. `name` as people say it; `suffixes` of its files, in small letters, a compressed text counts as a text.

    needs: the extra of hexsim that its library comes with. marker: file in a folder that is one log of this format.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    needs: ClassVar[str] = ""
    marker: ClassVar[str] = ""

    @abstractmethod
    def read(self, path: Path, layout: FileLayout) -> RawLog:
        """Signals of the file. HexsimError where a sentence is known; whatever else a library raises becomes one sentence
        in `files.raw_log`. Asks for sizes before it allocates: at most cells numbers, 1 GB of memory in all."""

    def holds_log(self, path: Path, layout: FileLayout) -> bool:
        """May this file of such a suffix be a log, at a first look? Notes that lie beside logs are none."""
        return True
