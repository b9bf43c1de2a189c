"""From the signals of a file to those of a machine: names, units, one clock each, missing ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.clock_group import ClockGroup, is_held
from hexsim.readers.mapping import Channel, Mapping
from hexsim.readers.reader import RawLog, RawSignal, listed
from hexsim.signals.log import N_LEGS, Kind
from hexsim.signals.table import measured_columns, places, table
from hexsim.signals.units import unit_of_name, unit_to_si

Array = np.ndarray
LEG_STEMS = ("setpoint", "position", "valve", "pressure_bottom")
TIME = "time_s"


@dataclass(kw_only=True, eq=False)
class Assigned:
    """A signal of the machine and where it comes from. values: (n,) in SI units."""

    name: str
    raw: RawSignal
    values: Array
    channel: Channel


def known_stems() -> dict[str, str]:
    """Name without its unit, in small letters -> column of the measured-log format."""
    columns = [name for name, (signal, _) in places().items() if signal.measured]
    return {unit_of_name(name)[0].lower(): name for name in (*columns, TIME)}


def assemble(raw: RawLog, mapping: Mapping, path: Path) -> tuple[list[ClockGroup], Kind]:
    """(signals in SI by their clock, kind). Losses go to raw.losses."""
    signals = assigned(raw, mapping, path)
    time = signals.pop(TIME, None)
    kind = kind_of(signals, mapping, raw, path)
    if not signals:
        raise HexsimError(f"{path} has no signal beside its time{raw.unread()}")
    own = [one for one in signals.values() if one.raw.stamps and one.channel.time is None]
    groups = by_stamps(raw, own, mapping.columns.get(TIME, Channel()), path)
    of_table = [one for one in signals.values() if not one.raw.stamps or one.channel.time is not None]
    groups += by_rows(raw, mapping, time, of_table, path)
    for group in groups:
        group.foreign, group.first_row = kind == "own", raw.first_row
        group.steady = {name for name in group.signals if signals[name].channel.held}
        held = (name for name in group.signals if is_held(name) and signals[name].channel.held is not False)
        group.held = {*held, *group.steady}
    return groups, kind


def assigned(raw: RawLog, mapping: Mapping, path: Path) -> dict[str, Assigned]:
    """Column of the machine -> signal of the file: those that the mapping names, then those that are named as in the format."""
    found: dict[str, Assigned] = {}
    taken: set[int] = set()
    own_clocks = bool(raw.signals) and all(signal.stamps for signal in raw.signals)
    for name, channel in mapping.columns.items():
        if name == TIME and own_clocks:  # each signal has its own
            continue
        one = raw.one(channel.source or name, name, path)
        taken.add(id(one))
        marked = np.where(np.isin(one.values, channel.missing), np.nan, one.values) if channel.missing else one.values
        marked = marked if channel.unwrap is None else unwrapped(marked, channel.unwrap)
        factor, offset = channel_si(name, channel, one, path)
        found[name] = Assigned(name=name, raw=one, values=marked * factor + offset, channel=channel)
    taken |= {id(raw.one(c.time, f"the time of {n}", path)) for n, c in mapping.columns.items() if c.time}
    stems, known, unused = known_stems(), [], []
    for signal in raw.signals:
        name, factor, offset = recognised(signal, stems)
        if id(signal) not in taken and (name is None or name in found):
            unused.append(signal.name)
        elif id(signal) not in taken:
            known.append((signal, name, factor, offset))
    for signal, name, factor, offset in known:
        others = [other.name for other, same, _, _ in known if same == name]
        if len(others) > 1:
            raise HexsimError(f"{path} has several signals for {name}: {listed(others)}; name one in a mapping file")
        found[name] = Assigned(name=name, raw=signal, values=signal.values * factor + offset, channel=Channel())
        if (factor, offset) != (1.0, 0.0) or name != signal.short:
            raw.losses.append(f"column {signal.name} was read as {name} (times {factor:g})")
    if unused:
        raw.losses.append(f"not used, as no signal of the measured-log format or the mapping: {listed(unused)}")
    raw.losses.extend(raw.left_out)
    return found


def unwrapped(values: Array, period: float) -> Array:
    """A counter that begins anew at `period`, going on; missing samples stay missing."""
    out, there = np.array(values, dtype=float), np.isfinite(values)
    out[there] = np.unwrap(out[there], period=period)
    return out


def channel_si(name: str, channel: Channel, raw: RawSignal, path: Path) -> tuple[float, float]:
    """Units of the mapping file; else those that the file itself states, or that stand in the column's name."""
    target = unit_of_name(name)[1] or None
    in_name = unit_of_name(raw.short)[1]
    stated = raw.unit or (in_name if raw.short[-1:] in "])" and raw.short != name else "")
    if channel.unit is None and channel.factor is None and stated:
        factor, offset = unit_to_si(stated, f"{path} channel {raw.name}", target)
        return factor, offset + channel.offset
    return channel.to_si(name, str(path))


def recognised(raw: RawSignal, stems: dict[str, str]) -> tuple[str | None, float, float]:
    """Of `known_stems`: a column named as in the format, perhaps in other letters or with another unit at its end: position_mm."""
    stem, unit = unit_of_name(raw.short.strip())
    name = stems.get(stem.replace(" ", "_").lower())
    unit = unit or raw.unit
    if name is None or not unit:
        return None, 1.0, 0.0
    try:
        return name, *unit_to_si(unit, raw.name, unit_of_name(name)[1])
    except HexsimError:
        return None, 1.0, 0.0


