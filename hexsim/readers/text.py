"""Delimited text, plain or gzip: bytes to columns of numbers. Every cell that is no number is counted and named."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout

MAX_ROWS = 2_000_000  # rows of a log that are used: half an hour at 1 kHz
CHUNK = 1 << 22
SEPARATORS = {"tab": "\t", ",": ",", ";": ";", "whitespace": " "}
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "#N/A")


class RawTable:
    """Columns as numbers (n,), NaN where a cell is missing; `first_row` is the file row of index 0; losses so far."""

    def __init__(
        self, columns: dict[str, np.ndarray], losses: list[str], first_row: int = 2, units: dict[str, str] | None = None
    ):
        self.columns, self.losses, self.first_row, self.units = columns, losses, first_row, units or {}


def read_text(path: Path, layout: FileLayout) -> RawTable:
    """Read a delimited text file. Raises HexsimError that names file, row and column."""
    losses: list[str] = []
    raw = decoded(path, file_bytes(path, losses))
    head = raw[:65536].decode("utf-8", "replace")
    lines = head.splitlines()
    comment = layout.comment
    start = 0
    while start < len(lines) and (not lines[start].strip() or (comment and lines[start].lstrip().startswith(comment))):
        start += 1
    if start >= len(lines):
        raise HexsimError(f"{path} is empty: no row of data")
    separator = SEPARATORS[layout.separator] if layout.separator else found_separator(lines[start])
    raw = raw.split(b"\n", start)[start] if start else raw
    if separator == " ":
        raw = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", raw))
    header = layout.columns
    if header is None:
        header = header_names(lines[start], separator, path, start + 1)
        raw = raw.split(b"\n", 1)[1] if b"\n" in raw else b""
        start += 1
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise HexsimError(f"{path}: column {sorted(twice)[0]!r} stands twice in the header: name each column once")
    table = numbers(raw, header, separator, comment, path, losses, start + 1)
    return RawTable(table, losses, start + 1)


def file_bytes(path: Path, losses: list[str]) -> bytes:
    """Content of a plain or gzip file, up to about MAX_ROWS lines; a truncated gzip gives what it holds."""
    pieces, lines = [], 0
    try:
        with open(path, "rb") as file:
            zipped = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            inflate = zlib.decompressobj(wbits=31) if zipped else None
            while lines <= MAX_ROWS + 10 and (chunk := file.read(CHUNK)):
                try:
                    piece = inflate.decompress(chunk) if inflate else chunk
                    while inflate and inflate.eof and inflate.unused_data:
                        rest = inflate.unused_data
                        inflate = zlib.decompressobj(wbits=31)
                        piece += inflate.decompress(rest)
                except zlib.error as error:
                    if not pieces:
                        raise HexsimError(f"{path} is a damaged gzip file ({error}): copy it again") from None
                    losses.append(f"{path.name} is a damaged gzip file: what stands before the damage was read")
                    pieces[-1] = pieces[-1].rpartition(b"\n")[0] + b"\n"
                    return b"".join(pieces)
                lines += piece.count(b"\n")
                pieces.append(piece)
            if inflate and not inflate.eof and lines <= MAX_ROWS + 10:
                whole = b"".join(pieces).rpartition(b"\n")[0] + b"\n"
                rows = whole.count(b"\n") - 1
                losses.append(f"{path.name} is a truncated gzip file: the {rows} whole rows were read")
                return whole
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    return b"".join(pieces)


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


def numbers(
    raw: bytes, header: list[str], separator: str, comment: str | None, path: Path, losses: list[str], first_row: int
) -> dict[str, np.ndarray]:
    """Cells to float64. Fast when all cells are numbers; else cell by cell with each failure counted."""
    options: dict[str, Any] = dict(
        has_header=False,
        new_columns=header,
        separator=separator,
        comment_prefix=comment,
        n_rows=MAX_ROWS + 1,
        raise_if_empty=False,
    )
    try:
        table = pl.read_csv(raw, schema_overrides=[pl.Float64] * len(header), **options)
        if table.width != len(header):
            raise pl.exceptions.ComputeError("other number of columns")
    except (pl.exceptions.PolarsError, pl.exceptions.ComputeError):
        table = cell_by_cell(raw, header, separator, comment, path, losses, first_row)
    if table.height > MAX_ROWS:
        losses.append(
            f"{path.name} has more than {MAX_ROWS:,} rows: only the first {MAX_ROWS:,} are used; "
            "cut the file to choose others"
        )
        table = table.head(MAX_ROWS)
    if table.height == 0:
        raise HexsimError(f"{path} has a header and no row of data")
    return {name: table[name].fill_null(np.nan).to_numpy().astype(float) for name in header}


def cell_by_cell(
    raw: bytes, header: list[str], separator: str, comment: str | None, path: Path, losses: list[str], first_row: int
) -> pl.DataFrame:
    """Rows of the wrong length are dropped, cells that are no numbers become missing; both are counted and placed."""
    cells: list[list[str]] = []
    bad_rows: list[int] = []
    for number, line in enumerate(raw.decode().split("\n")):
        if not line.strip() or (comment and line.lstrip().startswith(comment)):
            continue
        row = line.split() if separator == " " else line.split(separator)
        if len(row) == len(header) + 1 and row[-1].strip() == "":
            row.pop()
        if len(row) != len(header):
            bad_rows.append(number + first_row)
            row = [""] * len(header)
        cells.append(row)
        if len(cells) > MAX_ROWS:
            break
    if bad_rows:
        losses.append(
            f"{len(bad_rows)} rows have another number of cells than the header ({len(header)}), the first is row "
            f"{bad_rows[0]}: dropped"
        )
    if len(bad_rows) > 0.2 * max(len(cells), 1):
        raise HexsimError(
            f"{path}: {len(bad_rows)} of {len(cells)} rows have another number of cells than the header "
            f"({len(header)}), the first is row {bad_rows[0]}: is the separator {separator!r} right?"
        )
    columns = {}
    for i, name in enumerate(header):
        column = pl.Series(name, [row[i].strip().strip('"') for row in cells], dtype=pl.String)
        if separator != "," and column.str.contains(",", literal=True).any():
            column = column.str.replace(",", ".", literal=True)
        values = column.cast(pl.Float64, strict=False)
        failed = (values.is_null() & ~column.is_in(list(MISSING))).arg_true()
        if len(failed):
            place = int(failed[0])
            losses.append(
                f"column {name}: {len(failed)} cells are no numbers, the first is {column[place][:20]!r} in row "
                f"{place + first_row}: missing"
            )
        columns[name] = values
    return pl.DataFrame(columns)
