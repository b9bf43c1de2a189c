"""Where the table stands in a text: its separator, its row of names, its units, its first row of data.

The data say it: a column of values is one whose cells are numbers or time stamps in the later rows of the text; the table
begins with the first row whose cells in these columns are values, its names stand in the row above, perhaps with a row of
units between. What stands before is a preamble.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST
from hexsim.signals.units import canonical

SEPARATORS = {"tab": "\t", ",": ",", ";": ";", "whitespace": " "}
TRIED = ("\t", ";", ",", "|", " ")  # the earlier one of two that fit alike
STEADY = 0.8  # share of cells of a column that are values, share of columns that a row of data has
MISSING = frozenset(("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "#N/A", "-", "--"))
# thousands in groups: two marks of one kind, or one and another for the decimals, 3.376.369 or 3,376.5
GROUPED = r"\d{1,3}(?P<mark>[.,'\xa0\u202f])\d{3}((?P=mark)\d{3}((?P=mark)\d{3})*|(?=[.,]\d))((?!(?P=mark))[.,]\d*)?"
NUMBER = re.compile(
    rf"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(inf|infinity|nan)|[+-]?{GROUPED}", re.IGNORECASE
)
STAMP = re.compile(
    r"(\d{1,4}[-/.](\d{1,2}|[A-Za-z]{3})[-/.]\d{1,4}[T ]+)?\d{1,2}:\d{2}(:\d{2}([.,:]\d+)?)?( ?[AaPp][Mm])?"
    r"(Z|[+-]\d{2}:?\d{2})?|\d{8}T\d{6}([.,]\d+)?Z?"
)
FORMATS = (
    *(
        f"{day}{time}"
        for day in (
            "%Y-%m-%d ",
            "%Y/%m/%d ",
            "%d.%m.%Y ",
            "%m/%d/%Y ",
            "%d/%m/%Y ",
            "%d-%m-%Y ",
            "%Y.%m.%d ",
            "%d-%b-%Y ",
        )
        for time in ("%H:%M:%S%.f", "%I:%M:%S%.f %p", "%H:%M")
    ),
    "%Y%m%d %H%M%S%.f",
)
TIMES = ("%H:%M:%S%.f", "%I:%M:%S%.f %p")


@dataclass(kw_only=True)
class Table:
    """header: names. first: line of the text, from 0, where the data begin. numbers: is a column one of numbers (False: of
    texts or time stamps)? group: mark between thousands. units: name -> unit of a row of units. preamble: lines before
    the names. paired_s: every other column is the time of the one behind it, in this unit [s]; 0: one time for all."""

    separator: str
    header: list[str]
    first: int
    numbers: list[bool]
    decimal_comma: bool = False
    group: str = ""
    units: dict[str, str] = field(default_factory=dict)
    preamble: list[str] = field(default_factory=list)
    paired_s: float = 0.0


def split(line: str, separator: str) -> list[str]:
    """Cells of a line, quotes by RFC 4180."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return line.split(separator)


def records(
    lines: list[str],
    separator: str,
    width: int,
    *,
    most_lines: int = 50,  # lines of a cell in quotes with line ends
) -> Iterator[tuple[int, list[str]]]:
    """(line, cells) of each record; a cell in quotes may hold line ends where the record then has `width` cells."""
    i = 0
    while i < len(lines):
        cells, last = split(lines[i], separator), i
        if lines[i].count('"') % 2:
            for j in range(i + 1, min(i + most_lines, len(lines))):
                if lines[j].count('"') % 2:
                    try:
                        whole = next(csv.reader(["\n".join(lines[i : j + 1])], delimiter=separator), [])
                    except csv.Error:
                        break
                    if len(whole) == width:
                        cells, last = whole, j
                    break
        yield i, cells
        i = last + 1


