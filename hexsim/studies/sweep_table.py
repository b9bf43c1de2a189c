"""Where the rows of a sweep end: one Parquet file, or a folder of Parquet files that takes any number of rows.

sweep.parquet       all rows in the order of the cases, made at the end: they are in memory once
sweep/              part-000000.parquet and so on, 2000 rows each as they were finished, of one schema;
                    in memory are the keys and one part: polars.scan_parquet("sweep/*.parquet")
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from hexsim.errors import HexsimError, library_errors
from hexsim.files.atomic import PARTIAL, remove_partials, written_whole

KEYS = ("key", "values_key")  # of a case with the bytes of its inputs, and of its declared values alone
FIRST_COLUMNS = (*KEYS, "inputs", "scenario", "machine", "compensator", "seed")
Rows = Mapping[str, dict[str, Any]]
Wanted = Mapping[str, str]  # key -> values_key of the cases of a sweep, in order


def table_at(place: Path) -> Table:
    """The table at a path. Raises HexsimError for a name that is neither a .parquet file's nor a folder's."""
    if place.suffix == ".parquet":
        return OneFile(place)
    if place.suffix == "" or place.is_dir():
        return Parts(place)
    raise HexsimError(
        f"the table {place} must be a .parquet file, or a folder for a table in parts: give --out sweep.parquet or --out sweep"
    )


class Table(abc.ABC):
    """journal: the path of the rows that are finished and not in the table yet. most: rows that are kept there, None: all.

    kept: where an interrupted sweep's finished rows are.
    """

    most: int | None = None

    def __init__(self, place: Path) -> None:
        self.place = place
        self.journal = self.kept = place.with_name(place.name + ".journal")

    @abc.abstractmethod
    def files(self) -> list[Path]:
        """The Parquet files that are there."""

    @abc.abstractmethod
    def finish(self, rows: Rows, wanted: Wanted) -> None:
        """Take the last rows; the table is whole, without earlier rows of the same cases."""

    def failed(self) -> dict[str, bool]:
        """Key -> whether the run failed, of the rows that are there."""
        found: dict[str, bool] = {}
        with library_errors(f"{self.place} is there and is no table of a sweep, give another --out"):
            for file in self.files():
                rows = pl.read_parquet(file, columns=["key", "error"])
                found |= dict(zip(rows["key"], rows["error"].is_not_null(), strict=True))
        return found

    def clean(self) -> None:
        """Remove what killed sweeps have left half written. The journal must be locked."""
        remove_partials(self.place)

    def take(self, rows: Rows) -> None:
        """Keep rows for good, before the table is whole."""
        raise NotImplementedError


class OneFile(Table):
    def files(self) -> list[Path]:
        return [self.place] if self.place.exists() else []

    def finish(self, rows: Rows, wanted: Wanted) -> None:
        """Rows of this sweep first and in order, then those of earlier sweeps."""
        known = {row["key"]: row for file in self.files() for row in pl.read_parquet(file).to_dicts()} | dict(rows)
        replaced = set(wanted.values())
        others = [row for key, row in known.items() if key not in wanted and row.get("values_key") not in replaced]
        write_rows([known[key] for key in wanted] + others, self.place)


class Parts(Table):
    most = 2000

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self.journal, self.kept = place / "journal", place

    def clean(self) -> None:
        for left in self.place.glob(f"{PARTIAL}*"):
            left.unlink(missing_ok=True)

    def files(self) -> list[Path]:
        if not self.place.exists():
            return []
        found = sorted(self.place.glob("part-*.parquet"))
        own = (self.journal.name, f"{self.journal.name}.lock")
        if not found and any(
            path.name not in own and not path.name.startswith(PARTIAL) for path in self.place.iterdir()
        ):
            raise HexsimError(f"{self.place} is there and is no table of a sweep: give another --out")
        return found

    def take(self, rows: Rows) -> None:
        files = self.files()
        number = int(files[-1].stem.removeprefix("part-")) + 1 if files else 0
        write_rows(list(rows.values()), self.place / f"part-{number:06d}.parquet")

    def finish(self, rows: Rows, wanted: Wanted) -> None:
        """All parts get the columns and types of all; of rows with one key the last one stays."""
        if rows:
            self.take(rows)
        self._drop_replaced(wanted)
        schemas = {file: pl.read_parquet_schema(file) for file in self.files()}
        columns: dict[Any, Any] = {}  # column -> type
        for schema in schemas.values():
            columns |= {name: _wider(columns.get(name, kind), kind) for name, kind in schema.items()}
        for file, schema in schemas.items():
            if list(schema.items()) == list(columns.items()):
                continue
            frame = pl.read_parquet(file)
            lacking = [pl.lit(None, dtype=kind).alias(name) for name, kind in columns.items() if name not in schema]
            _write(frame.with_columns(lacking).cast(columns).select(list(columns)), file)

    def _drop_replaced(self, wanted: Wanted) -> None:
        replaced, later = set(wanted.values()), set()
        for file in reversed(self.files()):
            keys = pl.read_parquet(file, columns=[name for name in KEYS if name in pl.read_parquet_schema(file)])
            values = keys["values_key"] if "values_key" in keys.columns else [None] * keys.height
            stays = [
                key not in later and (key in wanted or value not in replaced)
                for key, value in zip(keys["key"], values, strict=True)
            ]
            later.update(keys["key"])
            if not any(stays):
                file.unlink()
            elif not all(stays):
                _write(pl.read_parquet(file).filter(pl.Series(stays)), file)


def _wider(one: pl.DataType, other: pl.DataType) -> pl.DataType:
    """The type that holds values of both."""
    if one == other or other == pl.Null:
        return one
    if one == pl.Null:
        return other
    return pl.Float64() if one.is_numeric() and other.is_numeric() else pl.String()


def write_rows(rows: Sequence[dict[str, Any]], file: Path) -> None:
    """One Parquet file; what a row lacks is null there."""
    names = [name for name in FIRST_COLUMNS if any(name in row for row in rows)]
    names += [name for name in dict.fromkeys(name for row in rows for name in row) if name not in names]
    columns = [[row.get(name) for row in rows] for name in names]
    with library_errors(f"cannot write {file}"):
        frame = pl.DataFrame(columns, schema=names, strict=False, infer_schema_length=None, orient="col")
    _write(frame, file)


def _write(frame: pl.DataFrame, file: Path) -> None:
    with written_whole(file) as temporary, library_errors(f"cannot write {file}, give --out another place", OSError):
        frame.write_parquet(temporary)
