"""Strict JSON files, written whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.files.atomic import write_text


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON whole or not at all."""
    write_text(path, dumps(data) + "\n")


def dumps(data: Any) -> str:
    """Strict JSON: what is not a finite number becomes null."""
    return json.dumps(plain(data, none_for_nan=True), indent=2, allow_nan=False, ensure_ascii=False)


def plain(data: Any, none_for_nan: bool = False) -> Any:
    """numpy values, tuples and paths as what JSON and TOML hold; keys without a value go, unless `none_for_nan`."""
    if isinstance(data, Mapping):
        items = {str(key): plain(value, none_for_nan) for key, value in data.items()}
        return items if none_for_nan else {key: value for key, value in items.items() if value is not None}
    if isinstance(data, np.ndarray):
        data = data.tolist()
    if isinstance(data, (list, tuple)):
        return [plain(value, none_for_nan) for value in data]
    if isinstance(data, np.generic):
        data = data.item()
    if isinstance(data, float) and not math.isfinite(data):
        return None if none_for_nan else data
    if isinstance(data, Path):
        return str(data)
    return data
