"""numpy's own files, .npy and .npz; never pickled objects."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.clock_columns import seconds_of, time_columns
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader


class NumpyReader(Reader):
    """Arrays by name, columns of matrices and of structured arrays. In an .npz of arrays of several lengths the array of
    time of a length is the clock of the others of that length; else it is one table."""

    name = "numpy file"
    suffixes = (".npy", ".npz")

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        raw = RawLog(signals=[])
        found: dict[str, np.ndarray] = {}
        cells = 0
        for name, file, size in members(path):
            shape, _, kind = header(file, name, path)
            cells += math.prod(shape) * max(len(kind.names or ()), 1)
            if cells > LARGEST.cells:
                raise HexsimError(f"{path} holds {cells:,} numbers, {LARGEST.cells:,} are the most: save less of it")
            if kind.hasobject or math.prod(shape) < 3 or not (kind.names or kind.kind in "fiubMm"):
                raw.left_out.append(f"array {name} holds {'objects' if kind.hasobject else kind}, not numbers")
                continue
            need = math.prod(shape) * kind.itemsize
            if need > size:
                raise HexsimError(f"{path}: array {name} ends early: {size} of {need} bytes; copy it again")
            file.seek(0)
            found |= columns(name, np.load(file, allow_pickle=False), raw)
        clocks = time_columns(found) if len({len(values) for values in found.values()}) > 1 else {}
        for name, values in found.items():
            clock = clocks.get(len(values))
            stamps = {"time": clock[1]} if clock and clock[0] != name else {}
            unit = "s" if values.dtype.kind in "Mm" else ""
            numbers = seconds_of(values) if unit else values.astype(float)
            raw.signals.append(RawSignal(name=name, values=numbers, unit=unit, stamps=stamps))
        if not raw.signals:
            raise HexsimError(f"{path} holds no array of numbers{raw.unread()}")
        return raw


def members(path: Path) -> Iterator[tuple[str, IO[bytes], int]]:
    """(name, file, bytes unpacked) of each array."""
    if path.suffix.lower() == ".npy":
        with open(path, "rb") as file:
            yield path.stem, file, path.stat().st_size
        return
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.filename.endswith(".npy"):
                with archive.open(info) as file:
                    yield info.filename[:-4], file, info.file_size


def header(file: IO[bytes], name: str, path: Path) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type of an array, before any of it is read."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(file)
    raise HexsimError(f"{path}: array {name} is of version {version[0]}.{version[1]} of the format: save it again")


def columns(name: str, values: np.ndarray, raw: RawLog) -> dict[str, np.ndarray]:
    """Vectors of an array."""
    if values.dtype.names:
        flat = values.ravel()
        numbers = [
            key for key in values.dtype.names if values.dtype[key].kind in "fiubMm" and not values.dtype[key].shape
        ]
        return {f"{name}.{key}": flat[key] for key in numbers}
    flat = np.squeeze(values)
    if flat.ndim == 1:
        return {name: flat}
    if flat.ndim == 2:
        rows = flat.T if flat.shape[0] >= flat.shape[1] else flat
        return {f"{name}_{k + 1}": row for k, row in enumerate(rows[: LARGEST.columns])}
    raw.left_out.append(f"array {name} has {flat.ndim} dimensions")
    return {}


READER = NumpyReader()
