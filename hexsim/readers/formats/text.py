"""Delimited text, plain or gzip. Every cell that is no number is counted and named."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import MAX_ROWS, RawLog, RawSignal, Reader, max_rows

CHUNK = 1 << 22  # bytes that are read and inflated at once
LARGEST = 300_000_000  # bytes of text that are read: two million rows of a bench, one of a hexapod
BLOCK = 50_000  # rows that are parsed at once where they are parsed cell by cell
SEPARATORS = {"tab": "\t", ",": ",", ";": ";", "whitespace": " "}
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "#N/A")


class TextReader(Reader):
    """Delimited text with one row of names, or names from a mapping file."""

    name = "text"
    suffixes = (".csv", ".txt", ".exp", ".dat", ".tsv", ".asc")

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        raw = RawLog(signals=[])
        text = decoded(path, file_bytes(path, raw))
        lines = text[:65536].decode("utf-8", "replace").splitlines()
        comment = layout.comment
        start = 0
        while start < len(lines) and (
            not lines[start].strip() or (comment and lines[start].lstrip().startswith(comment))
        ):
            start += 1
        if start >= len(lines):
            raise HexsimError(f"{path} is empty: no row of data")
        separator = SEPARATORS[layout.separator] if layout.separator else found_separator(lines[start])
        text = text.split(b"\n", start)[start] if start else text
        if separator == " ":
            text = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", text))
        header = layout.columns
        if header is None:
            header = header_names(lines[start], separator, path, start + 1)
            text = text.split(b"\n", 1)[1] if b"\n" in text else b""
            start += 1
        twice = {name for name in header if header.count(name) > 1}
        if twice:
            raise HexsimError(f"{path}: column {sorted(twice)[0]!r} stands twice in the header: name each column once")
        raw.first_row = start + 1
        cells = Cells(path=path, header=header, separator=separator, comment=comment)
        cells.read(text, raw)
        return raw


def inflated(file: IO[bytes]) -> Iterator[bytes]:
    """Content of a gzip file, at most CHUNK bytes at a time however well it is packed; several members as one.

    Raises EOFError where it ends within a member, zlib.error where it is damaged.
    """
    inflate, packed = zlib.decompressobj(wbits=31), b""
    while True:
        packed = packed or file.read(CHUNK)
        if inflate.eof:
            if not packed:
                return
            inflate = zlib.decompressobj(wbits=31)  # another member follows
        piece = inflate.decompress(packed, CHUNK)
        if not (packed or piece or inflate.eof):
            raise EOFError
        yield piece
        packed = inflate.unused_data if inflate.eof else inflate.unconsumed_tail


def file_bytes(path: Path, raw: RawLog) -> bytes:
    """Content of a plain or gzip file, up to about MAX_ROWS lines and LARGEST bytes; a damaged gzip gives what it holds."""
    pieces: list[bytes] = []
    lines = size = 0
    try:
        with open(path, "rb") as file:
            zipped = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            for piece in inflated(file) if zipped else iter(lambda: file.read(CHUNK), b""):
                lines, size = lines + piece.count(b"\n"), size + len(piece)
                pieces.append(piece)
                if lines > MAX_ROWS + 10:
                    break
                if size > LARGEST:
                    raw.lose_rows(
                        f"{path.name} is larger than {LARGEST // 1_000_000} MB of text: only so much of it is used; "
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


def decoded(path: Path, raw: bytes) -> bytes:
    """UTF-8 with \\n line ends; refuses what is no text."""
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
    return raw


def found_separator(line: str) -> str:
    """The separator that a header line uses most."""
    counts = {mark: line.count(mark) for mark in (",", ";", "\t")}
    best = max(counts, key=lambda mark: counts[mark])
    if counts[best] > 0:
        return best
    return " " if len(line.split()) > 1 else ","


def header_names(line: str, separator: str, path: Path, row: int) -> list[str]:
    """Names of a header line; refuses numbers and empty names."""
    names = [name.strip().strip('"').strip() for name in (line.split() if separator == " " else line.split(separator))]
    names = names[1:] if names and names[0] == "#" else [names[0].lstrip("# "), *names[1:]] if names else names
    while names and names[-1] == "":  # a separator at the end of each row
        names.pop()
    if not names or all(is_number(name) for name in names):
        raise HexsimError(f"{path}: row {row} holds no names: give one header row, or columns in a mapping file")
    return [name or f"column {i + 1}" for i, name in enumerate(names)]


def is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


class Cells:
    """Cells of a table of text and how they become numbers."""

    def __init__(self, *, path: Path, header: list[str], separator: str, comment: str | None) -> None:
        self.path, self.header, self.separator, self.comment = path, header, separator, comment
        self.most = max_rows(len(header)) + 1
        self.odd: dict[str, tuple[int, str]] = {}

    def read(self, text: bytes, raw: RawLog) -> None:
        """Fill raw.columns: fast when all cells are numbers; else cell by cell with each failure counted."""
        options: dict[str, Any] = {
            "has_header": False, "new_columns": self.header, "separator": self.separator, "n_rows": self.most,
            "comment_prefix": self.comment, "raise_if_empty": False,
        }  # fmt: skip
        try:
            table = pl.read_csv(text, schema_overrides=[pl.Float64] * len(self.header), **options)
            if table.width != len(self.header):
                raise pl.exceptions.ComputeError("other number of columns")
        except pl.exceptions.PolarsError:
            table = self.one_by_one(text.decode(), raw)
        for name in self.header:
            odd = self.odd.get(name)
            if odd is None and table[name].null_count():
                odd = int(table[name].is_null().arg_max() or 0), "an empty cell"
            values = table[name].fill_null(np.nan).to_numpy().astype(float)
            raw.signals.append(RawSignal(name=name, values=values, odd=odd))

    def one_by_one(self, text: str, raw: RawLog) -> pl.DataFrame:
        """Rows of the wrong length are dropped, cells that are no numbers become missing; both are counted and placed."""
        blocks: list[pl.DataFrame] = []
        rows: list[list[str]] = []
        bad_rows: list[int] = []
        failed: dict[str, list[tuple[int, str]]] = {name: [] for name in self.header}
        for number, line in enumerate(text.split("\n")):
            if not line.strip() or (self.comment and line.lstrip().startswith(self.comment)):
                continue
            row = line.split() if self.separator == " " else line.split(self.separator)
            if len(row) == len(self.header) + 1 and row[-1].strip() == "":
                row.pop()
            if len(row) != len(self.header):
                bad_rows.append(number + raw.first_row)
                row = [""] * len(self.header)
            rows.append(row)
            if len(rows) == BLOCK:
                blocks.append(self.block(rows, len(blocks) * BLOCK, failed))
                rows = []
            if len(blocks) * BLOCK + len(rows) >= self.most:
                break
        blocks.append(self.block(rows, len(blocks) * BLOCK, failed))
        table = pl.concat(blocks)
        self.state(bad_rows, failed, table.height, raw)
        return table

    def block(self, rows: list[list[str]], first: int, failed: dict[str, list[tuple[int, str]]]) -> pl.DataFrame:
        """Some rows as numbers; cells that are none go to `failed`."""
        columns = {}
        for i, name in enumerate(self.header):
            column = pl.Series(name, [row[i].strip().strip('"') for row in rows], dtype=pl.String)
            if self.separator != "," and column.str.contains(",", literal=True).any():
                column = column.str.replace(",", ".", literal=True)
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
