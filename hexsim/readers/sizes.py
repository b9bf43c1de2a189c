"""How much a packed file unpacks to, asked before a library does it."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.reader import LARGEST

KINDS = {
    *range(1, 8),
    9,
    *range(12, 19),
}  # that there are: numbers of 1 to 8 bytes, matrix, compressed, UTF-8 to UTF-32


class Element(IntEnum):
    """Kinds of elements of a MAT-file of version 5; FLAGS: an array's first part."""

    FLAGS = 6
    MATRIX = 14
    COMPRESSED = 15


class Family(IntEnum):
    """Classes of its arrays."""

    CELL = 1
    STRUCT = 2
    OBJECT = 3
    SPARSE = 5
    FUNCTION = 16
    OPAQUE = 17


def too_large(path: Path, what: str) -> HexsimError:
    return HexsimError(f"{path} unpacks to more than {what}: save less of it")


def inflated(packed: bytes, most: int) -> bytes:
    """What zlib's bytes unpack to, one byte more than `most` where that is more."""
    return zlib.decompressobj().decompress(packed, most + 1)


def check_mat(
    path: Path,
    *,
    most_levels: int = 20,  # structs in structs
) -> None:
    """A MAT-file of version 5 by kinds and dimensions of its arrays, wherever they stand. HexsimError where they are too large, or of
    a kind that is none."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or data[125 if order == "<" else 124] == 2:  # version 4 packs nothing; 2: of version 7.3, HDF5
        return
    cells = elements = size = 0
    waiting: list[tuple[bytes, int, int, int]] = [(data, 128, len(data), 0)]
    while waiting:
        inside, start, end, depth = waiting.pop()
        for kind, at, length in tags(inside, start, end, order):
            elements += 1
            if kind not in KINDS or (
                kind == Element.MATRIX and length and not is_whole(inside, at, at + length, order)
            ):
                # scipy looks a kind up beyond the end of its table, and reads on behind an array that lacks a part
                raise HexsimError(f"cannot read {path} as MAT-file: it is damaged")
            if kind == Element.COMPRESSED:
                whole = inflated(inside[at : at + length], LARGEST.unpacked - size)
                size += len(whole)
                if size > LARGEST.unpacked:
                    raise too_large(path, f"{LARGEST.unpacked >> 20} MB")
                waiting.append((whole, 0, len(whole), depth))
            elif kind == Element.MATRIX and length:
                cells += math.prod(dimensions(inside, at, at + length, order))
                waiting.append((inside, at, at + length, depth + 1))
            if cells > LARGEST.cells or elements > LARGEST.elements or depth > most_levels:
                raise too_large(path, f"{LARGEST.cells:,} numbers or {LARGEST.elements:,} arrays")


def tags(data: bytes, start: int, end: int, order: str) -> Iterator[tuple[int, int, int]]:
    """(kind, first byte, bytes) of the elements between two places; small ones stand in their tag. Ends where they do not fit."""
    at = start
    while at + 8 <= end:
        first, length = struct.unpack_from(f"{order}II", data, at)
        if first >> 16:
            yield first & 0xFFFF, at + 4, first >> 16
            at += 8
            continue
        if at + 8 + length > end:
            return
        yield first, at + 8, length
        at += 8 + length + (0 if first == Element.COMPRESSED else -length % 8)


def is_whole(
    data: bytes,
    start: int,
    end: int,
    order: str,
    *,
    complex_flag: int = 0x800,  # a bit of an array's flags
) -> bool:
    """Has the array whose content stands there the parts that its class asks for ("MAT-File Format", MathWorks, table 1-3)?"""
    parts = list(tags(data, start, end, order))
    if [kind for kind, _, _ in parts[:1]] != [Element.FLAGS] or parts[0][2] != 8:
        return False
    [flags] = struct.unpack_from(f"{order}I", data, parts[0][1])
    family, cells = flags & 0xFF, math.prod(dimensions(data, start, end, order))
    if family in (Family.FUNCTION, Family.OPAQUE):
        return True
    if family in (Family.STRUCT, Family.OBJECT):
        head = parts[3:] if family == Family.STRUCT else parts[4:]
        if len(head) < 2 or head[0][2] != 4:
            return False
        [width] = struct.unpack_from(f"{order}i", data, head[0][1])
        needed = len(parts) - len(head) + 2 + (head[1][2] // width * cells if width > 0 else 0)
    else:
        needed = {Family.CELL: 3 + cells, Family.SPARSE: 6}.get(family, 4) + bool(flags & complex_flag)
    nested = family in (Family.CELL, Family.STRUCT, Family.OBJECT)
    return len(parts) >= needed and (nested or all(kind != Element.MATRIX for kind, _, _ in parts))


def dimensions(data: bytes, start: int, end: int, order: str) -> list[int]:
    """Of the array whose content stands there: its second element."""
    for number, (_, at, length) in enumerate(tags(data, start, end, order)):
        if number == 1:
            return [abs(n) for n in struct.unpack_from(f"{order}{min(length, 128) // 4}i", data, at)]
    return [0]


def check_mat_of_hdf5(path: Path) -> None:
    """A MAT-file of version 7.3 by the sizes of its data sets."""
    import h5py

    sizes: list[int] = []

    def add(_: str, one: object) -> bool | None:
        sizes.append(int(one.size or 0) if isinstance(one, h5py.Dataset) else 0)
        return True if len(sizes) > LARGEST.elements or sum(sizes[-1:]) > LARGEST.cells else None

    with h5py.File(path, "r") as file:
        file.visititems(add)
    if sum(sizes) > LARGEST.cells or len(sizes) > LARGEST.elements:
        raise too_large(path, f"{LARGEST.cells:,} numbers or {LARGEST.elements:,} arrays")


def check_mdf(path: Path, data: bytes) -> None:
    """Packed blocks of an MDF file of version 4."""
    size, at = 0, data.find(b"##DZ")
    while at >= 0:
        if at + 48 <= len(data):
            kind, original, packed = struct.unpack_from("<2xB5xQQ", data, at + 24)
            size += original
            if size <= LARGEST.unpacked and kind in (0, 1):
                size += (
                    max(len(inflated(data[at + 48 : at + 48 + packed], original + 1)) - original, 0) * LARGEST.unpacked
                )
            if size > LARGEST.unpacked:
                raise too_large(path, f"{LARGEST.unpacked >> 20} MB")
        at = data.find(b"##DZ", at + 4)
