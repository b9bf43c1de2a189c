"""Log files: one header row, one row a sample, SI units in the names; Parquet, CSV or compressed CSV, no pickle."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import IO, cast, get_args

import polars as pl

from hexsim.errors import HexsimError, library_errors
from hexsim.files.atomic import written_whole
from hexsim.files.formats import LogFormat

FORMATS: tuple[str, ...] = get_args(LogFormat)


def write_log(log: pl.DataFrame, path: Path) -> None:
    """Write a log whole or not at all; the suffix chooses the format."""
    path = Path(path)
    if not path.name.endswith(tuple(f".{ending}" for ending in FORMATS)):
        raise HexsimError(f"{path.name} is no log file: its name must end in .{', .'.join(FORMATS)}")
    with (
        library_errors(f"cannot write {path}, give another folder", OSError),
        written_whole(path) as temporary,  # as an open file: a library may encode its name otherwise than the locale
        gzip.open(temporary, "wb", compresslevel=5) if path.suffix == ".gz" else open(temporary, "wb") as file,
    ):
        if path.suffix == ".parquet":
            log.write_parquet(cast(IO[bytes], file), compression="zstd")
        else:
            log.write_csv(cast(IO[bytes], file))


def read_log(path: Path) -> pl.DataFrame:
    """Read a log, or HexsimError that names the file; all columns as float64."""
    path = Path(path)
    with library_errors(f"cannot read the log {path}"):
        if path.suffix == ".parquet":
            log = pl.read_parquet(path)
        elif path.suffix == ".csv" or path.name.endswith(".csv.gz"):
            log = pl.read_csv(path, infer_schema_length=None)
        else:
            raise HexsimError(f"{path} is no log: its name must end in .{', .'.join(FORMATS)}")
        return log.cast(pl.Float64)


def find_log(folder: Path) -> Path:
    """The log of a run folder."""
    for ending in FORMATS:
        candidate = Path(folder) / f"log.{ending}"
        if candidate.is_file():
            return candidate
    raise HexsimError(f"{folder} holds no log.{', log.'.join(FORMATS)}: give the folder of a run")
