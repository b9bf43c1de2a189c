"""Readers of measured logs: CSV, Parquet, MAT and MDF to one clean table, with every loss stated."""

from __future__ import annotations

from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.assemble import assemble
from hexsim.readers.binary import read_mat, read_mdf, read_parquet
from hexsim.readers.cleaning import (
    SHORTEST_S,
    Cleaning,
    blank_bad_values,
    clean_time,
    shift_delays,
    stretches,
    uniform,
)
from hexsim.readers.log_file import LogFile, log_name
from hexsim.readers.mapping import Mapping, load_mapping
from hexsim.readers.text import RawTable, read_text

__all__ = ["LogFile", "Mapping", "load_mapping", "log_files", "read_log", "read_stretches"]
TEXT = (".csv", ".txt", ".exp", ".dat", ".tsv", ".asc")
MAPPING_NAME = "mapping.toml"  # beside the logs: used for all logs of the folder
ENDINGS = ".csv .csv.gz .txt .parquet .mat .mf4 .mdf"


def log_files(folder: Path, name: str) -> Path:
    """The file of log `name` in a machine's folder, or the path itself."""
    direct = Path(name)
    if direct.is_file():
        return direct
    for path in sorted(Path(folder).iterdir()) if Path(folder).is_dir() else []:
        if path.is_file() and log_name(path) == name and path.suffix != ".toml" and path.suffix != ".json":
            return path
    known = sorted(
        {log_name(p) for p in Path(folder).glob("*") if p.suffix in (".gz", ".csv", ".parquet", ".mat", ".mf4")}
    )
    raise HexsimError(
        f"no log {name!r} in {folder}: it has {', '.join(known) or 'no logs'}; give one of them or a path"
    )


def raw_table(path: Path, mapping: Mapping) -> RawTable:
    """The reader by the file's ending."""
    if not path.is_file():
        raise HexsimError(f"there is no file {path}: give a log ({ENDINGS})")
    suffix = (path.with_suffix("") if path.suffix == ".gz" else path).suffix.lower()
    if suffix == ".parquet":
        return read_parquet(path)
    if suffix == ".mat":
        return read_mat(path)
    if suffix in (".mf4", ".mdf"):
        return read_mdf(path)
    if suffix in TEXT or path.suffix == ".gz":
        return read_text(path, mapping.file)
    raise HexsimError(f"{path}: a log ends in one of {ENDINGS}")


def read_stretches(path: Path | str, mapping: Path | str | Mapping | None = None) -> list[LogFile]:
    """All stretches of a log without a long gap, longest first. See `read_log`."""
    path = Path(path)
    beside = path.parent / MAPPING_NAME
    mapping = load_mapping(beside if mapping is None and beside.is_file() else mapping)
    raw = raw_table(path, mapping)
    time, signals, kind = assemble(raw, mapping, path)
    log = Cleaning(
        path=path, first_row=raw.first_row, time=time, signals=signals, losses=raw.losses, foreign=kind == "own"
    )
    clean_time(log)
    blank_bad_values(log)
    rate = uniform(log)
    shift_delays(log, {name: channel.delay_s for name, channel in mapping.columns.items()}, rate)
    parts = stretches(log, rate)
    if not parts:
        raise HexsimError(
            f"{path} has no stretch of {SHORTEST_S:g} s without a missing value: {'; '.join(log.losses) or 'too short'}"
        )
    n = len(log.time)
    found = []
    for part in parts:
        losses = list(log.losses)
        if part.stop - part.start < n:
            losses.append(
                f"used {(part.stop - part.start) / rate:.3f} s of {n / rate:.3f} s, from {log.time[part.start]:.3f} s: "
                "the rest lies beyond missing values"
            )
        found.append(
            LogFile(
                name=log_name(path), path=path, time_s=log.time[part], rate_Hz=rate,
                columns={name: values[part] for name, values in log.signals.items()}, losses=tuple(losses), kind=kind,
            )
        )  # fmt: skip
    return found


def read_log(path: Path | str, mapping: Path | str | Mapping | None = None) -> LogFile:
    """Read one run: the longest stretch without a long gap, in SI units, on a uniform time base, every loss stated.

    path: CSV, text, Parquet, MAT (level 5) or MDF, text also as .gz. mapping: a TOML file for foreign names and units;
    default the file mapping.toml beside the log, if there is one.
    Raises HexsimError that names file, column and row. Values are not judged here: see `hexsim.tracing.checks.checks`.
    """
    return read_stretches(path, mapping)[0]
