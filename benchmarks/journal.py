"""Journals of the benchmarks: one JSON object a line, packed where the name ends in `.gz`. They live in benchmarks/results."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any, TextIO, cast

RESULTS = Path(__file__).parent / "results"


def _opened(file: Path, mode: str) -> TextIO:
    if file.suffix == ".gz":
        return cast(TextIO, gzip.open(file, mode + "t", encoding="utf-8"))
    return file.open(mode, encoding="utf-8")


def lines_of(file: Path | None) -> list[dict[str, Any]]:
    """All objects of a journal in their order; none where there is no file."""
    if file is None or not file.is_file():
        return []
    with _opened(file, "r") as lines:
        return [json.loads(line) for line in lines]


def append(line: dict[str, Any], file: Path) -> None:
    """One more line; a packed file gets it as a member of its own."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with _opened(file, "a") as out:
        out.write(json.dumps(line) + "\n")
