"""Packets that a TOML file describes, and every protocol by its name.

    bytes = 28
    byte_order = "little"    # or "big"
    [fields.time_s]
    type = "f"               # one of TYPES
    offset = 0
    [fields.up_m_s2]
    type = "f"
    offset = 12
    factor = 9.81            # default 1; value = (raw - zero) factor
    zero = 1.0               # raw value at rest, default 0

The file is checked whole when it is loaded, so that no packet can meet a description that cannot be read.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from hexsim.cueing.protocols import NAMES, PROTOCOLS, Decode, VehicleMotion, checked
from hexsim.errors import HexsimError
from hexsim.files.toml_files import read_toml, validation_sentence

LARGEST_BYTES = 65_507  # of a UDP packet (RFC 768 over IPv4)
Type = Literal["f", "d", "b", "B", "h", "H", "i", "I", "q", "Q"]  # numbers of Python's struct, of one size everywhere


class PacketField(BaseModel):
    """A number in a packet."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    type: Type
    offset: Annotated[int, Field(ge=0, le=LARGEST_BYTES)]
    factor: FiniteFloat = 1.0
    zero: FiniteFloat = 0.0


class PacketFields(BaseModel):
    """The numbers that a packet may have."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    forward_m_s2: PacketField | None = None
    left_m_s2: PacketField | None = None
    up_m_s2: PacketField | None = None
    roll_rad_s: PacketField | None = None
    pitch_rad_s: PacketField | None = None
    yaw_rad_s: PacketField | None = None
    time_s: PacketField | None = None


class PacketLayout(BaseModel):
    """A TOML file."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    bytes: Annotated[int, Field(ge=1, le=LARGEST_BYTES)]
    byte_order: Literal["little", "big"] = "little"
    fields: PacketFields


class TomlProtocol:
    """Decodes packets of a layout. Raises HexsimError for a field outside of the packet, or where there is none."""

    def __init__(self, layout: PacketLayout) -> None:
        order, self.size = {"little": "<", "big": ">"}[layout.byte_order], layout.bytes
        self._fields: list[tuple[str, struct.Struct, PacketField]] = []
        for name, field in layout.fields:
            if field is not None:
                form = struct.Struct(order + field.type)
                if field.offset + form.size > self.size:
                    raise HexsimError(
                        f"[fields.{name}] ends at byte {field.offset + form.size}: it lies outside the packet of {self.size} bytes"
                    )
                self._fields.append((name, form, field))
        if not self._fields:
            raise HexsimError(f"[fields] is empty: give any of {', '.join(NAMES)}, time_s")

    def __call__(self, data: bytes) -> VehicleMotion | str:
        if len(data) != self.size:
            return f"{len(data)} bytes (the file says {self.size})"
        found: dict[str, Any] = {
            name: (form.unpack_from(data, field.offset)[0] - field.zero) * field.factor
            for name, form, field in self._fields
        }
        values = [found.get(name, 0.0) for name in NAMES]
        return checked(values[:3], values[3:], found.get("time_s"))


def protocol(name: str) -> Decode:
    """A protocol by its name, or by the path of a TOML file.

    Raises HexsimError for an unknown name or a file that does not describe packets.
    """
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if not name.endswith(".toml"):
        raise HexsimError(f"--from {name!r} is unknown: give one of {', '.join(PROTOCOLS)}, or a TOML file of packets")
    try:
        return TomlProtocol(PacketLayout.model_validate(read_toml(Path(name))))
    except ValidationError as error:
        raise HexsimError(
            f"{name} describes no packets: {validation_sentence(error, PacketLayout)}; see docs/motion_computer.md"
        ) from None
    except HexsimError as error:
        raise error if str(error).startswith((name, "cannot read")) else HexsimError(f"{name}: {error}") from None
