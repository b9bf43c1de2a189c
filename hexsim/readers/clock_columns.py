"""Columns of time in formats that have several tables in a file: found by name, type and rise, in seconds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hexsim.errors import HexsimError
from hexsim.signals.units import unit_of_name, unit_to_si

NAMES = ("t", "time", "timestamp", "timestamps", "stamp", "zeit", "temps")  # of a column of time, without its unit
Array = np.ndarray


def seconds_of(stamps: Array) -> Array:
    """datetime64 or timedelta64 (n,) as seconds: dates from the first one on, NaN where there is none."""
    there = stamps[~np.isnat(stamps)]
    whole = stamps - there[0] if stamps.dtype.kind == "M" and len(there) else stamps
    if whole.dtype.kind != "m":
        return np.full(len(stamps), np.nan)
    return np.where(np.isnat(whole), np.nan, (whole / np.timedelta64(1, "ns")).astype(float) * 1e-9)


def time_columns(columns: Mapping[str, Array], units: Mapping[str, str] | None = None) -> dict[int, tuple[str, Array]]:
    """Length -> (name, stamps (n,) [s]) of the first column of time of that length: dates, or numbers named so.

    units: of columns, where the file states them. A unit in the name counts; without any it is seconds.
    """
    found: dict[int, tuple[str, Array]] = {}
    for name, values in columns.items():
        if len(values) in found:
            continue
        if values.dtype.kind in "Mm":
            found[len(values)] = name, seconds_of(values)
            continue
        stem, unit = unit_of_name(name.rpartition(".")[2].strip())
        if stem.strip().lower() not in NAMES or values.dtype.kind not in "fiu":
            continue
        stated = (units or {}).get(name) or unit or "s"
        try:
            factor, _ = unit_to_si(stated, name, "s")
        except HexsimError:
            continue
        found[len(values)] = name, values.astype(float) * factor
    return found
