"""Parquet files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawTable, Reader, first_line, max_rows


class ParquetReader(Reader):
    """Numeric columns; others are left out."""

    name = "Parquet"
    suffixes = (".parquet",)

    def read(self, path: Path, layout: FileLayout) -> RawTable:
        try:
            width = len(pl.read_parquet_schema(path))
            table = pl.read_parquet(path, n_rows=max_rows(width) + 1)
        except (OSError, pl.exceptions.PolarsError) as error:
            raise HexsimError(f"cannot read {path} as Parquet: {first_line(error)}") from None
        raw = RawTable(columns={})
        for name, column in zip(table.columns, table, strict=True):
            if not column.dtype.is_numeric():
                raw.losses.append(f"column {name} holds {column.dtype}, not numbers: left out")
                continue
            if column.null_count():
                raw.odd_cells[name] = int(column.is_null().arg_max() or 0), "an empty cell"
            raw.columns[name] = column.cast(pl.Float64).fill_null(np.nan).to_numpy().astype(float)
        return raw


READER = ParquetReader()
