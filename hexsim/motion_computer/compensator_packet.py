"""The packet with which a host asks a machine for a compensator that starts with what was learned elsewhere.

Packet, host to machine, one for each leg, little endian, no padding
    offset  type      field
    0       4 bytes   b"HXP1"
    4       uint16    leg, from 1; 0 asks for plain control
    6       uint16    legs of the machine
    8       uint32    0
    12      uint32    bytes m that follow, at most 8192
    16      m bytes   JSON, UTF-8: {"compensator": name, "parameters": {...}}, a leg's entry of `learned.json`

The machine takes it in off, or standing in neutral, once the packets of all legs are there; bit 4 of its reply says that
a compensator is in the loop, bit 1 that it refuses. The host sends again what is not answered: a repetition does no harm.
Only algorithms that are built in are taken (`compensation.create_built_in`), never a path, a module or an installed package:
a packet cannot make a machine run other code.
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass, field
from typing import Any

from hexsim.errors import HexsimError
from hexsim.packets import described

HEADER = struct.Struct("<4sHHII")
MAGIC = b"HXP1"
LARGEST = HEADER.size + 8192
MOST_LEGS = 6


@dataclass(frozen=True, kw_only=True)
class AskedCompensator:
    """A leg's compensator and what it starts with; leg 0: plain control."""

    leg: int
    n_legs: int
    name: str = "none"
    parameters: dict[str, Any] = field(default_factory=dict)

    def pack(self) -> bytes:
        body = json.dumps({"compensator": self.name, "parameters": self.parameters}).encode()
        if HEADER.size + len(body) > LARGEST:
            raise HexsimError(
                f"the start parameters of {self.name} take {len(body)} bytes; a packet holds {LARGEST - HEADER.size}"
            )
        return HEADER.pack(MAGIC, self.leg, self.n_legs, 0, len(body)) + body


def unpack_asked(data: bytes) -> AskedCompensator | str:
    """What a packet asks for, or why it asks for nothing, as text. Never raises.

    Refused: wrong magic, size or leg, no such JSON, numbers that are not finite. Whether the name is an algorithm and the
    parameters are its own is for the machine to say.
    """
    if len(data) < HEADER.size or data[:4] != MAGIC:
        return f"no request for a compensator: {described(data)}"
    _, leg, n, reserved, size = HEADER.unpack_from(data)
    if len(data) != HEADER.size + size or len(data) > LARGEST:
        return f"HXP1 of {len(data)} bytes that says it has {HEADER.size + size}, at most {LARGEST}"
    if reserved or not 1 <= n <= MOST_LEGS or leg > n:
        return f"HXP1 for leg {leg} of {n}"
    try:
        body = json.loads(data[HEADER.size :], parse_constant=_not_finite, parse_float=_finite)
    except (ValueError, RecursionError):
        return "HXP1 without strict JSON of finite numbers"
    name, parameters = (body.get("compensator"), body.get("parameters")) if isinstance(body, dict) else (None, None)
    if not isinstance(name, str) or not isinstance(parameters, dict):
        return "HXP1 without compensator (a name) and parameters (a table)"
    return AskedCompensator(leg=leg, n_legs=n, name=name, parameters=parameters)


def _not_finite(text: str) -> float:
    raise ValueError(text)


def _finite(text: str) -> float:
    return value if math.isfinite(value := float(text)) else _not_finite(text)
