"""The telemetry of a machine, which it sends to its host: what its sensors read, at the log rate.

Packet, machine to host, little endian, no padding
    offset  type      field
    0       4 bytes   b"HXT1"
    4       uint16    legs n, 1 to 6
    6       uint16    rows m, 1 to 4
    8       uint32    sequence, one more at each telemetry packet, wraps
    12      uint32    0
    16      float64   machine time of the first row [s]
    24      float64   rows a second [Hz]
    32      m rows of 5 n + 7 float64; not-a-number where the machine has no such sensor:
            n piston setpoints [m], n piston positions [m], n bottom pressures [Pa], n rod-side pressures [Pa],
            n valve voltages [V], supply pressure [Pa], acceleration x y z [m/s2], angular acceleration x y z [rad/s2]
            (of a bench x is the acceleration along the leg, and the others are not there)

A row is taken before the valves' voltages of its time act. A lost packet shows in the sequence; it is not sent again.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.mechanics.kinematics import N_LEGS
from hexsim.motion_computer.host_packet import LATEST_S
from hexsim.packets import described

HEADER = struct.Struct("<4sHHIIdd")
MAGIC = b"HXT1"
MOST_ROWS = 4  # of a packet: 1,216 bytes, below what any IPv6 network takes whole
LARGEST_PACKET = HEADER.size + MOST_ROWS * (5 * N_LEGS + 7) * 8
Array = NDArray[np.float64]


def width(n_legs: int) -> int:
    """Numbers in a row."""
    return 5 * n_legs + 7


@dataclass(frozen=True, kw_only=True, eq=False)
class Telemetry:
    """Rows (m, 5 n + 7) from machine time `time_s` on, `rate_Hz` a second."""

    n_legs: int
    sequence: int
    time_s: float
    rate_Hz: float
    rows: Array

    def pack(self) -> bytes:
        m, n = len(self.rows), self.n_legs
        if not 1 <= m <= MOST_ROWS or self.rows.shape[1] != width(n):
            raise HexsimError(f"telemetry of shape {self.rows.shape}; give 1 to {MOST_ROWS} rows of {width(n)} numbers")
        head = HEADER.pack(MAGIC, n, m, self.sequence % 2**32, 0, self.time_s, self.rate_Hz)
        return head + np.ascontiguousarray(self.rows, dtype="<f8").tobytes()


def unpack_telemetry(
    data: bytes,
    *,
    fastest_Hz: float = 1e5,  # of rows: a packet of four every 40 us, more than a network brings
) -> Telemetry | str:
    """The telemetry, or why it is none, as text: size, magic, counts, a time or rate that cannot be, readings that no
    sensor gives. Never raises. Whether the readings are a machine's is for the host to judge.
    """
    if data[:3] == MAGIC[:3] and data[:4] != MAGIC:
        return f"telemetry of another version, {data[:4]!r}; this host speaks {MAGIC!r}"
    if len(data) < HEADER.size or data[:4] != MAGIC:
        return f"no telemetry: {described(data)}"
    _, n, m, sequence, reserved, time_s, rate_Hz = HEADER.unpack_from(data)
    if not (1 <= n <= N_LEGS and 1 <= m <= MOST_ROWS) or reserved != 0:
        return f"telemetry of {n} legs in {m} rows"
    if len(data) != HEADER.size + 8 * m * width(n):
        return f"telemetry of {n} legs in {m} rows with {len(data)} bytes (it has {HEADER.size + 8 * m * width(n)})"
    if not (abs(time_s) <= LATEST_S and 0.0 < rate_Hz <= fastest_Hz):
        return "telemetry with a time or rate that is not finite or cannot be"
    rows = np.frombuffer(data, dtype="<f8", offset=HEADER.size).reshape(m, width(n)).astype(float)
    largest = 1e10  # SI; a hundred times the pressure of the strongest hydraulics, and far beyond any other reading
    if np.any(np.abs(rows) > largest):  # not-a-number stands for a sensor that is not there
        return f"telemetry with readings beyond {largest:g}"
    return Telemetry(n_legs=n, sequence=sequence, time_s=time_s, rate_Hz=rate_Hz, rows=rows)
