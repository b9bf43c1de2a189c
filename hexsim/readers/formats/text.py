"""Delimited text, plain or gzip. Every cell that is no number is counted and named."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader, max_rows
from hexsim.readers.text_table import MISSING, Table, find_table, records, seconds

SI_LETTER = re.compile(rb"(\d\.?)([numk])(?=[\s;,]|$)")
SI_EXPONENT = {b"n": b"e-9", b"u": b"e-6", b"m": b"e-3", b"k": b"e3"}


class TextReader(Reader):
    """Delimited text: a table with a row of names wherever it begins, or names from a mapping file."""

    name = "text"
    suffixes = (".csv", ".txt", ".exp", ".dat", ".tsv", ".asc", ".lvm", ".log")

    def read(
        self,
        path: Path,
        layout: FileLayout,
        *,
        head_bytes: int = 1 << 20,  # bytes that say where the table is
    ) -> RawLog:
        raw = RawLog(signals=[])
        text = decoded(path, file_bytes(path, raw), layout)
        table = find_table(text[:head_bytes].decode("utf-8", "replace").splitlines(), layout, path)
        twice = [name for name, count in Counter(table.header).items() if count > 1]
        if twice:
            raise HexsimError(f"{path}: column {sorted(twice)[0]!r} stands twice in the header: name each column once")
        if table.preamble:
            raw.losses.append(
                f"{len(table.preamble)} lines before the names, from {table.preamble[0][:40]!r} on: passed over"
            )
        raw.first_row = table.first + 1
        for _ in range(table.first):
            text = text.partition(b"\n")[2]
        if table.separator == " ":
            text = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", text))
        Cells(path=path, table=table, comment=layout.comment).read(text, raw)
        if table.paired_s:
            with_own_times(raw, table)
        return raw

    def holds_log(
        self,
        path: Path,
        layout: FileLayout,
        *,
        look_bytes: int = 1 << 16,  # bytes that say whether there is a table
    ) -> bool:
        """Is there a table in the first lines?"""
        try:
            with open(path, "rb") as file:
                packed = file.read(2) == b"\x1f\x8b"
                file.seek(0)
                begin = next(inflated(file)) if packed else file.read(look_bytes)
            table = find_table(
                decoded(path, begin[:look_bytes], layout).decode("utf-8", "replace").splitlines(), layout, path
            )
        except (HexsimError, OSError, EOFError, StopIteration, zlib.error):
            return False
        return len(table.header) > 1 or layout.columns is not None


def with_own_times(raw: RawLog, table: Table) -> None:
    """Every signal on the column of time before it."""
    by_name = {signal.name: signal for signal in raw.signals}
    raw.signals = []
    for time, name in zip(table.header[::2], table.header[1::2], strict=True):
        if time in by_name and name in by_name:
            signal, stamps = by_name[name], by_name[time].values * table.paired_s
            there = np.isfinite(stamps)  # a shorter channel ends earlier
            signal.values, signal.stamps = signal.values[there], {"time": stamps[there]}
            raw.signals.append(signal)


def inflated(file: IO[bytes]) -> Iterator[bytes]:
    """Content of a gzip file, at most piece bytes at a time however well it is packed; several members as one.

    Raises EOFError where it ends within a member, zlib.error where it is damaged.
    """
    inflate, packed = zlib.decompressobj(wbits=31), b""
    while True:
        packed = packed or file.read(LARGEST.piece)
        if inflate.eof:
            if not packed:
                return
            inflate = zlib.decompressobj(wbits=31)  # another member follows
        piece = inflate.decompress(packed, LARGEST.piece)
        if not (packed or piece or inflate.eof):
            raise EOFError
        yield piece
        packed = inflate.unused_data if inflate.eof else inflate.unconsumed_tail


def file_bytes(
    path: Path,
    raw: RawLog,
    *,
    most_bytes: int = 150_000_000,  # bytes of text that are read: a million rows of a bench, half a million of a hexapod
) -> bytes:
    """Content of a plain or gzip file, up to about rows lines and most_bytes bytes; a damaged gzip gives what it holds."""
    pieces: list[bytes] = []
    lines = size = 0
    try:
        with open(path, "rb") as file:
            zipped = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            for piece in inflated(file) if zipped else iter(lambda: file.read(LARGEST.piece), b""):
                lines, size = lines + piece.count(b"\n"), size + len(piece)
                pieces.append(piece)
                if lines > LARGEST.rows + 10:
                    break
                if size > most_bytes:
                    raw.lose_rows(
                        f"{path.name} is larger than {most_bytes // 1_000_000} MB of text: only so much of it is used; "
                        "cut the file to choose others"
                    )
                    return whole_rows(pieces)
    except zlib.error as error:
        if not any(pieces):
            raise HexsimError(f"{path} is a damaged gzip file ({error}): copy it again") from None
        raw.lose_rows(f"{path.name} is a damaged gzip file: what stands before the damage was read")
        return whole_rows(pieces)
    except EOFError:
        whole = whole_rows(pieces)
        rows = whole.count(b"\n") - 1
        raw.lose_rows(f"{path.name} is a truncated gzip file: the {rows} whole rows were read")
        return whole
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    return b"".join(pieces)


def whole_rows(pieces: list[bytes]) -> bytes:
    """Without the row that is cut off."""
    return b"".join(pieces).rpartition(b"\n")[0] + b"\n"


def decoded(path: Path, raw: bytes, layout: FileLayout) -> bytes:
    """UTF-8 with \\n line ends, letters behind numbers as exponents; refuses what is no text."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raw = raw.decode("utf-16", "replace").encode()
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in raw:
        row = raw[: raw.index(b"\0")].count(b"\n") + 1
        raise HexsimError(f"{path} is no text: a zero byte stands in row {row}; give CSV, Parquet, MAT or MDF")
    if b"\r" in raw:
        raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        raw = raw.decode("latin-1").encode()
    if layout.si_letters:
        raw = SI_LETTER.sub(lambda found: found[1] + SI_EXPONENT[found[2]], raw)
    return raw


