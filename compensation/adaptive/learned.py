"""What was learned, by name: the records of layout.py to plain numbers and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import Record
from .layout import SPOOLS


def as_dict(record: Record) -> dict[str, Any]:
    """A record of doubles by name, its arrays as lists."""
    return {
        name: as_dict(value) if (value := record[name]).dtype.names else value.tolist() for name in record.dtype.names
    }


def fill(record: Record, values: dict[str, Any]) -> None:
    """The inverse of `as_dict`; ValueError and KeyError name what has another size or is missing.
    What `values` has besides is left. Older files have nothing of plain control, bristles or
    softer oil, or not how far the piston follows, or no delay that is told, and the delay's sums by spool alone."""
    for name in record.dtype.names:
        if name in ("plain_control", "follows_V", "oil", "presliding", "told_s") and name not in values:
            continue
        if record[name].dtype.names:
            fill(record[name], values[name])
        else:
            value, size = np.asarray(values[name], dtype=float), record[name].size
            if value.size != size and not (name == "sums" and value.size == SPOOLS):
                raise ValueError(f"{name} has {value.size} numbers where {size} belong")
            record[name] = value.reshape(record[name].shape) if value.size == size else value.repeat(size // SPOOLS)