def is_float(cell: str) -> bool:
    """Does Python take it? In a tenth of the time of NUMBER, which then matches too, without marks between thousands."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # which Python takes in a number


def is_value(cell: str) -> bool:
    """A number or a time stamp."""
    cell = cell.strip().strip('"')
    return is_float(cell) or bool(NUMBER.fullmatch(cell) or STAMP.fullmatch(cell))


def find_table(
    lines: list[str],
    layout: FileLayout,
    path: Path,
    *,
    most_lines: int = 2000,  # lines, at most, that say where the table is
    most_characters: int = 200_000,  # that are looked at: fewer lines of wide tables
    least_lines: int = 20,  # and these at least
) -> Table:
    """The table in the first lines of a text. HexsimError where there is none."""
    told = next((re.fullmatch(r"sep=(.)", line.strip("\ufeff\r"), re.IGNORECASE) for line in lines[:1]), None)
    comment, passed = layout.comment, max(layout.skip_rows, (layout.header_row or 1) - 1)
    kept = [
        i
        for i, line in enumerate(lines[: passed + most_lines])
        if i >= passed
        and line.strip()
        and not (comment and line.lstrip().startswith(comment))
        and not (told and i == 0)
    ]
    if not kept:
        raise HexsimError(f"{path} is empty: no row of data")
    longest = LARGEST.text_columns  # a row has fewer cells than characters
    if any(len(lines[i]) > longest and max(map(lines[i].count, TRIED)) > longest for i in kept):
        raise HexsimError(
            f"{path} has a row of more than {LARGEST.text_columns:,} cells, which are the most: save fewer columns"
        )
    kept = kept[: max(most_characters // max(len(lines[kept[len(kept) // 2]]), 1), least_lines)]
    tried = (SEPARATORS[layout.separator],) if layout.separator else (told[1],) if told else TRIED
    absent = [mark for mark in tried if mark != " " and not any(mark in lines[i] for i in kept)]
    tried = [mark for mark in tried if mark not in absent[1:]]  # they divide nothing, alike
    width = len(layout.columns) if layout.columns else None
    found = [shape for mark in tried if (shape := Shape.of([split(lines[i], mark) for i in kept], mark, width))]
    if not found:
        marks = [SEPARATORS[layout.separator]] if layout.separator else [";", "\t", ",", " "]
        mark = max(marks, key=lambda mark: len(split(lines[kept[0]], mark)))
        names = names_of(split(lines[kept[0]], mark))
        if names and not all(is_value(name) for name in names) and len(kept) == 1 and not layout.columns:
            return Table(separator=mark, header=names, first=kept[0] + 1, numbers=[True] * len(names))
        found = [Shape(rows=[split(lines[i], mark) for i in kept], separator=mark, width=len(names), values=[])]
    best = max(found, key=lambda shape: shape.score)
    return best.table(lines, kept, layout, path)


@dataclass(kw_only=True)
class Shape:
    """Lines as cells by one separator. width: cells of a row of data; values: columns of values."""

    rows: list[list[str]]
    separator: str
    width: int
    values: list[int]

    @classmethod
    def of(cls, rows: list[list[str]], separator: str, width: int | None) -> Shape | None:
        """The commonest number of cells of rows in which most are values."""
        later = rows[len(rows) // 2 :] if len(rows) > 3 else rows
        judged = [[(is_value(cell), cell.strip() not in MISSING) for cell in row] for row in later]
        rich = [row for row in judged if sum(v for v, _ in row) >= 0.5 * sum(there for _, there in row) > 0]
        if not rich:
            return None
        width = width or Counter(map(len, rich)).most_common(1)[0][0]
        values = []
        for k in range(min(width, LARGEST.text_columns)):
            found = [row[k][0] for row in rich if len(row) == width and row[k][1]]
            if found and sum(found) >= STEADY * len(found):
                values.append(k)
        return cls(rows=rows, separator=separator, width=width, values=values) if values else None

    def is_data(self, row: list[str]) -> bool:
        """Are the cells in columns of values such, or missing?"""
        if abs(len(row) - self.width) > 1:
            return False
        cells = [row[k].strip() for k in self.values if k < len(row)]
        values = [is_value(cell) for cell in cells]
        good = sum(value or cell in MISSING for value, cell in zip(values, cells, strict=True))
        return any(values) and good >= STEADY * len(self.values)

    @cached_property
    def data(self) -> list[bool]:
        """`is_data` of each row."""
        return [self.is_data(row) for row in self.rows]

    @property
    def score(self) -> int:
        """Cells of values in rows of data; a single column is no table where another separator finds two."""
        rows = sum(self.data)
        return rows * len(self.values) if self.width > 1 else min(rows, 1)

    def table(self, lines: list[str], kept: list[int], layout: FileLayout, path: Path) -> Table:
        """Names above the first row of data."""
        good = self.data
        begins = next(
            (k for k in range(len(good)) if good[k] and sum(good[k : k + 5]) >= min(4, len(good) - k)), len(good)
        )
        header, units, above = layout.columns, {}, begins
        paired = self.paired(begins, good) if header is None else None
        if paired is not None:
            above, header = paired
        elif header is None:
            above = begins - 1
            if above < 0 or (begins == len(good) and begins > 1):
                raise HexsimError(
                    f"{path}: row {kept[0] + 1} holds no names: give one header row, or columns in a mapping file"
                    if good[:1] == [True]
                    else f"{path} holds no row of numbers: the first row is {lines[kept[0]][:60]!r}"
                )
            if layout.header_row is not None:
                above = min(above, 1 if above > 0 and is_units(names_of(self.rows[1])) else 0)
            names = names_of(self.rows[above])
            higher = names_of(self.rows[above - 1]) if above > 0 else []
            if len(higher) > 1 and is_units(names) and not is_units(higher) and abs(len(higher) - len(names)) <= 1:
                units = {name: unit for name, unit in zip(higher, names, strict=False) if canonical(unit)}
                above, names = above - 1, higher
            if not names or all(is_value(name) for name in names):
                raise HexsimError(
                    f"{path}: row {kept[above] + 1} holds no names: give one header row, or columns in a mapping file"
                )
            header = [name or f"column {i + 1}" for i, name in enumerate(names)]
        first = kept[begins] if begins < len(kept) else kept[-1] + 1
        cells = [row for row, ok in zip(self.rows, good, strict=True) if ok]
        numbers = [self.of_numbers([row[k] for row in cells if k < len(row)]) for k in range(len(header))]
        values = [row[k].strip().strip('"') for row in cells for k in self.values if k < len(row)]
        odd = (value for value in values if not is_float(value))
        group = next((found["mark"] for value in odd if (found := NUMBER.fullmatch(value)) and found["mark"]), "")
        comma = (self.separator != "," or group == ".") and group != "," and any("," in value for value in values)
        before = [lines[i] for i in kept[:above]]
        if layout.columns is not None:
            before = [line for line, ok in zip(before, good, strict=False) if not ok]
        return Table(
            separator=self.separator,
            header=header,
            first=first,
            numbers=numbers,
            decimal_comma=comma,
            group=group,
            units=units,
            preamble=before,
            paired_s=self.time_unit(begins) if paired is not None else 0.0,
        )

    def paired(self, begins: int, good: list[bool]) -> tuple[int, list[str]] | None:
        """(row of the names, names) of a table in which every other column is a time that rises, each under the same name
        (TwinCAT Scope: Name, Pos, Name, Pressure); None for another one."""
        rows = [row for row, ok in zip(self.rows[begins:], good[begins:], strict=True) if ok]
        if self.width < 4 or self.width % 2 or len(rows) < 3:
            return None
        for k in range(0, self.width, 2):
            times = [number for row in rows if k < len(row) and (number := number_of(row[k])) is not None]
            if len(times) < 3 or sum(a < b for a, b in pairwise(times)) < STEADY * (len(times) - 1):
                return None
        for above in range(begins - 1, -1, -1):
            cells = names_of(self.rows[above])
            own = cells[1::2]
            alike = len(cells) == self.width and len(set(cells[::2])) == 1 and not is_value(cells[0])
            if alike and len(set(own)) == len(own) and all(own) and not any(map(is_value, own)):
                return above, [cell for name in own for cell in (f"time of {name}", name)]
        return None

    def time_unit(self, begins: int) -> float:
        """[s] of a unit of time that stands in brackets above the data; 1 without any."""
        said = re.findall(r"\[(ms|us|µs|ns|s)\]", " ".join(cell for row in self.rows[:begins] for cell in row))
        return {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}.get(said[0], 1.0) if said else 1.0

    @staticmethod
    def of_numbers(cells: list[str]) -> bool:
        """Is this a column of numbers? One without any value may be."""
        there = [cell.strip().strip('"') for cell in cells if cell.strip().strip('"') not in MISSING]
        return not there or sum(is_float(cell) or bool(NUMBER.fullmatch(cell)) for cell in there) >= 0.5 * len(there)


def number_of(cell: str) -> float | None:
    """A cell as a number, a comma for its point as well."""
    cell = cell.strip().strip('"').replace(",", ".")
    return float(cell) if NUMBER.fullmatch(cell) and cell[-1:].isdigit() else None


def names_of(cells: list[str]) -> list[str]:
    """Names of a row: without quotes, a # before them, empty cells at the end."""
    names = [name.strip().strip('"').strip() for name in cells]
    names = names[1:] if names and names[0] == "#" else [names[0].lstrip("# "), *names[1:]] if names else names
    while names and names[-1] == "":
        names.pop()
    return names


