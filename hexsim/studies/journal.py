"""The journal of a sweep: finished rows on disk before they are in the table (`sweep_table`).

It holds one JSON object a line. A line is synced before the next run is counted; a line that a kill cut short has no
newline and is dropped. While a sweep runs the journal is locked, so two cannot write one table.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
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
            self._file = open(self.path, "a+b")
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
            self.failed = self.table.failed()
            self.rows = {key: row for key, row in self._journal_rows().items() if key not in self.failed}
            self.failed |= {key: bool(row["error"]) for key, row in self.rows.items()}
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
        try:
            self._file.write(json.dumps(row).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise HexsimError(
                f"cannot write {self.path}: {error.strerror}; {self.status()}, run it again to go on"
            ) from None
        self.rows[row["key"]], self.failed[row["key"]] = row, bool(row["error"])
        if self.table.most is not None and len(self.rows) >= self.table.most:
            self.table.take(self.rows)
            self._file.truncate(0)
            self.rows.clear()

    def finish(self, order: Sequence[str]) -> None:
        """Write the table, then remove the journal."""
        self.table.finish(self.rows, order)
        if self._file is not None:
            self._file.close()  # Windows removes no file that is open
        self.path.unlink()

    def status(self) -> str:
        """Where the rows are that are done."""
        return f"{len(self.failed)} rows are kept in {self.table.kept}"


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a journal's line, or None for one that is damaged: its case is run again."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return row if isinstance(row, dict) and isinstance(row.get("key"), str) and "error" in row else None
