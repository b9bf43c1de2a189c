"""The state of an unfinished trace of a machine of one's own: every fit that was made, in one JSON file that is whole or not there.

What it is the state of stands beside it: the folder that was traced, what was asked for, and the content of its files and logs.
"""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hexsim import __version__
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.inference.notebook import Entry, Notebook
from hexsim.signals.log import Log

FILE = "own_trace_state.json"
FORMAT = 1  # of the file; another one is not read


@dataclass(frozen=True, kw_only=True)
class Asked:
    """folder: of the machine. fit, validate: logs that were named, none: as its file says."""

    folder: str
    fit: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()


class StateFile:
    """In a folder. Begun anew, or read by `of`; `notebook` then gives the fits that there are, and writes every new one."""

    def __init__(self, place: Path, asked: Asked) -> None:
        self.path, self.asked = place / FILE, asked
        self.entries: list[Entry] = []
        self.hashes: dict[str, str] = {}
        self._writing = threading.Lock()

    @classmethod
    def of(
        cls,
        place: Path,
        *,
        most_bytes: float = 200e6,  # of the file: some hundred fits of a hundred numbers
    ) -> StateFile:
        """What a folder holds. HexsimError where it cannot be read, or is of another version."""
        path = place / FILE
        try:
            if path.stat().st_size > most_bytes:
                raise ValueError(f"more than {most_bytes / 1e6:.0f} MB")
            told = json.loads(path.read_text(encoding="utf-8"))
            made_by = (told["format"], str(told["version"])[:20])
            if made_by != (FORMAT, __version__):
                raise HexsimError(
                    f"{path} was written by hexsim {made_by[1]}, this is {__version__}: start the trace anew"
                )
            asked = told["asked"]
            found = cls(
                place,
                Asked(
                    folder=text(asked["folder"]),
                    fit=tuple(map(text, asked["fit"])),
                    validate=tuple(map(text, asked["validate"])),
                ),
            )
            found.hashes = {text(name): text(value) for name, value in told["hashes"].items()}
            found.entries = [Entry.of_json(own) for own in told["entries"]]
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
            raise HexsimError(
                f"{path} cannot be read ({type(error).__name__}: {str(error)[:160]}): start the trace anew"
            ) from None
        return found

    def notebook(self, files: Iterable[Path], logs: Sequence[Log]) -> Notebook:
        """Raises HexsimError where files or logs are other ones than when the trace began."""
        hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files if path.is_file()}
        hashes |= {
            f"log {log.name}" + (f" from {log.offset_s:g} s" if log.offset_s else ""): hash_of(log) for log in logs
        }
        other = sorted(name for name in {*hashes, *self.hashes} if hashes.get(name) != self.hashes.get(name))
        if self.entries and other:
            raise HexsimError(
                f"{other[0]} of {self.asked.folder} has changed since the trace in {self.path.parent} began: start the trace anew"
            )
        self.hashes = hashes
        return Notebook(self.entries, self._keep)

    def _keep(self, entries: list[Entry]) -> None:
        told: dict[str, Any] = {
            "format": FORMAT,
            "version": __version__,
            "asked": vars(self.asked),
            "hashes": self.hashes,
            "entries": [own.to_json() for own in entries],
        }
        with self._writing:
            write_text(self.path, json.dumps(told, allow_nan=False))
        self.entries = list(entries)

    def settle(self, timeout_s: float = 1.0) -> None:
        """Wait for a file that is being written."""
        self._writing.acquire(timeout=timeout_s)

    def forget(self) -> None:
        """A finished trace needs it no more."""
        with suppress(OSError):
            self.path.unlink()


def hash_of(log: Log) -> str:
    """SHA-256 of the content of a log as it was read."""
    found = hashlib.sha256(np.ascontiguousarray(log.time).tobytes())
    for name in sorted(log.columns):
        found.update(name.encode())
        found.update(np.ascontiguousarray(log.columns[name]).tobytes())
    return found.hexdigest()


def text(value: Any) -> str:
    """A text of at most 4,096 characters. Raises TypeError, ValueError."""
    if not isinstance(value, str):
        raise TypeError("a text is something else")
    if len(value) > 4096:
        raise ValueError("a text is too long")
    return value
