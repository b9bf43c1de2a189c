"""MATLAB's MAT-files: vectors, structs, Simulink structures with time, tables and timetables."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import MAX_CELLS, RawTable, Reader, first_line

MOST_ITEMS = 200  # of a cell array or a matrix that are looked at
DEEPEST = 4  # structs in structs


class MatReader(Reader):
    """Vectors of one length: variables, fields of structs, columns of tables. Version 7.3, tables and timetables by mat-io."""

    name = "MAT"
    suffixes = (".mat",)

    def read(self, path: Path, layout: FileLayout) -> RawTable:
        found: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        try:
            content = variables(path)
        except HexsimError:
            raise
        except Exception as error:  # scipy and mat-io raise many kinds on damaged files
            raise HexsimError(f"cannot read {path} as a MAT-file: {first_line(error)}") from None
        for name, value in content.items():
            if not name.startswith("__"):
                collect(name, value, found, units, 0)
        return same_length(path, found, units)


def variables(path: Path) -> dict[str, Any]:
    """Variables of a file by name, by scipy where it can."""
    try:
        cells = sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path))
    except NotImplementedError:  # scipy's word for the HDF5 files of version 7.3
        return by_mat_io(path, "of version 7.3", "save it again with save(..., '-v7')")
    except TypeError:  # an object without a shape
        return by_mat_io(path, "with a table or timetable", "save its columns as vectors")
    if cells > MAX_CELLS:
        raise HexsimError(f"{path} holds {cells:,} numbers, {MAX_CELLS:,} are the most: save less of it")
    return scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)


def by_mat_io(path: Path, kind: str, instead: str) -> dict[str, Any]:
    """The same by mat-io, which scipy's reader is not enough for."""
    try:
        from matio import load_from_mat
    except ImportError:
        raise HexsimError(
            f"{path} is a MAT-file {kind}: pip install 'hexsim[matlab]' to read it, or {instead}"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # times rounded to nanoseconds, kinds of columns that are left out anyway
        return load_from_mat(str(path), add_table_attrs=True)


def collect(name: str, value: Any, found: dict[str, np.ndarray], units: dict[str, str], depth: int) -> None:
    """Vectors under `value`; fields of structs by their own name (with the struct's in front when taken)."""
    if hasattr(value, "columns") and hasattr(value, "index"):
        collect_table(name, value, found, units)
    elif (hasattr(value, "_fieldnames") or isinstance(value, dict)) and depth < DEEPEST:
        fields = value if isinstance(value, dict) else {field: getattr(value, field) for field in value._fieldnames}
        label, values = fields.get("label"), fields.get("values")
        if isinstance(label, str) and label and isinstance(values, np.ndarray):  # Simulink signal
            collect(label, values, found, units, depth + 1)
            return
        for field, inner in fields.items():
            key = "time_s" if field == "time" and depth == 0 else field
            collect(key if key not in found else f"{name}.{field}", inner, found, units, depth + 1)
    elif not isinstance(value, np.ndarray):
        return
    elif value.dtype == object and depth < DEEPEST:
        for i, item in enumerate(value.ravel()[:MOST_ITEMS]):
            collect(f"{name}{i + 1}", item, found, units, depth + 1)
    elif value.dtype.kind in "fiub" and value.size > 2:
        value = np.squeeze(value)
        if value.ndim == 1:
            found[name] = value.astype(float)
        elif value.ndim == 2:
            rows = value if value.shape[0] <= value.shape[1] else value.T
            found |= {f"{name}_{i + 1}": row.astype(float) for i, row in enumerate(rows[:MOST_ITEMS])}


def collect_table(name: str, table: Any, found: dict[str, np.ndarray], units: dict[str, str]) -> None:
    """Columns of a table; row times of a timetable become time_s from its first row on."""
    stated = table.attrs.get("varUnits") or table.attrs.get("VariableUnits") or []
    for place, column in enumerate(table.columns):
        values = table[column].to_numpy()
        key = str(column) if str(column) not in found else f"{name}.{column}"
        if values.dtype.kind in "fiub" and len(values) > 2:
            found[key] = values.astype(float)
            if place < len(stated) and stated[place]:
                units[key] = str(stated[place])
    index = table.index.to_numpy()
    if index.dtype.kind in "mM" and len(index) > 2:
        found["time_s" if "time_s" not in found else f"{name}.time_s"] = (index - index[0]) / np.timedelta64(1, "s")


def same_length(path: Path, found: dict[str, np.ndarray], units: dict[str, str]) -> RawTable:
    """The vectors of the commonest length (weighted by it); others are left out with a stated loss."""
    if not found:
        raise HexsimError(f"{path} holds no vector of numbers: give variables of equal length, one a signal")
    sizes = [len(values) for values in found.values()]
    length = max(set(sizes), key=lambda size: (sizes.count(size), size))
    raw = RawTable(columns={n: v for n, v in found.items() if len(v) == length}, units=units)
    for name, values in found.items():
        if len(values) != length:
            raw.losses.append(f"{name} has {len(values)} values, the others {length}: left out")
    return raw


READER = MatReader()
