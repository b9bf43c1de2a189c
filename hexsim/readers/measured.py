"""A measured log from a file: columns, signals, a uniform time base, and what was repaired on the way."""

from __future__ import annotations

from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.assemble import assemble
from hexsim.readers.cleaning import Cleaning
from hexsim.readers.faulty_values import blank_bad_values
from hexsim.readers.files import log_name, raw_table
from hexsim.readers.gaps import SHORTEST_S, stretches
from hexsim.readers.mapping import Mapping, load_mapping
from hexsim.readers.time_base import clean_time, shift_delays, uniform
from hexsim.signals.log import Log

MAPPING_NAME = "mapping.toml"  # beside the logs: used for all logs of the folder


def read_stretches(path: Path | str, mapping: Path | str | Mapping | None = None) -> list[Log]:
    """All stretches of a log without a long gap, longest first. See `read_log`."""
    path = Path(path)
    beside = path.parent / MAPPING_NAME
    mapping = load_mapping(beside if mapping is None and beside.is_file() else mapping)
    raw = raw_table(path, mapping.file)
    if not raw.columns or not max(map(len, raw.columns.values())):
        raise HexsimError(f"{path} has a header and no row of data")
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
    whole = Log(
        name=log_name(path), kind=kind, time=log.time, rate=round(rate, 6), columns=log.signals, path=path,
        losses=tuple(log.losses), repaired=log.repaired,
    )  # fmt: skip
    return [used_part(whole, part) for part in parts]


def used_part(log: Log, part: slice) -> Log:
    """One stretch of a log, which says what it leaves out."""
    if part.stop - part.start == log.n:
        return log
    sentence = (
        f"used {(part.stop - part.start) / log.rate:.3f} s of {log.n / log.rate:.3f} s, from "
        f"{log.time[part.start]:.3f} s: the rest lies beyond missing values"
    )
    return log.part(part, losses=(*log.losses, sentence))


def read_log(path: Path | str, mapping: Path | str | Mapping | None = None) -> Log:
    """Read one run: the longest stretch without a long gap, in SI units, on a uniform time base, every loss stated.

    path: CSV, text, Parquet, MAT or MDF, text also as .gz. mapping: a TOML file for foreign names and units;
    default the file mapping.toml beside the log, if there is one.
    Raises HexsimError that names file, column and row. Values are not judged here: see `hexsim.tracing.checks.checks`.
    """
    return read_stretches(path, mapping)[0]
