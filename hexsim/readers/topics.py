"""Messages of robots as signals: one a field, named by topic and path, with the stamps of its topic."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.reader import LARGEST, RawLog, RawSignal

HEADER, RECEIVED = "header time", "time of receipt"


@dataclass(kw_only=True)
class Topics:
    """Messages by topic, collected one after the other. cells: numbers that were kept. left_out: topic -> why."""

    headers_ns: dict[str, list[float]] = field(default_factory=dict)
    received_ns: dict[str, list[int]] = field(default_factory=dict)
    fields: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    aliases: dict[str, dict[str, str]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    cells: int = 0
    cut: str = ""  # why the file was not read to its end

    def add(self, topic: str, received_ns: int, message: Any) -> None:
        """A message: a mapping, or an object with `__dict__`; what is no number is left out."""
        found: dict[str, float] = {}
        flatten("", message, found, self.aliases.setdefault(topic, {}), 0)
        received, columns = self.received_ns.setdefault(topic, []), self.fields.setdefault(topic, {})
        for name in (*columns, *(name for name in found if name not in columns)):
            columns.setdefault(name, [math.nan] * len(received)).append(found.get(name, math.nan))
        received.append(int(received_ns))
        self.headers_ns.setdefault(topic, []).append(header_stamp(message))
        self.cells += len(columns) + 2

    @property
    def is_full(self) -> bool:
        return self.cells > LARGEST.listed_cells

    def raw(self, path: Path) -> RawLog:
        """A signal for each field: imu.linear_acceleration.x. Times count from the first message, on each clock."""
        stamps: dict[str, dict[str, np.ndarray]] = {topic: {} for topic in self.fields}
        set_at = {topic: [t or math.nan for t in times] for topic, times in self.headers_ns.items()}  # 0: never set
        for clock, of_topic in ((HEADER, set_at), (RECEIVED, self.received_ns)):
            first = min((t for times in of_topic.values() for t in times if t == t), default=0)
            for topic, times in of_topic.items():
                if any(t == t for t in times):
                    stamps[topic][clock] = np.array([1e-9 * (t - first) for t in times])
        raw = RawLog(signals=[], left_out=[f"topic {topic} {why}" for topic, why in self.left_out.items()])
        for topic, columns in self.fields.items():
            head = topic.strip("/").replace("/", ".")
            for name, values in columns.items():
                other = self.aliases[topic].get(name, name)
                raw.signals.append(
                    RawSignal(
                        name=f"{head}.{name}",
                        values=np.array(values),
                        stamps=stamps[topic],
                        aliases=(other, f"{head}.{other}") if other != name else (),
                    )
                )
        if not raw.signals:
            raise HexsimError(f"{path} holds no signal of numbers{raw.unread()}")
        if self.cut:
            raw.lose_rows(self.cut)
        if self.is_full:
            raw.lose_rows(f"{path.name} holds more numbers than are kept: what comes later is left out")
        return raw


def flatten(
    name: str,
    value: Any,
    found: dict[str, float],
    aliases: dict[str, str],
    depth: int,
    *,
    most_fields: int = 1000,  # signals of a topic
    most_levels: int = 6,  # messages in messages
    most_items: int = 64,  # of an array that become signals
) -> None:
    """Numbers under `value` by their path: items of arrays from 1 on, those of a message with a list of names by name.

    aliases: path -> the path that it has by its place, as in the first message.
    """
    if len(found) >= most_fields:
        return
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        found[name] = as_float(value)
    elif value is None:
        found[name] = math.nan
    elif depth >= most_levels or isinstance(value, (str, bytes)):
        return
    elif isinstance(value, (list, tuple, np.ndarray)):
        for i, item in enumerate(value[:most_items]):
            flatten(f"{name}_{i + 1}", item, found, aliases, depth + 1)
    else:
        inner = members(value)
        names = inner.get("name")
        labels: list[str] = list(names) if is_names(names) else []
        for key, one in inner.items():
            if key.startswith("__") or key in ("header", "timestamp"):
                continue
            whole = f"{name}.{key}" if name else key
            if labels and key != "name" and isinstance(one, (list, tuple, np.ndarray)) and len(one) == len(labels):
                for i, (item, label) in enumerate(zip(one, labels[:most_items], strict=False)):
                    aliases.setdefault(f"{whole}.{label}", f"{whole}_{i + 1}")
                    flatten(f"{whole}.{label}", item, found, aliases, depth + 1)
            else:
                flatten(whole, one, found, aliases, depth + 1)


def as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:  # a whole number of JSON beyond any float
        return math.nan


def is_names(names: Any) -> TypeGuard[Sequence[str]]:
    """A list of names, each once: position[i] belongs to name[i] (sensor_msgs/JointState)."""
    if not isinstance(names, (list, tuple)) or not names:
        return False
    return all(isinstance(one, str) and one for one in names) and len(set(names)) == len(names)


def members(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else vars(value) if hasattr(value, "__dict__") else {}


def header_stamp(message: Any) -> float:
    """Time of a message's header [ns]; 0 without one."""
    parts = members(members(members(message).get("header")).get("stamp"))
    numbers = [parts.get("sec", 0), parts.get("nanosec", parts.get("nsec", 0))]
    if not all(isinstance(one, (int, float, np.number)) and abs(one) < 1e12 for one in numbers):
        return 0
    return int(numbers[0]) * 1_000_000_000 + int(numbers[1])
