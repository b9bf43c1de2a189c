"""From the columns of a file to the signals of a machine: names, units, missing ones."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.mapping import Channel, Mapping
from hexsim.readers.reader import RawTable
from hexsim.signals.log import N_LEGS, Kind
from hexsim.signals.table import measured_columns, places, table
from hexsim.signals.units import unit_of_name, unit_to_si

LEG_STEMS = ("setpoint", "position", "valve", "pressure_bottom")


@cache
def known_stems() -> dict[str, str]:
    """Name without its unit, in small letters -> column of the measured-log format."""
    columns = [name for name, (signal, _) in places().items() if signal.measured]
    return {unit_of_name(name)[0].lower(): name for name in (*columns, "time_s")}


def assemble(raw: RawTable, mapping: Mapping, path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], Kind]:
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
        factor, offset = channel_si(name, channel, raw, path)
        signals[name] = raw.columns[source] * factor + offset
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
    stem, unit = unit_of_name(column.strip())
    name = known_stems().get(stem.replace(" ", "_").lower())
    unit = unit or raw.units.get(column, "")
    if name is None or not unit:
        return None, 1.0, 0.0
    try:
        return name, *unit_to_si(unit, column, unit_of_name(name)[1])
    except HexsimError:
        return None, 1.0, 0.0


def kind_of(signals: dict[str, np.ndarray], mapping: Mapping, raw: RawTable, path: Path) -> Kind:
    """bench or hexapod by its columns; refuses a log without positions, states missing channels."""
    kind = mapping.kind
    if kind is None:
        legs = [name for stem in LEG_STEMS for name in table()[stem].columns(6) if name in signals]
        if legs and any(table()[stem].kind in signals for stem in LEG_STEMS):
            raise HexsimError(f"{path} has columns of one leg and of six ({legs[0]}): give a log of one machine")
        kind = "hexapod" if legs else "bench"
    if kind == "own":
        if not signals:
            raise HexsimError(f"{path}: the mapping names no column besides time_s")
        return kind
    n_legs = N_LEGS[kind]
    lost = [name for name in measured_columns(n_legs) if name not in signals]
    positions = [name for name in lost if name.startswith("position")]
    if positions:
        raise HexsimError(
            f"{path} has no column {positions[0]}: nothing can be traced without it; name it in a mapping file"
        )
    known = {name for signal in table().values() if signal.measured for name in signal.columns(n_legs)}
    for name in [name for name in signals if name not in known]:
        raw.losses.append(f"column {name} is no signal of a {kind}: left out")
        del signals[name]
    raw.losses.extend(f"column {name} is missing: what cannot be said without it stays unsaid" for name in lost)
    return kind
