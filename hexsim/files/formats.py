"""Formats of a log file, apart from what reads them, so that the command line can list them without loading it."""

from typing import Literal

LogFormat = Literal["parquet", "csv", "csv.gz"]
