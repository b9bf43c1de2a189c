"""MATLAB's MAT-files: vectors, structs, Simulink structures with time, tables and timetables; results of Modelica tools."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader
from hexsim.readers.sizes import check_mat, check_mat_of_hdf5, too_large

MODELICA = {"Aclass", "name", "dataInfo", "data_2"}  # variables of a result of Dymola or OpenModelica


class MatReader(Reader):
    """Vectors by their path: variables, fields of structs, columns of tables. Version 7.3, tables and timetables by mat-io.

    A struct {Time, Data} is a signal with stamps of its own, a list of structs {Name, Data} signals of those names.
    """

    name = "MAT-file"
    suffixes = (".mat",)
    needs = "matlab"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        found, there = Found(path), variables(path)
        if there.keys() >= MODELICA:
            return modelica_results(path)
        for name, value in there.items():
            if not name.startswith("__"):
                found.collect(name, value, 0)
        return found.raw()


def variables(path: Path) -> dict[str, Any]:
    """Variables of a file by name, by scipy where it can."""
    check_mat(path)
    try:
        cells = sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path))
    except NotImplementedError:  # scipy's word for the HDF5 files of version 7.3
        return by_mat_io(path, "of version 7.3", "save it again with save(..., '-v7')")
    except TypeError:  # an object without a shape
        return by_mat_io(path, "with a table or timetable", "save its columns as vectors")
    if cells > LARGEST.cells:
        raise too_large(path, f"{LARGEST.cells:,} numbers")
    return scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)


def modelica_results(path: Path) -> RawLog:
    """Variables of a result of Dymola or OpenModelica by name, on the time of the result; constants are left out.

    dataInfo says of each name in which table it stands and in which column, with its sign. "binTrans" has all of it transposed
    (Dymola User Manual, "Saving result files").
    """
    tables = scipy.io.loadmat(path, chars_as_strings=False)
    kinds = ["".join(row).strip("\0 ") for row in tables["Aclass"]]
    turned = len(kinds) > 3 and kinds[3] == "binTrans"
    names, info = (tables[key].T if turned else tables[key] for key in ("name", "dataInfo"))
    data = tables["data_2"] if turned else tables["data_2"].T
    raw = RawLog(signals=[])
    time = np.array(data[0], dtype=float)
    for letters, (table, column, *_) in zip(names, info.astype(int), strict=True):
        name, row = "".join(letters).strip("\0 "), abs(column) - 1
        if table == 2 and 0 < row < len(data):
            values = np.sign(column) * np.array(data[row], dtype=float)
            raw.signals.append(RawSignal(name=name, values=values, stamps={"time": time}))
        elif table == 1:
            raw.left_out.append(f"{name} is constant")
    if not raw.signals or len(time) < 3:
        raise HexsimError(f"{path} holds no result over time{raw.unread()}")
    return raw


def by_mat_io(path: Path, kind: str, instead: str) -> dict[str, Any]:
    """The same by mat-io, which scipy's reader is not enough for."""
    try:
        from matio import load_from_mat
    except ImportError:
        raise HexsimError(
            f"{path} is a MAT-file {kind}: pip install 'hexsim[matlab]' to read it, or {instead}"
        ) from None
    with open(path, "rb") as file:
        if b"\x89HDF" in file.read(1024):
            check_mat_of_hdf5(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # times rounded to nanoseconds, kinds of columns that are left out anyway
        return load_from_mat(str(path), add_table_attrs=True)


def fields_of(value: Any) -> dict[str, Any] | None:
    """Fields of a struct, by scipy or mat-io; None for anything else."""
    if isinstance(value, dict):
        return value
    names = getattr(value, "_fieldnames", None)
    return {name: getattr(value, name) for name in names} if names is not None else None


def is_vector(value: Any) -> bool:
    return (
        isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size > 2 and np.squeeze(value).ndim == 1
    )


class Found:
    """Signals of a MAT-file as they are found."""

    def __init__(self, path: Path) -> None:
        self.path, self.signals, self.left_out = path, {}, []
        self.signals: dict[str, RawSignal]

    def add(self, name: str, values: np.ndarray, unit: str = "", stamps: np.ndarray | None = None) -> None:
        clocks = {"Time": stamps} if stamps is not None and len(stamps) == len(values) else {}
        self.signals[name] = RawSignal(name=name, values=values.astype(float), unit=unit, stamps=clocks)

    def collect(
        self,
        name: str,
        value: Any,
        depth: int,
        stamps: np.ndarray | None = None,
        *,
        most_items: int = 200,  # of a cell array or a matrix that are looked at
        most_levels: int = 4,  # structs in structs
    ) -> None:
        """Vectors under `value`, by their path."""
        inner = fields_of(value)
        if hasattr(value, "columns") and hasattr(value, "index"):
            self.collect_table(name, value)
        elif inner is not None and depth < most_levels:
            self.collect_struct(name, inner, depth, stamps)
        elif not isinstance(value, np.ndarray):
            if isinstance(value, str) and value:
                self.left_out.append(f"{name} holds text")
        elif value.dtype == object and depth < most_levels:
            items = [(fields_of(item), item) for item in value.ravel()[:most_items]]
            names = [str(one.get("Name", one.get("name", ""))) if one is not None else "" for one, _ in items]
            named = all(names) and len(set(names)) == len(names)
            for i, (_, item) in enumerate(items):
                self.collect(f"{name}{'.' + names[i] if named else i + 1}", item, depth + 1, stamps)
        elif is_vector(value):
            self.add(name, np.squeeze(value), stamps=stamps)
        elif value.dtype.kind in "fiub" and value.size > 2 and np.squeeze(value).ndim == 2:
            flat = np.squeeze(value)
            by_time = stamps is not None and flat.shape[0] == len(stamps)
            rows = flat.T if by_time or flat.shape[0] > flat.shape[1] else flat
            for i, row in enumerate(rows[:most_items]):
                self.add(f"{name}_{i + 1}", row, stamps=stamps)
        elif value.size > 2:
            self.left_out.append(f"{name} is an array of {value.dtype}, {' x '.join(map(str, value.shape))}")

    def collect_struct(self, name: str, fields: dict[str, Any], depth: int, stamps: np.ndarray | None) -> None:
        """Fields with the struct's stamps, where it has a vector of time; a Simulink signal by its label."""
        label = fields.get("label")
        if isinstance(label, str) and label and isinstance(fields.get("values"), np.ndarray):
            name, fields = f"{name}.{label}", {"": fields["values"]}
        time = next((key for key in fields if key.lower() == "time" and is_vector(fields[key])), None)
        if time is not None:
            stamps = np.squeeze(fields[time]).astype(float)
        axis = fields_of(fields.get("X"))  # dSPACE: X is the clock of all Y
        if axis is not None and is_vector(axis.get("Data")):
            stamps = np.squeeze(axis["Data"]).astype(float)
        own = [key for key in fields if key.lower() in ("data", "values") and key != time]
        for key, inner in fields.items():
            if key != time and (key != "X" or axis is None) and key != "Name":
                whole = name if not key or (own == [key] and "Name" in fields) else f"{name}.{key}"
                self.collect(whole, inner, depth + 1, stamps)

    def collect_table(self, name: str, table: Any) -> None:
        """Columns of a table; those of a timetable with its row times, from its first row on."""
        stated = table.attrs.get("varUnits") or table.attrs.get("VariableUnits") or []
        index = table.index.to_numpy()
        stamps = None
        if index.dtype.kind in "mM" and len(index) > 2:
            stamps = (index - index[0]) / np.timedelta64(1, "s")
        for place, column in enumerate(table.columns):
            values = table[column].to_numpy()
            if values.dtype.kind in "fiub" and len(values) > 2:
                unit = str(stated[place]) if place < len(stated) and stated[place] else ""
                self.add(f"{name}.{column}", values, unit, stamps)
            else:
                self.left_out.append(f"{name}.{column} holds {values.dtype}")

    def raw(self) -> RawLog:
        """Vectors without stamps of the commonest length (weighted by it) are a table; others are left out."""
        raw = RawLog(signals=[], left_out=self.left_out)
        if not self.signals:
            raise HexsimError(
                f"{self.path} holds no vector of numbers: give variables of equal length, one a signal{raw.unread()}"
            )
        sizes = [len(signal.values) for signal in self.signals.values() if not signal.stamps]
        length = max(set(sizes), key=lambda size: (sizes.count(size), size), default=0)
        for name, signal in self.signals.items():
            if signal.stamps or len(signal.values) == length:
                raw.signals.append(signal)
            else:
                raw.left_out.append(f"{name} has {len(signal.values)} values, the others {length}: left out")
        return raw


READER = MatReader()
