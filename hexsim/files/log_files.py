"""Log files: one header row, one row a sample, SI units in the names; Parquet, CSV or compressed CSV, no pickle."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import IO, cast, get_args

import polars as pl

from hexsim.errors import HexsimError
from hexsim.files.atomic import written_whole
from hexsim.files.formats import LogFormat

FORMATS: tuple[str, ...] = get_args(LogFormat)


def write_log(log: pl.DataFrame, path: Path) -> None:
    """Write a log whole or not at all; the suffix chooses the format."""
    path = Path(path)
    try:
        with written_whole(path) as temporary:
            if path.suffix == ".parquet":
                log.write_parquet(temporary, compression="zstd")
            elif path.name.endswith(".csv.gz"):
                with gzip.open(temporary, "wb", compresslevel=5) as file:
                    log.write_csv(cast(IO[bytes], file))
            elif path.suffix == ".csv":
                log.write_csv(temporary)
            else:
                raise HexsimError(f"{path.name} is no log file: its name must end in .{', .'.join(FORMATS)}")
    except pl.exceptions.PolarsError as error:
        raise HexsimError(f"cannot write {path}: {str(error).splitlines()[0]}; give another folder") from None


def read_log(path: Path) -> pl.DataFrame:
    """Read a log, or HexsimError that names the file; all columns as float64."""
    path = Path(path)
    try:
        if path.suffix == ".parquet":
            log = pl.read_parquet(path)
        elif path.suffix == ".csv" or path.name.endswith(".csv.gz"):
            log = pl.read_csv(path, infer_schema_length=None)
        else:
            raise HexsimError(f"{path} is no log: its name must end in .{', .'.join(FORMATS)}")
        return log.cast(pl.Float64)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise HexsimError(f"cannot read the log {path}: {str(error).splitlines()[0]}") from None


def find_log(folder: Path) -> Path:
    """The log of a run folder."""
    for ending in FORMATS:
        candidate = Path(folder) / f"log.{ending}"
        if candidate.is_file():
            return candidate
    raise HexsimError(f"{folder} holds no log.{', log.'.join(FORMATS)}: give the folder of a run")