def is_units(names: list[str]) -> bool:
    """A row of units: each is one, in brackets or not, or empty."""
    there = [name for name in names if name]
    return bool(there) and all(canonical(name.strip("[]()")) or name in ("-", "[-]") for name in there)


def seconds(texts: pl.Series) -> pl.Series | None:
    """Time stamps as text (n,) as seconds: dates from the first one on, times of day from midnight; None for other text."""
    zone = texts.str.extract_groups(r":\d{2}\S* ?([+-]\d{2}):?(\d{2})$").struct.unnest().cast(pl.Float64)
    east = zone.select(3600 * pl.nth(0) + 60 * pl.nth(1) * pl.nth(0).sign()).to_series().fill_null(0.0)  # [s]
    clean = texts.str.strip_chars().str.replace(r"(\d)T(\d)", "$1 $2").str.replace(r"(Z|[+-]\d{2}:?\d{2})$", "")
    clean = clean.str.replace(r"(:\d{2}),(\d+)", "$1.$2").str.replace(r"(:\d{2}:\d{2}):(\d+)$", "$1.$2")
    some = clean.drop_nulls()
    some = some.filter(some.str.len_chars() > 0).head(50)
    if not len(some):
        return None
    for style in (*FORMATS, *TIMES):
        time_of_day = style in TIMES
        given = "%Y-%m-%d " + style if time_of_day else style
        before = "2000-01-01 " if time_of_day else ""
        if (before + some).str.strptime(pl.Datetime("ns"), given, strict=False).null_count() > 0.2 * len(some):
            continue
        stamps = (before + clean).str.strptime(pl.Datetime("ns"), given, strict=False)
        first = (
            pl.Series([before + "00:00:00"]).str.strptime(pl.Datetime("ns"), "%Y-%m-%d %H:%M:%S")[0]
            if time_of_day
            else stamps.drop_nulls()[0]
        )
        return (stamps - first).dt.total_nanoseconds().cast(pl.Float64) * 1e-9 - (east - east[0])
    return None
