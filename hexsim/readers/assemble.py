"""From the columns of a file to the signals of a machine: names, units, missing ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.log_file import BENCH_COLUMNS, HEXAPOD_COLUMNS
from hexsim.readers.mapping import Channel, Mapping
from hexsim.readers.text import RawTable
from hexsim.readers.units import unit_of_name, unit_to_si

STEMS = {unit_of_name(name)[0]: name for name in (*BENCH_COLUMNS, *HEXAPOD_COLUMNS, "time_s")}


def assemble(raw: RawTable, mapping: Mapping, path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """(time, signals in SI, kind). Losses go to raw.losses."""
    signals: dict[str, np.ndarray] = {}
    taken: set[str] = set()
    unused: list[str] = []
    for name, channel in mapping.columns.items():
        source = channel.source or name
        if source not in raw.columns:
            raise HexsimError(
                f"{path} has no column {source!r} for {name}: it has {', '.join(sorted(raw.columns)[:40])}"
            )
        taken.add(source)
        signals[name] = raw.columns[source] * (si := channel_si(name, channel, raw, path))[0] + si[1]
    for column, values in raw.columns.items():
        if column in taken:
            continue
        name, factor, offset = recognised(column, raw)
        if name is None or name in signals:
            unused.append(column)
            continue
        signals[name] = values * factor + offset
        if (factor, offset) != (1.0, 0.0) or name != column:
            raw.losses.append(f"column {column} was read as {name} (times {factor:g})")
    if unused:
        names = ", ".join(unused[:12]) + (", ..." if len(unused) > 12 else "")
        raw.losses.append(f"not used, as no signal of the measured-log format or the mapping: {names}")
    time = signals.pop("time_s", None)
    if time is None:
        if mapping.file.rate_Hz is None:
            raise HexsimError(f"{path} has no column time_s: name it in a mapping file, or give rate_Hz under [file]")
        time = np.arange(len(next(iter(raw.columns.values())))) / mapping.file.rate_Hz
    return time, signals, kind_of(signals, mapping, raw, path)


def channel_si(name: str, channel: Channel, raw: RawTable, path: Path) -> tuple[float, float]:
    """Units of the mapping file; else those that the file itself states (MDF)."""
    source = channel.source or name
    if channel.unit is None and channel.factor is None and source in raw.units:
        factor, offset = unit_to_si(raw.units[source], f"{path} channel {source}", unit_of_name(name)[1] or None)
        return factor, offset + channel.offset
    return channel.to_si(name, str(path))


def recognised(column: str, raw: RawTable) -> tuple[str | None, float, float]:
    """A column named as in the format, perhaps in other letters or with another unit at its end: position_mm."""
    stem, unit = unit_of_name(column.strip().replace(" ", "_"))
    known = {key.lower(): name for key, name in STEMS.items()}
    name = known.get(stem.lower())
    if name is None:
        return None, 1.0, 0.0
    wanted = unit_of_name(name)[1]
    try:
        if not unit and column in raw.units:
            return name, *unit_to_si(raw.units[column], column, wanted)
        return (name, *unit_to_si(unit, column, wanted)) if unit else (None, 1.0, 0.0)
    except HexsimError:
        return None, 1.0, 0.0


def kind_of(signals: dict[str, np.ndarray], mapping: Mapping, raw: RawTable, path: Path) -> str:
    """bench or hexapod by its columns; refuses a log without positions, states missing channels."""
    kind = mapping.kind
    if kind is None:
        legs = [name for name in signals if name in HEXAPOD_COLUMNS[:24]]
        if legs and any(name in signals for name in ("position_m", "setpoint_m", "valve_V", "pressure_bottom_Pa")):
            raise HexsimError(f"{path} has columns of one leg and of six ({legs[0]}): give a log of one machine")
        kind = "hexapod" if legs else "bench"
    if kind == "own":
        if not signals:
            raise HexsimError(f"{path}: the mapping names no column besides time_s")
        return kind
    expected = HEXAPOD_COLUMNS if kind == "hexapod" else BENCH_COLUMNS
    lost = [name for name in expected if name not in signals]
    positions = [name for name in lost if name.startswith("position")]
    if positions:
        raise HexsimError(
            f"{path} has no column {positions[0]}: nothing can be traced without it; name it in a mapping file"
        )
    for name in [name for name in signals if name not in expected]:
        raw.losses.append(f"column {name} is no signal of a {kind}: left out")
        del signals[name]
    raw.losses.extend(f"column {name} is missing: what cannot be said without it stays unsaid" for name in lost)
    return kind
