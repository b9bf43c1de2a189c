"""The journal of a sweep: finished rows on disk before they are in the table (`sweep_table`).

It holds a checksum and one JSON object a line. A line is synced before the next run is counted; a line that a kill or a
full disk cut short, or that is odd, is dropped and its case is run again. While a sweep runs the journal is locked, so two
cannot write one table.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from filelock import FileLock, Timeout

from hexsim.errors import HexsimError
from hexsim.studies.sweep_table import table_at


class Journal:
    """failed: key -> whether the run failed, of all rows there are. rows: those that are not in the table yet."""

    def __init__(self, place: Path) -> None:
        self.table = table_at(place)
        self.path = self.table.journal
        self.failed: dict[str, bool] = {}
        self.rows: dict[str, dict[str, Any]] = {}
        self._file: IO[bytes] | None = None
        self._lock = FileLock(f"{self.path}.lock", blocking=False)

    def __enter__(self) -> Journal:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
            self._file = open(self.path, "a+b", buffering=0)  # a buffer would be written again at the end
        except Timeout:
            raise HexsimError(
                f"another sweep is writing {self.table.place}: wait for it, or give another --out"
            ) from None
        except OSError as error:
            self._close()
            raise HexsimError(
                f"cannot write {self.path}: {error.strerror or error}; give --out a place that can be written"
            ) from None
        try:
            self.table.clean()
            self.rows = self._journal_rows()
            self.failed = self.table.failed() | {key: bool(row["error"]) for key, row in self.rows.items()}
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
        end = self._file.seek(0, os.SEEK_END)
        try:
            rest = line_of(row)
            while rest:
                rest = rest[self._file.write(rest) or 0 :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(end)
            raise HexsimError(
                f"cannot write {self.path}: {error.strerror}; {self.status()}, run it again to go on"
            ) from None
        self.rows[row["key"]], self.failed[row["key"]] = row, bool(row["error"])
        if self.table.most is not None and len(self.rows) >= self.table.most:
            self.table.take(self.rows)
            self._file.truncate(0)
            self.rows.clear()

    def finish(self, wanted: Mapping[str, str]) -> None:
        """Write the table of the cases with these keys (key -> values_key), then remove the journal."""
        try:
            self.table.finish(self.rows, wanted)
        except (HexsimError, OSError) as error:
            raise HexsimError(f"{error}; {self.status()}, run the same command again to go on") from None
        if self._file is not None:
            self._file.close()  # Windows removes no file that is open
        self.path.unlink()

    def status(self) -> str:
        """Where the rows are that are done."""
        return f"{len(self.failed)} rows are kept in {self.table.kept}"


def line_of(row: dict[str, Any]) -> bytes:
    """A row as a line of the journal."""
    text = json.dumps(row).encode()
    return _checksum(text) + b" " + text + b"\n"


def _checksum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest()[:16].encode()


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a journal's line, or None for one that is damaged or odd: its case is run again."""
    checksum, _, text = line.partition(b" ")
    if checksum != _checksum(text):
        return None
    try:
        row = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(row, dict) or not isinstance(row.get("key"), str) or "error" not in row:
        return None
    return row if all(_is_cell(value) for value in row.values()) else None


def _is_cell(value: Any) -> bool:
    """Whether a table can hold a value."""
    return value is None or isinstance(value, (str, float, bool)) or (isinstance(value, int) and abs(value) < 2**63)