def by_stamps(raw: RawLog, signals: list[Assigned], time: Channel, path: Path) -> list[ClockGroup]:
    """Groups of signals that have stamps of their own, by the one clock that all of them know."""
    if not signals:
        return []
    common = [
        key
        for key in signals[0].raw.stamps
        if all(key in one.raw.stamps and np.isfinite(one.raw.stamps[key]).mean() > 0.5 for one in signals)
    ]
    if not common:
        raise HexsimError(f"{path}: its signals have no clock in common: map signals of one clock")
    clock, others = common[0], {key for one in signals for key in one.raw.stamps} - {common[0]}
    if others:
        raw.losses.append(f"times are those of {clock}; not used: {', '.join(sorted(others))}")
    groups: dict[int, ClockGroup] = {}
    factor, offset = time.to_si(TIME, str(path))
    for one in signals:
        stamps = one.raw.stamps[clock]
        label = f"{clock} of {one.raw.name}"
        own = ClockGroup(path=path, clock=label, time=stamps * factor + offset, tick_s=factor, signals={})
        group = groups.setdefault(id(stamps), own)
        group.signals[one.name] = np.array(one.values, dtype=float)
    return list(groups.values())


def by_rows(
    raw: RawLog, mapping: Mapping, time: Assigned | None, signals: list[Assigned], path: Path
) -> list[ClockGroup]:
    """Groups of columns of a table, by their column of time; columns whose cells stand in different rows have clocks of
    their own."""
    groups: list[ClockGroup] = []
    by_time: dict[str, list[Assigned]] = {}
    for one in signals:
        by_time.setdefault(one.channel.time or "", []).append(one)
    factor, offset = channel_si(TIME, time.channel, time.raw, path) if time else (1.0, 0.0)
    for source, columns in by_time.items():
        if source:
            clock = raw.one(source, "time", path)
            stamps, label, tick = clock.values * factor + offset, clock.name, factor
        elif time is not None:
            stamps, label, tick = time.values, TIME, factor
        elif mapping.file.rate_Hz is not None:
            stamps, label, tick = np.arange(len(columns[0].values)) / mapping.file.rate_Hz, "the row", 1.0
        else:
            raise HexsimError(
                f"{path} has no column time_s: name it in a mapping file, or give rate_Hz under [file]{raw.unread()}"
            )
        for one in [one for one in columns if len(one.values) != len(stamps)]:
            raw.losses.append(f"column {one.name} has {len(one.values)} values, its time {len(stamps)}: left out")
            columns.remove(one)
        for rows, together in clusters(columns):
            group = ClockGroup(
                path=path,
                clock=label,
                time=np.array(stamps[rows], dtype=float),
                tick_s=tick,
                signals={one.name: np.array(one.values[rows], dtype=float) for one in together},
            )
            group.rows = rows
            groups.append(group)
    return groups


def clusters(
    columns: Iterable[Assigned],
    *,
    least_share: float = 0.5,  # share of a column's samples that stand in the rows of another: both are of one clock
) -> list[tuple[Array, list[Assigned]]]:
    """(rows, columns) that have samples in the same rows: a table with empty cells may hold several clocks."""
    found: list[tuple[Array, list[Assigned]]] = []
    for one in sorted(columns, key=lambda one: -int(np.isfinite(one.values).sum())):
        there = np.isfinite(one.values)
        for k, (mask, together) in enumerate(found):
            if (mask & there).sum() >= least_share * there.sum():
                found[k] = mask | there, [*together, one]
                break
        else:
            found.append((there, [one]))
    if len(found) == 1:  # rows without any value are rows of the clock, too
        return [(np.arange(len(found[0][0])), found[0][1])]
    return [(np.flatnonzero(mask), together) for mask, together in found]


def kind_of(signals: dict[str, Assigned], mapping: Mapping, raw: RawLog, path: Path) -> Kind:
    """bench or hexapod by its columns; refuses a log without positions, states missing channels."""
    kind = mapping.kind
    if kind is None:
        legs = [name for stem in LEG_STEMS for name in table()[stem].columns(6) if name in signals]
        if legs and any(table()[stem].kind in signals for stem in LEG_STEMS):
            raise HexsimError(f"{path} has columns of one leg and of six ({legs[0]}): give a log of one machine")
        kind = "hexapod" if legs else "bench"
    if kind == "own":
        if not signals:
            raise HexsimError(f"{path}: the mapping names no column besides time_s{raw.unread()}")
        return kind
    n_legs = N_LEGS[kind]
    lost = [name for name in measured_columns(n_legs) if name not in signals]
    positions = [name for name in lost if name.startswith("position")]
    if positions:
        there = listed([signal.name for signal in raw.signals], 40)
        raise HexsimError(
            f"{path} has no column {positions[0]}: nothing can be traced without it; name it in a mapping file. It has "
            f"{there}{raw.unread()}"
        )
    known = {name for signal in table().values() if signal.measured for name in signal.columns(n_legs)}
    for name in [name for name in signals if name not in known]:
        raw.losses.append(f"column {name} is no signal of a {kind}: left out")
        del signals[name]
    raw.losses.extend(f"column {name} is missing: what cannot be said without it stays unsaid" for name in lost)
    return kind
