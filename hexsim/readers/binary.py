"""Parquet, MAT (level 5) and MDF files to columns of numbers."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.text import MAX_ROWS, RawTable


def cut(columns: dict[str, np.ndarray], path: Path, losses: list[str]) -> dict[str, np.ndarray]:
    """The first MAX_ROWS rows, with a stated loss."""
    rows = max(len(values) for values in columns.values())
    if rows <= MAX_ROWS:
        return columns
    losses.append(f"{path.name} has {rows:,} rows: only the first {MAX_ROWS:,} are used; cut the file to choose others")
    return {name: values[:MAX_ROWS] for name, values in columns.items()}


def read_parquet(path: Path) -> RawTable:
    """Numeric columns of a Parquet file."""
    losses: list[str] = []
    try:
        table = pl.read_parquet(path, n_rows=MAX_ROWS + 1)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise HexsimError(f"cannot read {path} as Parquet: {first_line(error)}") from None
    columns = {}
    for name in table.columns:
        if table[name].dtype.is_numeric():
            columns[name] = table[name].cast(pl.Float64).fill_null(np.nan).to_numpy().astype(float)
        else:
            losses.append(f"column {name} holds {table[name].dtype}, not numbers: left out")
    if not columns or table.height == 0:
        raise HexsimError(f"{path} holds no row of numbers")
    return RawTable(cut(columns, path, losses), losses, 1)


def read_mat(path: Path) -> RawTable:
    """Vectors of equal length in a MAT-file: variables, fields of a struct, or a Simulink structure with time."""
    import scipy.io

    try:
        with open(path, "rb") as file:
            head = file.read(128)
        if b"MATLAB 7.3" in head or head[:8] == b"\x89HDF\r\n\x1a\n":
            raise HexsimError(f"{path} is a MAT-file of version 7.3: save it again with save(..., '-v7')")
        content: dict[str, Any] = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except HexsimError:
        raise
    except Exception as error:  # scipy raises many kinds on damaged files
        raise HexsimError(f"cannot read {path} as a MAT-file: {first_line(error)}") from None
    found: dict[str, np.ndarray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            collect(name, value, found, 0)
    if not found:
        raise HexsimError(f"{path} holds no vector of numbers: give variables of equal length, one a signal")
    return RawTable(*same_length(path, found), 1)


def collect(name: str, value: Any, found: dict[str, np.ndarray], depth: int) -> None:
    """Vectors under `value`; fields of structs by their own name (with the struct's in front when taken)."""
    if hasattr(value, "_fieldnames") and depth < 4:
        label = getattr(value, "label", None)
        values = getattr(value, "values", None)
        if isinstance(label, str) and label and isinstance(values, np.ndarray):  # Simulink signal
            collect(label, values, found, depth + 1)
            return
        for field in value._fieldnames:
            key = "time_s" if field == "time" and depth == 0 else field
            collect(key if key not in found else f"{name}.{field}", getattr(value, field), found, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype == object and depth < 4:
        for i, item in enumerate(value.ravel()[:200]):
            collect(f"{name}{i + 1}", item, found, depth + 1)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub" and len(value) > 2:
        found[name] = value.astype(float)
    elif isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiub" and max(value.shape) > 2:
        rows = value if value.shape[0] <= value.shape[1] else value.T
        for i, row in enumerate(rows[:100]):
            found[f"{name}_{i + 1}"] = row.astype(float)


def same_length(path: Path, found: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
    """The vectors of the commonest length (weighted by it); others are left out with a stated loss."""
    losses: list[str] = []
    sizes = [len(values) for values in found.values()]
    length = max(set(sizes), key=lambda size: (sizes.count(size), size))
    for name, values in found.items():
        if len(values) != length:
            losses.append(f"{name} has {len(values)} values, the others {length}: left out")
    return cut({n: v for n, v in found.items() if len(v) == length}, path, losses), losses


@contextmanager
def quiet() -> Iterator[None]:
    """asammdf logs and raises in destructors on damaged files; the HexsimError says it once."""
    hook, logger = sys.unraisablehook, logging.getLogger("asammdf")
    level = logger.level
    sys.unraisablehook = lambda _: None
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
        logger.setLevel(level)


def read_mdf(path: Path) -> RawTable:
    """Channels of an MDF file on the time stamps of its fastest group; slower ones by linear interpolation."""
    try:
        from asammdf import MDF
    except ImportError:
        raise HexsimError(f"{path} is an MDF file: reading it needs asammdf; pip install 'hexsim[mdf]'") from None
    content = BytesIO(path.read_bytes())  # asammdf leaves a damaged file open
    if content.getvalue()[:3] != b"MDF":
        raise HexsimError(f"{path} is no MDF file: it does not begin with MDF")
    signals: dict[str, Any] = {}
    try:
        with quiet(), MDF(content) as file:
            for group in range(len(file.groups)):
                for index, channel in enumerate(file.groups[group].channels):
                    if channel.name not in signals and index != file.masters_db.get(group):
                        signal = file.get(group=group, index=index)
                        if signal.samples.dtype.kind in "fiub" and signal.samples.ndim == 1 and len(signal.samples) > 2:
                            signals[channel.name] = signal
    except Exception as error:  # asammdf raises many kinds on damaged files
        raise HexsimError(f"cannot read {path} as MDF: {first_line(error)}") from None
    if not signals:
        raise HexsimError(f"{path} holds no channel of numbers")
    time = max((signal.timestamps for signal in signals.values()), key=len)
    losses: list[str] = []
    columns, units = {"time_s": np.asarray(time, dtype=float)}, {}
    for name, signal in signals.items():
        if len(signal.timestamps) != len(time) or not np.array_equal(signal.timestamps, time):
            losses.append(
                f"channel {name} has {len(signal.timestamps)} samples, the fastest {len(time)}: linear between them"
            )
        columns[name] = np.interp(time, signal.timestamps, signal.samples.astype(float))
        if signal.unit:
            units[name] = str(signal.unit)
    return RawTable(cut(columns, path, losses), losses, 1, units)


def first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]
