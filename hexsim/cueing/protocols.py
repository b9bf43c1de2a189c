"""Vehicle motion from packets of public protocols: FlightGear, X-Plane, OutSim, and packets that a TOML file describes.

Each `decode` gives a `VehicleMotion`, or None for what is no packet of its protocol. Axes: forward, left, up; the
acceleration is the specific force less gravity at rest, so 0 stands and level.

    flightgear   FGNetFDM version 24 (`--native-fdm`, JSBSim's output type FLIGHTGEAR), big endian
    xplane       DATA, groups 4 (g loads: normal, axial, side) and 16 (rates Q P R in rad/s), little endian
    xplane12     the same of X-Plane 12: rates P Q R in deg/s
    outsim       OutSim of Live for Speed and games like it: 64 or 68 bytes, accelerations in the world's frame
    FILE.toml    byte_order, time and fields by struct format, offset and factor (`GenericProtocol`)
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.cueing.washout import g
from hexsim.errors import HexsimError
from hexsim.files.toml_files import parse_toml

FEET_m = 0.3048
FDM_VERSION, FDM_BYTES = 24, 408
FDM_ATTITUDE, FDM_RATES, FDM_PILOT = 36, 56, 100  # bytes: phi theta psi; their rates; A_X, A_Y, A_Z of the pilot
OUTSIM = struct.Struct("<I12f3i")
GROUP = struct.Struct("<i8f")
NAMES = ("forward_m_s2", "left_m_s2", "up_m_s2", "roll_rad_s", "pitch_rad_s", "yaw_rad_s")
LARGEST = 1000.0  # m/s2 or rad/s; more is no vehicle


@dataclass(frozen=True, kw_only=True)
class VehicleMotion:
    """time_s: of the vehicle's clock, None where the packet has none."""

    acceleration: tuple[float, float, float]
    rates: tuple[float, float, float]
    time_s: float | None = None


Decode = Callable[[bytes], VehicleMotion | None]


def _checked(acceleration: Any, rates: Any, time_s: float | None = None) -> VehicleMotion | None:
    """None where a number is not finite or no vehicle's."""
    a, w = (tuple(float(x) for x in values) for values in (acceleration, rates))
    if not all(math.isfinite(x) and abs(x) < LARGEST for x in (*a, *w)):
        return None
    return VehicleMotion(acceleration=a, rates=w, time_s=time_s)  # type: ignore[arg-type]


def flightgear(data: bytes) -> VehicleMotion | None:
    """FGNetFDM: pilot's accelerations [ft/s2] forward, right, down with gravity in them (down -32.2 at rest); body rates
    of the Euler rates."""
    if len(data) != FDM_BYTES or struct.unpack_from(">I", data)[0] != FDM_VERSION:
        return None
    phi, theta, _ = struct.unpack_from(">3f", data, FDM_ATTITUDE)
    phi_rate, theta_rate, psi_rate = struct.unpack_from(">3f", data, FDM_RATES)
    x, y, z = (FEET_m * value for value in struct.unpack_from(">3f", data, FDM_PILOT))
    p = phi_rate - psi_rate * math.sin(theta)
    q = theta_rate * math.cos(phi) + psi_rate * math.cos(theta) * math.sin(phi)
    r = -theta_rate * math.sin(phi) + psi_rate * math.cos(theta) * math.cos(phi)
    return _checked((x, -y, -z - g), (p, -q, -r))


def xplane(data: bytes) -> VehicleMotion | None:
    """DATA packets with groups 4 and 16: loads in g, normal 1 at rest, axial and side positive forward and right.

    ArduPilot's simulator interface reads signs, places and the rates of both versions in the same way.
    """
    groups = _xplane_groups(data)
    if groups is None:
        return None
    q, p, r = groups[16][:3]
    return _of_loads(groups[4], (p, q, r))


def xplane12(data: bytes) -> VehicleMotion | None:
    """As `xplane`, with the rates as version 12 sends them."""
    groups = _xplane_groups(data)
    return None if groups is None else _of_loads(groups[4], [math.radians(rate) for rate in groups[16][:3]])


