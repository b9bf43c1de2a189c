"""Packets that a TOML file describes, and every protocol by its name.

    format = "binary"        # or "text", "json"
    bytes = 28               # binary: size of a packet
    byte_order = "little"    # or "big"
    starts_with = "424e4731" # binary: first bytes in hexadecimal; text: characters
    ends_with = "~"          # text
    separator = ","          # text: between its columns
    base = 10                # text: of its numbers, 10 (decimals too) or 16
    acceleration = "felt"    # or "body", "world" with the attitude's angles (below)
    [fields.time_s]
    type = "f"               # binary: one of TYPES
    offset = 0               # binary: first byte
    column = 0               # text: from 0
    key = ["data", "time"]   # json: names of tables, places in arrays from 0
    factor = 9.81            # default 1; value = (raw - zero) factor
    zero = 1.0               # raw value at rest, default 0

What the fields say is one of three:

    a vehicle      forward, left, up_m_s2 and roll, pitch, yaw_rad_s, washed out
    a pose         x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad of the platform itself, from neutral
    actuators      leg_1_m .. leg_6_m from mid stroke

With acceleration = "felt" the first three are the specific force less gravity at rest. "body": accelerations along the
vehicle's axes without gravity; "world": along north, west, up at yaw 0. The attitude R(yaw) R(pitch) R(roll), right-handed
about forward, left and up, then gives what is felt: R^T (a + g e_z) - g e_z with a in the world's axes.

The file is checked whole when it is loaded, so that no packet can meet a description that cannot be read.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from hexsim.cueing.protocols import NAMES, PROTOCOLS, Decode, RigSetpoint, VehicleMotion, checked, within
from hexsim.cueing.washout import g
from hexsim.errors import HexsimError
from hexsim.files.toml_files import read_toml, validation_sentence
from hexsim.packets import LARGEST, described

LARGEST_BYTES = 65_507  # of a UDP packet (RFC 768 over IPv4)
Type = Literal["f", "d", "b", "B", "h", "H", "i", "I", "q", "Q", "i24", "u24"]  # Python's struct, and 24 bit integers
ACCELERATIONS, ANGLES = NAMES[:3], ("roll_rad", "pitch_rad", "yaw_rad")
POSE = ("x_m", "y_m", "z_m", *ANGLES)
LEGS = tuple(f"leg_{k}_m" for k in range(1, 7))
PLACES = {"binary": ("type", "offset"), "text": ("column",), "json": ("key",)}
FIELD_NAMES = (*NAMES, *POSE, *LEGS, "time_s")


class PacketField(BaseModel):
    """A number in a packet."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    type: Type | None = None
    offset: Annotated[int, Field(ge=0, le=LARGEST_BYTES)] | None = None
    column: Annotated[int, Field(ge=0, le=LARGEST_BYTES)] | None = None
    key: Annotated[list[str | Annotated[int, Field(ge=0)]], Field(min_length=1, max_length=16)] | None = None
    factor: FiniteFloat = 1.0
    zero: FiniteFloat = 0.0


