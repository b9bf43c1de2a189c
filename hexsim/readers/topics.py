"""Messages of robots as columns: one signal a field, all on the time stamps of the fastest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.reader import MAX_CELLS, RawTable

MOST_ITEMS = 64  # of an array that become signals
DEEPEST = 6  # messages in messages


@dataclass(kw_only=True)
class Channel:
    """One signal: (n,) time stamps [s] and values."""

    name: str
    time_s: np.ndarray
    values: np.ndarray
    unit: str = ""


@dataclass(kw_only=True)
class Topics:
    """Messages by topic, collected one after the other. cells: numbers that were kept."""

    stamps_ns: dict[str, list[int]] = field(default_factory=dict)
    fields: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    cells: int = 0

    def add(self, topic: str, stamp_ns: int, message: Any) -> None:
        """A message: a mapping, or an object with `__dict__` or `__slots__`; what is no number is left out."""
        found: dict[str, float] = {}
        flatten("", message, found, 0)
        stamps, columns = self.stamps_ns.setdefault(topic, []), self.fields.setdefault(topic, {})
        for name in (*columns, *(name for name in found if name not in columns)):
            columns.setdefault(name, [np.nan] * len(stamps)).append(found.get(name, np.nan))
        stamps.append(header_stamp(message) or stamp_ns)
        self.cells += len(columns)

    def channels(self) -> list[Channel]:
        """Signals by their field where no other one has it, else with all before it: position_1_m, imu.angular_velocity.x.

        Time counts from the first message.
        """
        first = min((min(stamps) for stamps in self.stamps_ns.values()), default=0)
        time_s = {topic: 1e-9 * (np.array(stamps) - first) for topic, stamps in self.stamps_ns.items()}
        paths = [(topic, name) for topic, columns in self.fields.items() for name in columns]
        whole = {(topic, name): f"{topic.strip('/').replace('/', '.')}.{name}" for topic, name in paths}
        last = [full.rpartition(".")[2] for full in whole.values()]
        found = []
        for (topic, name), full in whole.items():
            short = full.rpartition(".")[2]
            found.append(
                Channel(
                    name=short if last.count(short) == 1 else full, time_s=time_s[topic],
                    values=np.array(self.fields[topic][name]),
                )
            )  # fmt: skip
        return found

    @property
    def is_full(self) -> bool:
        return self.cells > MAX_CELLS


def flatten(name: str, value: Any, found: dict[str, float], depth: int) -> None:
    """Numbers under `value` by their path, items of arrays from 1 on."""
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        found[name] = float(value)
    elif value is None:
        found[name] = np.nan
    elif depth >= DEEPEST or isinstance(value, (str, bytes)):
        return
    elif isinstance(value, (list, tuple, np.ndarray)):
        for i, item in enumerate(list(value)[:MOST_ITEMS]):
            flatten(f"{name}_{i + 1}", item, found, depth + 1)
    else:
        for key, inner in members(value).items():
            if not key.startswith("__") and key not in ("header", "timestamp"):
                flatten(f"{name}.{key}" if name else key, inner, found, depth + 1)


def members(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else vars(value) if hasattr(value, "__dict__") else {}


def header_stamp(message: Any) -> int:
    """Time of a message's header [ns]; 0 without one."""
    parts = members(members(members(message).get("header")).get("stamp"))
    return int(parts.get("sec", 0)) * 1_000_000_000 + int(parts.get("nanosec", parts.get("nsec", 0)))


def on_fastest(path: Path, channels: Iterable[Channel], left_out: Mapping[str, str] = MappingProxyType({})) -> RawTable:
    """All signals on the stamps of the one with most; slower ones by linear interpolation, missing outside their time.

    left_out: topics that were not read, with their kind.
    """
    found = [channel for channel in channels if len(channel.time_s) > 2]
    if not found:
        raise HexsimError(f"{path} holds no signal of numbers with three samples or more")
    time = max((channel.time_s for channel in found), key=len).astype(float)
    raw, units = RawTable(columns={"time_s": time}), {}
    raw.losses += [f"topic {topic} is {kind or 'of no kind'}: left out" for topic, kind in left_out.items()]
    for channel in found:
        stamps, values = channel.time_s.astype(float), channel.values.astype(float)
        if not np.array_equal(stamps, time):
            raw.losses.append(
                f"channel {channel.name} has {len(stamps)} samples, the fastest {len(time)}: linear between them"
            )
            ends = 1.5 * float(np.median(np.diff(stamps)))
            outside = (time < stamps[0] - ends) | (time > stamps[-1] + ends)
            values = np.interp(time, stamps, values)
            values[outside] = np.nan
            if outside.any():
                raw.losses.append(
                    f"channel {channel.name} lasts from {stamps[0]:.3f} to {stamps[-1]:.3f} s: missing before and after"
                )
        raw.columns[channel.name] = values
        if channel.unit:
            units[channel.name] = channel.unit
    raw.units = units
    return raw
