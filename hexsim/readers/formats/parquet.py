"""Parquet tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawLog, RawSignal, Reader, max_rows


class ParquetReader(Reader):
    """Numeric columns and time stamps (seconds from the first row); others are left out."""

    name = "Parquet"
    suffixes = (".parquet",)

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        schema = pl.read_parquet_schema(path)
        used = [name for name, kind in schema.items() if kind.is_numeric() or kind.is_temporal() or kind == pl.Boolean]
        raw = RawLog(signals=[])
        raw.left_out = [f"column {name} holds {kind}, not numbers" for name, kind in schema.items() if name not in used]
        if not used:
            raise HexsimError(f"{path} has no column of numbers{raw.unread()}")
        table = pl.read_parquet(path, n_rows=max_rows(len(used)) + 1, columns=used)
        for name, column in zip(table.columns, table, strict=True):
            odd = (int(column.is_null().arg_max() or 0), "an empty cell") if column.null_count() else None
            unit = "s" if column.dtype.is_temporal() else ""
            values = seconds(column) if unit else column.cast(pl.Float64).fill_null(np.nan).to_numpy().astype(float)
            raw.signals.append(RawSignal(name=name, values=values, unit=unit, odd=odd))
        return raw


def seconds(column: pl.Series) -> np.ndarray:
    """Time stamps, durations or times of day (n,) as seconds: stamps from the first one on, NaN where there is none."""
    if column.dtype == pl.Time:
        whole = column.cast(pl.Int64).cast(pl.Duration("ns"))
    elif column.dtype.base_type() == pl.Duration:
        whole = column
    else:
        column = column.cast(pl.Datetime("ns")) if column.dtype == pl.Date else column
        first = column.drop_nulls()
        whole = column - first[0] if len(first) else column.cast(pl.Int64).cast(pl.Duration("ns"))
    return 1e-9 * whole.dt.total_nanoseconds().cast(pl.Float64).fill_null(np.nan).to_numpy().astype(float)


READER = ParquetReader()
