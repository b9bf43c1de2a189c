"""Rows of a sweep on disk: a journal while it runs, one Parquet table when it is done.

The journal `<table>.journal` holds one JSON object a line. A line is synced before the next run is counted; a line
that a kill cut short has no newline and is dropped. While a sweep runs the journal is locked, so two cannot write one
table.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import polars as pl
from filelock import FileLock, Timeout

from hexsim.errors import HexsimError
from hexsim.files.atomic import written_whole

FIRST_COLUMNS = ("key", "scenario", "machine", "compensator", "seed")


class Journal:
    """`rows`: key -> row, of the table that is there and of a sweep that was cut short."""

    def __init__(self, table: Path) -> None:
        if table.suffix != ".parquet":
            raise HexsimError(f"the table {table} must be a .parquet file: give for example --out sweep.parquet")
        self.table = table
        self.path = table.with_name(table.name + ".journal")
        self.rows: dict[str, dict[str, Any]] = {}
        self._file: IO[bytes] | None = None
        self._lock = FileLock(f"{self.path}.lock", blocking=False)

    def __enter__(self) -> Journal:
        try:
            self.table.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
            self._file = open(self.path, "a+b")
        except Timeout:
            raise HexsimError(f"another sweep is writing {self.table}: wait for it, or give another --out") from None
        except OSError as error:
            self._close()
            raise HexsimError(
                f"cannot write {self.path}: {error.strerror or error}; give --out a place that can be written"
            ) from None
        try:
            self.rows = self._finished_rows() | self._journal_rows()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        """Close the journal; an empty one and the lock are not left behind."""
        if self._file is not None:
            self._file.close()
            if self.path.exists() and self.path.stat().st_size == 0:
                self.path.unlink()
        if self._lock.is_locked:
            self._lock.release()
            Path(self._lock.lock_file).unlink(missing_ok=True)

    def _finished_rows(self) -> dict[str, dict[str, Any]]:
        """Rows of a table that is there already."""
        if not self.table.exists():
            return {}
        try:
            rows = pl.read_parquet(self.table).to_dicts()
            return {row["key"]: row for row in rows}
        except (OSError, KeyError, pl.exceptions.PolarsError):
            raise HexsimError(f"{self.table} is there and is no table of a sweep: give another --out") from None

    def _journal_rows(self) -> dict[str, dict[str, Any]]:
        """Whole lines of the journal; what follows the last newline is cut off, and a damaged line is left out."""
        assert self._file is not None
        self._file.seek(0)
        data = self._file.read()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            self._file.truncate(len(whole))
        rows = [row for line in whole.split(b"\n") if (row := _row(line)) is not None]
        return {row["key"]: row for row in rows}

    def add(self, row: dict[str, Any]) -> None:
        """Keep a row for good."""
        assert self._file is not None
        try:
            self._file.write(json.dumps(row).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise HexsimError(
                f"cannot write {self.path}: {error.strerror}; {self.status()}, run it again to go on"
            ) from None
        self.rows[row["key"]] = row

    def finish(self, order: Sequence[str]) -> None:
        """Write the table, rows of this sweep first and in order, then remove the journal."""
        first = [self.rows[key] for key in order]
        mine = set(order)
        write_table(first + [row for key, row in self.rows.items() if key not in mine], self.table)
        if self._file is not None:
            self._file.close()  # Windows removes no file that is open
        self.path.unlink()

    def status(self) -> str:
        """Where the rows are that are done."""
        return f"{len(self.rows)} rows are kept in {self.path}"


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a journal's line, or None for one that is damaged: its case is run again."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return row if isinstance(row, dict) and isinstance(row.get("key"), str) and "error" in row else None


def write_table(rows: Sequence[dict[str, Any]], table: Path) -> None:
    """One Parquet table; what a row lacks is null there."""
    names = [name for name in FIRST_COLUMNS if any(name in row for row in rows)]
    names += [name for name in dict.fromkeys(name for row in rows for name in row) if name not in names]
    frame = pl.DataFrame(
        [[row.get(name) for row in rows] for name in names],
        schema=names,
        strict=False,
        infer_schema_length=None,
        orient="col",
    )
    with written_whole(table) as temporary:
        frame.write_parquet(temporary)