def _xplane_groups(data: bytes) -> dict[int, tuple[float, ...]] | None:
    if data[:4] != b"DATA" or len(data) < 5 + 2 * GROUP.size or (len(data) - 5) % GROUP.size:
        return None
    groups = {one[0]: one[1:] for one in GROUP.iter_unpack(data[5:])}
    return groups if 4 in groups and 16 in groups else None


def _of_loads(loads: Sequence[float], rates: Sequence[float]) -> VehicleMotion | None:
    normal, axial, side = loads[4:7]
    p, q, r = rates
    return _checked((g * axial, -g * side, g * (normal - 1.0)), (p, -q, -r))


def outsim(data: bytes) -> VehicleMotion | None:
    """OutSim: world axes right, forward, up at heading 0; heading, pitch and roll anticlockwise from above, right, front."""
    if len(data) not in (OUTSIM.size, OUTSIM.size + 4):
        return None
    time_ms, *values = OUTSIM.unpack_from(data)
    turning, (heading, pitch, roll), acceleration = values[0:3], values[3:6], values[6:9]
    if not all(math.isfinite(x) for x in values[:9]):
        return None
    c, s = math.cos(heading), math.sin(heading)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(pitch), math.sin(pitch)
    nose = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = math.cos(roll), math.sin(roll)
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    body = (yaw @ nose @ lean).T
    right, forward, up = body @ np.add(acceleration, (0.0, 0.0, g))
    about_right, about_forward, about_up = body @ np.array(turning)
    return _checked((forward, -right, up - g), (about_forward, -about_right, about_up), 1e-3 * time_ms)


@dataclass(frozen=True, kw_only=True)
class GenericProtocol:
    """bytes: of a packet. fields: name of NAMES or time_s -> (struct format, offset, factor, zero): (raw - zero) factor."""

    size: int
    fields: dict[str, tuple[struct.Struct, int, float, float]]

    def __call__(self, data: bytes) -> VehicleMotion | None:
        if len(data) != self.size:
            return None
        found = dict.fromkeys(NAMES, 0.0) | {
            name: (form.unpack_from(data, offset)[0] - zero) * factor
            for name, (form, offset, factor, zero) in self.fields.items()
        }
        values = [found[name] for name in NAMES]
        time_s = found.get("time_s")
        if time_s is not None and not math.isfinite(time_s):
            return None
        return _checked(values[:3], values[3:], time_s)


PROTOCOLS: dict[str, Decode] = {"flightgear": flightgear, "xplane": xplane, "xplane12": xplane12, "outsim": outsim}


def protocol(name: str) -> Decode:
    """A protocol by its name, or by a TOML file:

        bytes = 28
        byte_order = "little"
        [fields.time_s]
        type = "f"           # of Python's struct: f d i I h H
        offset = 0
        [fields.up_m_s2]
        type = "f"
        offset = 12
        factor = 9.81        # default 1
        zero = 1.0           # raw value at rest, default 0

    Raises HexsimError for an unknown name or a file that does not describe packets.
    """
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if not name.endswith(".toml"):
        raise HexsimError(f"--from {name!r} is unknown: give one of {', '.join(PROTOCOLS)}, or a TOML file of packets")
    try:
        tables = parse_toml(Path(name).read_text(encoding="utf-8"))
        order = {"little": "<", "big": ">"}[tables.get("byte_order", "little")]
        fields = {
            key: (struct.Struct(order + one["type"]), int(one["offset"]), float(one.get("factor", 1.0)), float(one.get("zero", 0.0)))
            for key, one in tables["fields"].items()
        }  # fmt: skip
        size = int(tables["bytes"])
        inside = all(at >= 0 and at + form.size <= size for form, at, _, _ in fields.values())
    except (OSError, KeyError, TypeError, ValueError, struct.error) as error:
        raise HexsimError(
            f"{name} describes no packets ({type(error).__name__}: {error}): see docs/motion_computer.md"
        ) from None
    unknown = sorted(set(fields) - {*NAMES, "time_s"})
    if unknown or not inside or not fields:
        what = f"unknown field {unknown[0]}" if unknown else "a field lies outside the packet, or there is none"
        raise HexsimError(f"{name}: {what}; give any of {', '.join(NAMES)}, time_s, within `bytes`")
    return GenericProtocol(size=size, fields=fields)