class PacketLayout(BaseModel):
    """A TOML file."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    format: Literal["binary", "text", "json"] = "binary"
    bytes: Annotated[int, Field(ge=1, le=LARGEST_BYTES)] | None = None
    byte_order: Literal["little", "big"] = "little"
    starts_with: Annotated[str, Field(max_length=64)] = ""
    ends_with: Annotated[str, Field(max_length=64)] = ""
    separator: Annotated[str, Field(min_length=1, max_length=8)] = ","
    base: Literal[10, 16] = 10
    acceleration: Literal["felt", "body", "world"] = "felt"
    fields: dict[str, PacketField]


Read = Callable[[bytes], Mapping[str, float] | str]  # raw numbers by field


class TomlProtocol:
    """Decodes packets of a layout. Raises HexsimError where the layout says what no packet can hold."""

    def __init__(self, layout: PacketLayout) -> None:
        self.layout = layout
        _check(layout)
        self._read: Read = {"binary": _Binary, "text": _Text, "json": _Json}[layout.format](layout)
        self._build = _builder(layout)

    def __call__(self, data: bytes) -> VehicleMotion | RigSetpoint | str:
        raw = self._read(data)
        if isinstance(raw, str):
            return raw
        fields = self.layout.fields
        return self._build({name: (value - fields[name].zero) * fields[name].factor for name, value in raw.items()})


def _check(layout: PacketLayout) -> None:
    """That every field has its place, and that all of them say one thing."""
    unknown = [name for name in layout.fields if name not in FIELD_NAMES]
    if unknown:
        raise HexsimError(f"[fields.{unknown[0]}] is unknown: give any of {', '.join(FIELD_NAMES)}")
    if not set(layout.fields) - {"time_s"}:
        raise HexsimError(f"[fields] is empty: give any of {', '.join(NAMES)}, time_s, or a pose, or legs")
    for name, field in layout.fields.items():
        has = {key for key in ("type", "offset", "column", "key") if getattr(field, key) is not None}
        if has != set(PLACES[layout.format]):
            raise HexsimError(
                f"[fields.{name}] has {', '.join(sorted(has)) or 'no place'}: a field of {layout.format} packets has "
                f"{' and '.join(PLACES[layout.format])}"
            )
    given = set(layout.fields)
    if given & set(LEGS) and given - {*LEGS, "time_s"}:
        raise HexsimError(
            "[fields] has legs and something else: a packet gives actuators, a pose or a vehicle's motion"
        )
    if given & set(POSE[:3]) and given & set(NAMES):
        raise HexsimError("[fields] has a pose and a vehicle's motion: give one of them")
    if layout.acceleration != "felt" and not given & set(ANGLES):
        raise HexsimError(f"acceleration = {layout.acceleration!r} needs the attitude: give {', '.join(ANGLES)}")
    if layout.acceleration == "felt" and given & set(NAMES) and given & set(ANGLES):
        raise HexsimError('[fields] has an attitude that nothing uses: say acceleration = "body" or "world"')


class _Binary:
    """Numbers at fixed places."""

    def __init__(self, layout: PacketLayout) -> None:
        if layout.bytes is None:
            raise HexsimError("bytes is missing: the size of a packet")
        self._size = layout.bytes
        self._order: Literal["little", "big"] = layout.byte_order
        try:
            self._start = bytes.fromhex(layout.starts_with)
        except ValueError:
            raise HexsimError(
                f"starts_with = {layout.starts_with!r} is no hexadecimal text of bytes, as 424e4731"
            ) from None
        self._numbers = [(name, str(field.type), int(field.offset or 0)) for name, field in layout.fields.items()]
        order = "<" if layout.byte_order == "little" else ">"
        self._forms = {kind: struct.Struct(order + kind) for _, kind, _ in self._numbers if not kind.endswith("24")}
        for name, kind, offset in self._numbers:
            end = offset + (3 if kind.endswith("24") else self._forms[kind].size)
            if end > self._size:
                raise HexsimError(
                    f"[fields.{name}] ends at byte {end}: it lies outside the packet of {self._size} bytes"
                )

    def __call__(self, data: bytes) -> dict[str, float] | str:
        if len(data) != self._size:
            return f"{len(data)} bytes (the file says {self._size})"
        if not data.startswith(self._start):
            return described(data)
        return {name: self._number(data, kind, offset) for name, kind, offset in self._numbers}

    def _number(self, data: bytes, kind: str, offset: int) -> float:
        if kind.endswith("24"):
            return int.from_bytes(data[offset : offset + 3], self._order, signed=kind == "i24")
        return self._forms[kind].unpack_from(data, offset)[0]


class _Text:
    """Numbers in the columns of a line."""

    def __init__(self, layout: PacketLayout) -> None:
        self._layout = layout
        self._columns = {name: int(field.column or 0) for name, field in layout.fields.items()}
        self._needed = max(self._columns.values()) + 1

    def __call__(self, data: bytes) -> dict[str, float] | str:
        layout = self._layout
        if not data.isascii():
            return described(data)
        text = data.decode("ascii").strip("\0\r\n\t ")
        if not (text.startswith(layout.starts_with) and text.endswith(layout.ends_with)):
            return described(data)
        text = text[len(layout.starts_with) : len(text) - len(layout.ends_with)]
        columns = text.split(layout.separator, self._needed)
        if len(columns) < self._needed:
            return f"{len(columns)} columns (the file reads {self._needed})"
        found = {name: _number_of(columns[place], layout.base) for name, place in self._columns.items()}
        missing = [name for name, value in found.items() if value is None]
        if missing:
            return f"a column that is no number, for {missing[0]}"
        return {name: value for name, value in found.items() if value is not None}


def _number_of(
    text: str,
    base: int,
    *,
    most_characters: int = 40,  # characters of a number in text
) -> float | None:
    text = text.strip()
    if not text or len(text) > most_characters or "_" in text:
        return None
    try:
        return float(text) if base == 10 else float(int(text, 16))
    except (ValueError, OverflowError):
        return None


class _Json:
    """Numbers of a JSON text, by their keys."""

    def __init__(self, layout: PacketLayout) -> None:
        self._keys = {name: list(field.key or ()) for name, field in layout.fields.items()}

    def __call__(self, data: bytes) -> dict[str, float] | str:
        try:
            table = json.loads(data)
        except (ValueError, RecursionError):  # UnicodeDecodeError is a ValueError
            return f"no JSON: {described(data)}"
        found: dict[str, float] = {}
        for name, keys in self._keys.items():
            value = _at(table, keys)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not _fits(value):
                return f"JSON without a number at {'.'.join(map(str, keys))}, for {name}"
            found[name] = float(value)
        return found


def _at(table: Any, keys: Sequence[str | int]) -> Any:
    """What stands at a path of names and places; None where there is nothing."""
    for key in keys:
        if isinstance(key, str) and isinstance(table, dict):
            table = table.get(key)
        elif isinstance(key, int) and isinstance(table, list) and key < len(table):
            table = table[key]
        else:
            return None
    return table


def _fits(value: float) -> bool:
    try:
        float(value)
    except OverflowError:  # JSON's integers have any length
        return False
    return True


Build = Callable[[Mapping[str, float]], VehicleMotion | RigSetpoint | str]


def _builder(layout: PacketLayout) -> Build:
    """What is made of the numbers of a packet."""
    given = set(layout.fields)
    if given & set(LEGS):
        return lambda numbers: _rig([numbers.get(name, 0.0) for name in LEGS], mode=1)
    if given & set(NAMES):
        return lambda numbers: _vehicle(numbers, layout.acceleration)
    return lambda numbers: _rig([numbers.get(name, 0.0) for name in POSE], mode=0)


def _rig(
    values: Sequence[float],
    mode: int,
    *,
    largest_pose: float = 10.0,  # m or rad; more is no motion platform
) -> RigSetpoint | str:
    if not within(values, largest_pose):
        return f"setpoints that are not finite, or beyond {largest_pose:g} m or rad"
    return RigSetpoint(values=tuple(float(value) for value in values), mode=mode)


def _vehicle(numbers: Mapping[str, float], acceleration: str) -> VehicleMotion | str:
    along = [numbers.get(name, 0.0) for name in NAMES]
    if acceleration != "felt":
        angles = [numbers.get(name, 0.0) for name in ANGLES]
        if not within(angles, LARGEST) or not within(along, LARGEST):
            return f"attitude, accelerations or rates that are not finite, or beyond {LARGEST:g}"
        along[:3] = felt(along[:3], angles, acceleration)
    return checked(along[:3], along[3:], numbers.get("time_s"))


def felt(acceleration: Sequence[float], angles: Sequence[float], frame: str) -> list[float]:
    """Specific force less gravity at rest (3,) [m/s2], of an acceleration without gravity in the frame "body" or "world" and
    the angles roll, pitch, yaw [rad]: R^T (a + g e_z) - g e_z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in angles)
    turn = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    own = turn.T @ np.asarray(acceleration) if frame == "world" else np.asarray(acceleration)
    return list(own + g * (turn[2] - (0.0, 0.0, 1.0)))


def protocol(name: str) -> Decode:
    """A protocol by its name, or by the path of a TOML file.

    Raises HexsimError for an unknown name or a file that does not describe packets.
    """
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if not name.endswith(".toml"):
        raise HexsimError(f"--from {name!r} is unknown: give one of {', '.join(PROTOCOLS)}, or a TOML file of packets")
    tables = read_toml(Path(name))
    try:
        return TomlProtocol(PacketLayout.model_validate(tables))
    except ValidationError as error:
        raise HexsimError(
            f"{name} describes no packets: {validation_sentence(error, PacketLayout)}; see docs/motion_computer.md"
        ) from None
    except HexsimError as error:
        raise HexsimError(f"{name}: {error}") from None
