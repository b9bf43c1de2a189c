"""The packets with which a host asks a machine for a compensator that starts with what was learned elsewhere.

A leg's request is a text, and goes in pieces that fit one frame of any network. Piece, host to machine, little endian, no padding
    offset  type      field
    0       4 bytes   b"HXP2"
    4       uint16    leg, from 1; 0 asks for plain control
    6       uint16    legs of the machine
    8       uint16    piece, from 0
    10      uint16    pieces of the text: its bytes over 1200, rounded up
    12      uint32    bytes m of the whole text, at most 32768
    16      uint32    CRC-32 of the whole text
    20      bytes     of the text: 1200, in the last piece the rest
Text: JSON, UTF-8: {"compensator": name, "parameters": {...}}, a leg's entry of `learned.json`

Pieces of a leg are put together in any order. One of another text (legs, size or CRC differ) begins the leg anew, so that six
texts of 32768 bytes are all that a machine keeps.

The machine takes it in off, or standing in neutral, once the pieces of all legs are there; bit 4 of its reply says that
a compensator is in the loop, bit 1 that it refuses. The host sends again what is not answered: a repetition does no harm.
Only algorithms that are built in are taken (`compensation.create_built_in`), never a path, a module or an installed package:
a packet cannot make a machine run other code. Version 1, a text in one packet, is refused.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import dataclass, field
from typing import Any

from hexsim.errors import HexsimError
from hexsim.packets import described

HEADER = struct.Struct("<4sHHHHII")
MAGIC = b"HXP2"
PIECE = 1200  # bytes of text; with the header and UDP's within the 1280 bytes that any IPv6 network takes whole
LARGEST = HEADER.size + PIECE
LONGEST = 32768  # bytes of a text: 1200 numbers of 24 digits and signs, comma and space, and some names


def is_asking(data: bytes) -> bool:
    """Whether a packet is about a compensator, of whatever version."""
    return data[:3] == MAGIC[:3]


@dataclass(frozen=True, kw_only=True)
class AskedCompensator:
    """A leg's compensator and what it starts with; leg 0: plain control."""

    leg: int
    n_legs: int
    name: str = "none"
    parameters: dict[str, Any] = field(default_factory=dict)

    def packets(self) -> list[bytes]:
        """The pieces, in their order. Raises HexsimError where the parameters are too long."""
        text = json.dumps({"compensator": self.name, "parameters": self.parameters}).encode()
        if len(text) > LONGEST:
            raise HexsimError(f"the start parameters of {self.name} take {len(text)} bytes; a machine takes {LONGEST}")
        return in_pieces(self.leg, self.n_legs, text)


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A part of a leg's text: number from 0, bytes of the whole text and their CRC-32."""

    leg: int
    n_legs: int
    number: int
    size: int
    check: int
    part: bytes


def in_pieces(leg: int, n_legs: int, text: bytes) -> list[bytes]:
    """The packets of a leg's text."""
    n, check = _pieces_of(len(text)), zlib.crc32(text)
    parts = [text[k * PIECE : (k + 1) * PIECE] for k in range(n)]
    return [HEADER.pack(MAGIC, leg, n_legs, k, n, len(text), check) + part for k, part in enumerate(parts)]


def _pieces_of(size: int) -> int:
    return -(-size // PIECE)


def unpack_piece(
    data: bytes,
    *,
    most_legs: int = 6,  # of a hexapod
) -> Piece | str:
    """The piece that a packet is, or why it is none, as text. Never raises.

    Refused: wrong magic or version, size, leg, or a number that its text does not have.
    """
    if is_asking(data) and data[:4] != MAGIC:
        return f"a request for a compensator of another version, {data[:4]!r}; this machine takes {MAGIC!r}"
    if len(data) < HEADER.size or data[:4] != MAGIC:
        return f"no request for a compensator: {described(data)}"
    _, leg, n, number, count, size, check = HEADER.unpack_from(data)
    if not 1 <= n <= most_legs or leg > n:
        return f"HXP2 for leg {leg} of {n}"
    if not 0 < size <= LONGEST or count != _pieces_of(size) or number >= count:
        return f"HXP2, piece {number} of {count}, of {size} bytes; at most {LONGEST}, {PIECE} a piece"
    expected = min(size - number * PIECE, PIECE)
    if len(data) != HEADER.size + expected:
        return f"HXP2 of {len(data)} bytes that should have {HEADER.size + expected}"
    return Piece(leg=leg, n_legs=n, number=number, size=size, check=check, part=data[HEADER.size :])


class Texts:
    """Puts pieces together, a text a leg."""

    def __init__(self) -> None:
        self._pieces: dict[int, dict[int, Piece]] = {}

    def add(self, piece: Piece) -> AskedCompensator | str | None:
        """What a leg asks for with the last of its pieces, why that is nothing, or None while pieces are missing."""
        pieces = self._pieces.setdefault(piece.leg, {})
        if any((one.n_legs, one.size, one.check) != (piece.n_legs, piece.size, piece.check) for one in pieces.values()):
            pieces.clear()
        pieces[piece.number] = piece
        count = _pieces_of(piece.size)
        if len(pieces) < count:
            return None
        del self._pieces[piece.leg]
        text = b"".join(pieces[k].part for k in range(count))
        if zlib.crc32(text) != piece.check:
            return "HXP2 whose text is not that of its CRC-32"
        return _asked(piece.leg, piece.n_legs, text)


def _asked(leg: int, n: int, text: bytes) -> AskedCompensator | str:
    """Refused: no such JSON, numbers that are not finite. Whether the name is an algorithm and the parameters are its own is for
    the machine to say."""
    try:
        body = json.loads(text, parse_constant=_not_finite, parse_float=_finite)
    except (ValueError, RecursionError):
        return "HXP2 without strict JSON of finite numbers"
    name, parameters = (body.get("compensator"), body.get("parameters")) if isinstance(body, dict) else (None, None)
    if not isinstance(name, str) or not isinstance(parameters, dict):
        return "HXP2 without compensator (a name) and parameters (a table)"
    return AskedCompensator(leg=leg, n_legs=n, name=name, parameters=parameters)


def _not_finite(text: str) -> float:
    raise ValueError(text)


def _finite(text: str) -> float:
    return value if math.isfinite(value := float(text)) else _not_finite(text)