class Cells:
    """Cells of a table of text and how they become numbers."""

    def __init__(self, *, path: Path, table: Table, comment: str | None) -> None:
        self.path, self.table, self.comment = path, table, comment
        self.header, self.separator = table.header, table.separator
        self.most = max_rows(len(self.header)) + 1
        self.odd: dict[str, tuple[int, str]] = {}

    def read(self, text: bytes, raw: RawLog) -> None:
        """Fill raw.signals: fast when all cells of numbers are such; else cell by cell with each failure counted."""
        kinds = [pl.Float64 if numbers else pl.String for numbers in self.table.numbers]
        options: dict[str, Any] = {
            "has_header": False,
            "new_columns": self.header,
            "separator": self.separator,
            "n_rows": self.most,
            "comment_prefix": self.comment,
            "raise_if_empty": False,
            "decimal_comma": self.table.decimal_comma,
        }
        try:
            table = pl.read_csv(text, schema_overrides=kinds, **options)
            if table.width != len(self.header) or self.table.group:
                raise pl.exceptions.ComputeError("other number of columns")
        except pl.exceptions.PolarsError:
            table = self.one_by_one(text.decode(), raw)
        for name in self.header:
            column, unit = table[name], self.table.units.get(name, "")
            if column.dtype == pl.String:
                stamps = seconds(column)
                if stamps is None:
                    self.say_text(name, column, raw)
                    continue
                column, unit = stamps, "s"
            odd = self.odd.get(name)
            if odd is None and column.null_count():
                odd = int(column.is_null().arg_max() or 0), "an empty cell"
            values = column.fill_null(np.nan).to_numpy().astype(float)
            raw.signals.append(RawSignal(name=name, values=values, unit=unit, odd=odd))

    def say_text(self, name: str, column: pl.Series, raw: RawLog) -> None:
        """A column without numbers is left out, with its first cell."""
        there = column.str.len_chars().fill_null(0) > 0
        if there.any():
            at = int(there.arg_max() or 0)
            raw.left_out.append(
                f"column {name} holds text, the first is {column[at][:30]!r} in row {at + raw.first_row}"
            )
        else:
            raw.signals.append(RawSignal(name=name, values=np.full(len(column), np.nan), odd=(0, "an empty cell")))

    def one_by_one(self, text: str, raw: RawLog) -> pl.DataFrame:
        """Rows of the wrong length are dropped, cells that are no numbers become missing; both are counted and placed."""
        blocks: list[pl.DataFrame] = []
        most = 50_000  # rows that are parsed at once
        rows: list[list[str]] = []
        bad_rows: list[int] = []
        failed: dict[str, list[tuple[int, str]]] = {name: [] for name in self.header}
        width, lines = len(self.header), text.split("\n")
        for number, row in records(lines, self.separator, width):
            line = lines[number]
            if not line.strip() or (self.comment and line.lstrip().startswith(self.comment)):
                continue
            if len(row) == width + 1 and row[-1].strip() == "":
                row.pop()
            if len(row) == width - 1 and not self.table.numbers[-1]:  # an empty comment at the end
                row.append("")
            if len(row) != width:
                bad_rows.append(number + raw.first_row)
                row = [""] * width
            rows.append(row)
            if len(rows) == most:
                blocks.append(self.block(rows, len(blocks) * most, failed))
                rows = []
            if len(blocks) * most + len(rows) >= self.most:
                break
        blocks.append(self.block(rows, len(blocks) * most, failed))
        table = pl.concat(blocks)
        self.state(bad_rows, failed, table.height, raw)
        return table

    def block(self, rows: list[list[str]], first: int, failed: dict[str, list[tuple[int, str]]]) -> pl.DataFrame:
        """Some rows as numbers; cells that are none go to `failed`."""
        columns = {}
        for i, name in enumerate(self.header):
            column = pl.Series(name, [row[i].strip().strip('"') for row in rows], dtype=pl.String)
            if not self.table.numbers[i]:
                columns[name] = column
                continue
            if self.table.group:
                column = column.str.replace_all(self.table.group, "", literal=True)
            if self.table.decimal_comma:
                column = column.str.replace(",", ".", literal=True)
            column = column.str.replace(r"^([-+.\d]+)[dD]([-+]?\d+)$", "${1}e$2")  # exponents of Fortran
            columns[name] = column.cast(pl.Float64, strict=False)
            wrong = (columns[name].is_null() & ~column.is_in(list(MISSING))).arg_true()
            failed[name] += [(first + int(place), column[place][:20]) for place in wrong]
        return pl.DataFrame(columns)

    def state(self, bad_rows: list[int], failed: dict[str, list[tuple[int, str]]], n: int, raw: RawLog) -> None:
        """State what was dropped; refuse where it is more than a fifth."""
        if len(bad_rows) > 0.2 * max(n, 1):
            raise HexsimError(
                f"{self.path}: {len(bad_rows)} of {n} rows have another number of cells than the header "
                f"({len(self.header)}), the first is row {bad_rows[0]}: is the separator {self.separator!r} right?"
            )
        if bad_rows:
            raw.lose_rows(
                f"{len(bad_rows)} rows have another number of cells than the header ({len(self.header)}), the first is "
                f"row {bad_rows[0]}: dropped"
            )
        for name, places in failed.items():
            if places:
                place, text = self.odd[name] = places[0]
                raw.losses.append(
                    f"column {name}: {len(places)} cells are no numbers, the first is {text!r} in row "
                    f"{place + raw.first_row}: missing"
                )


READER = TextReader()
