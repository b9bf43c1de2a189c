"""JSON lines: one message a line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader
from hexsim.readers.text_table import seconds
from hexsim.readers.topics import flatten


class JsonLinesReader(Reader):
    """Numbers by their path, those in lists by their place. Time stamps as text become seconds."""

    name = "JSON lines"
    suffixes = (".jsonl", ".ndjson")

    def read(
        self,
        path: Path,
        layout: FileLayout,
        *,
        stamp_characters: int = 40,  # characters, at most, of a time stamp as text
    ) -> RawLog:
        raw, numbers, texts = RawLog(signals=[]), Columns(math.nan), Columns("")
        for message in messages(path, raw):
            found: dict[str, float] = {}
            flatten("", message, found, {}, 0)
            numbers.add(found)
            texts.add(
                {
                    k: v
                    for k, v in message.items()
                    if isinstance(v, str) and v[:1].isdigit() and len(v) <= stamp_characters
                }
            )
            if numbers.cells + texts.cells > LARGEST.listed_cells:
                raw.lose_rows(f"{path.name} holds more numbers than are kept: what comes later is left out")
                break
        for name, column in texts.of.items():
            times = seconds(pl.Series(column))
            if times is None:
                raw.left_out.append(f"{name} holds text, the first is {next(filter(None, column))[:30]!r}")
            else:
                values = times.fill_null(np.nan).to_numpy().astype(float)
                raw.signals.append(RawSignal(name=name, values=values, unit="s"))
        taken = {signal.name for signal in raw.signals}
        raw.signals += [
            RawSignal(name=name, values=np.array(column)) for name, column in numbers.of.items() if name not in taken
        ]
        if not raw.signals:
            raise HexsimError(f"{path} holds no numbers{raw.unread()}")
        return raw


class Columns:
    """Columns that grow by a row a message, with `empty` where a message has no value."""

    def __init__(self, empty: Any) -> None:
        self.empty, self.rows, self.cells = empty, 0, 0
        self.of: dict[str, list[Any]] = {}

    def add(self, found: dict[str, Any]) -> None:
        for name in found:
            if name not in self.of:
                self.of[name] = [self.empty] * self.rows
        for name, column in self.of.items():
            column.append(found.get(name, self.empty))
        self.rows, self.cells = self.rows + 1, self.cells + len(self.of)


def messages(
    path: Path,
    raw: RawLog,
    *,
    most_characters: int = 1 << 22,  # characters of a line
) -> Iterator[dict[str, Any]]:
    """Objects of a file. A line that is none is a lost row; a file without any is refused."""
    good, bad = 0, []
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(most_characters), "")):
            if not line.strip():
                continue
            try:
                message = json.loads(line)
            except (ValueError, RecursionError):
                message = None
            if isinstance(message, dict):
                good += 1
                yield message
            else:
                bad.append(number + 1)
                if not good and len(bad) > 100:
                    break
    if not good:
        raise HexsimError(f"{path} holds no line that is a JSON object" + (f": see line {bad[0]}" if bad else ""))
    if bad:
        raw.lose_rows(f"{len(bad)} lines are no JSON objects, the first is line {bad[0]}: left out")


READER = JsonLinesReader()
