"""HDF5 files: data sets in groups, columns of compound tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.clock_columns import time_columns
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader

UNITS = ("units", "unit", "Unit", "Units", "UNITS")  # attributes that state one


class Hdf5Reader(Reader):
    """Data sets of numbers by their path, with dots. A column of time in a group (`time`, `t_ms`, ...) is the clock of the
    others there that are as long; a file of one table is a table."""

    name = "HDF5"
    suffixes = (".h5", ".hdf5", ".hdf")
    needs = "hdf5"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        import h5py

        raw = RawLog(signals=[])
        groups: dict[str, dict[str, np.ndarray]] = {}
        units: dict[str, str] = {}
        with h5py.File(path, "r") as file:
            sets: list[Any] = []
            file.visititems(lambda _, item: sets.append(item) if isinstance(item, h5py.Dataset) else None)
            cells = sum(item.size or 0 for item in sets if item.ndim)
            if cells > LARGEST.cells:
                raise HexsimError(f"{path} holds {cells:,} numbers, {LARGEST.cells:,} are the most: save less of it")
            for item in sets:
                head, _, name = item.name.strip("/").replace("/", ".").rpartition(".")
                if item.external or item.is_virtual:
                    raw.left_out.append(f"data set {item.name} stands in another file")
                    continue
                unit = next((text(item.attrs[key]) for key in UNITS if key in item.attrs), "")
                for column, values in columns(item, name, raw):
                    groups.setdefault(head, {})[column] = values
                    units[f"{head}.{column}"] = unit
        lengths = {len(values) for group in groups.values() for values in group.values()}
        for head, group in groups.items():
            own = {name: units[f"{head}.{name}"] for name in group}
            clocks = time_columns(group, own) if len(groups) > 1 or len(lengths) > 1 else {}
            for name, values in group.items():
                clock = clocks.get(len(values))
                stamps = {"time": clock[1]} if clock and clock[0] != name else {}
                whole = f"{head}.{name}" if head else name
                raw.signals.append(RawSignal(name=whole, values=values.astype(float), unit=own[name], stamps=stamps))
        if not raw.signals:
            raise HexsimError(f"{path} holds no data set of numbers{raw.unread()}")
        return raw


def columns(item: Any, name: str, raw: RawLog) -> list[tuple[str, np.ndarray]]:
    """Vectors of a data set: itself, the columns of a matrix (its longer side is time), the fields of a compound one."""
    kind = item.dtype
    if kind.fields and item.ndim == 1:
        numbers = [field for field in kind.names if kind[field].kind in "fiub" and not kind[field].shape]
        raw.left_out += [f"{item.name}.{field} is no column of numbers" for field in kind.names if field not in numbers]
        table = item[:]
        return [(f"{name}.{field}", table[field]) for field in numbers]
    if kind.kind not in "fiub" or item.ndim not in (1, 2) or (item.size or 0) < 3:
        if item.ndim:
            raw.left_out.append(f"data set {item.name} is an array of {kind}, {' x '.join(map(str, item.shape))}")
        return []
    values = item[:]
    if item.ndim == 1:
        return [(name, values)]
    rows = values.T if values.shape[0] >= values.shape[1] else values
    return [(name if len(rows) == 1 else f"{name}_{k + 1}", row) for k, row in enumerate(rows[: LARGEST.columns])]


def text(value: Any) -> str:
    """An attribute as text."""
    value = value[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return (
        value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value) if isinstance(value, str) else ""
    )


READER = Hdf5Reader()
