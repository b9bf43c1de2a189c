"""Vehicle motion from packets of public protocols: FlightGear, X-Plane, OutSim, BeamNG, and those that a TOML file describes.

A `Decode` gives a `VehicleMotion`, or text that says why a packet is none of its protocol; it never raises. Axes: forward,
left, up; the acceleration is the specific force less gravity at rest, so 0 stands and level.

    flightgear    FGNetFDM versions 24 and 25 (`--native-fdm`, JSBSim's output type FLIGHTGEAR), big endian
    xplane        DATA, groups 4 (g loads: normal, axial, side) and 16 (rates Q P R in rad/s), little endian
    xplane12      the same of X-Plane 12: rates P Q R in deg/s
    xplane-rref   RREF, the values of datarefs that `RREF_NAMES` asks X-Plane for
    outsim        OutSim of Live for Speed and games like it, OutSimPack and OutSimPack2: accelerations in the world's frame
    beamng        MotionSim of BeamNG.drive, version 1: accelerations without gravity in the car's frame
    jsbsim, lfs   other names of flightgear and outsim
    FILE.toml     byte_order, time and fields by struct format, offset and factor (`toml_protocol`)
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.constants import foot

from hexsim.cueing.washout import g
from hexsim.packets import LARGEST, described

FDM_BYTES = {24: 408, 25: 552}  # version: bytes
GROUP = struct.Struct("<i8f")
RREF = struct.Struct("<if")
RREF_REQUEST = struct.Struct("<5sii400s")
RREF_NAMES = (  # in the order of the indices, from 1, that are asked for
    "sim/flightmodel/forces/g_axil",
    "sim/flightmodel/forces/g_side",
    "sim/flightmodel/forces/g_nrml",
    "sim/flightmodel/position/Prad",
    "sim/flightmodel/position/Qrad",
    "sim/flightmodel/position/Rrad",
)
OUTSIM = struct.Struct("<I12f3i")
OUTSIM_MAIN = struct.Struct("<12f3i")
OUTSIM2_HEAD = struct.Struct("<4s4xI")  # LFST, id, time
OUTSIM2_SIZES = frozenset(  # bytes of inputs, drive, distance, wheels and extra, each there or not
    OUTSIM2_HEAD.size + OUTSIM_MAIN.size + sum(parts) for parts in product(*((0, n) for n in (20, 12, 8, 160, 8)))
)
MOTIONSIM = struct.Struct("<4s21f")
NAMES = ("forward_m_s2", "left_m_s2", "up_m_s2", "roll_rad_s", "pitch_rad_s", "yaw_rad_s")


@dataclass(frozen=True, kw_only=True)
class VehicleMotion:
    """time_s: of the vehicle's clock, None where the packet has none."""

    acceleration: tuple[float, float, float]
    rates: tuple[float, float, float]
    time_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class RigSetpoint:
    """What a motion software asks of a rig itself, not washed out. values: pose x y z [m] roll pitch yaw [rad] from neutral
    (mode 0), or legs 1 to 6 [m] from mid stroke (mode 1)."""

    values: tuple[float, ...]
    mode: int = 0


Decode = Callable[[bytes], VehicleMotion | RigSetpoint | str]


def within(values: Iterable[float], largest: float) -> bool:
    """Whether all are finite and below a bound."""
    return all(abs(x) < largest for x in values)  # False for NaN and infinity


def checked(acceleration: Sequence[float], rates: Sequence[float], time_s: float | None = None) -> VehicleMotion | str:
    """The motion, or why it is no vehicle's."""
    a, w = (tuple(float(x) for x in values) for values in (acceleration, rates))
    if not within((*a, *w), LARGEST):
        return f"accelerations or rates that are not finite, or beyond {LARGEST:g} m/s2 or rad/s"
    if time_s is not None and not math.isfinite(time_s):
        return "a time that is not finite"
    return VehicleMotion(acceleration=a, rates=w, time_s=time_s)  # type: ignore[arg-type]


def flightgear(
    data: bytes,
    *,
    attitude_at: int = 36,  # bytes: phi theta psi
    rates_at: int = 56,  # bytes: their rates
    pilot_at: int = 100,  # bytes: A_X, A_Y, A_Z of the pilot
) -> VehicleMotion | str:
    """FGNetFDM: pilot's accelerations [ft/s2] forward, right, down with gravity in them (down -32.2 at rest); body rates
    of the Euler rates.

    Layout: FlightGear's src/Network/net_fdm.hxx. Version 25 has 144 bytes of tanks more than 24, behind the engines; what
    is read here stands at the same place in both.
    """
    version = struct.unpack_from(">I", data)[0] if len(data) >= 4 else 0
    if not 0 < version < 100:
        return described(data)
    if version not in FDM_BYTES or len(data) != FDM_BYTES[version]:
        known = " and ".join(f"{n} of {size} bytes" for n, size in FDM_BYTES.items())
        return f"version {version}, {len(data)} bytes (known: {known})"
    angles = struct.unpack_from(">3f", data, attitude_at)
    if not within(angles, LARGEST):
        return "attitude that is not finite or too large"
    phi, theta, _ = angles
    phi_rate, theta_rate, psi_rate = struct.unpack_from(">3f", data, rates_at)
    x, y, z = (foot * value for value in struct.unpack_from(">3f", data, pilot_at))
    p = phi_rate - psi_rate * math.sin(theta)
    q = theta_rate * math.cos(phi) + psi_rate * math.cos(theta) * math.sin(phi)
    r = -theta_rate * math.sin(phi) + psi_rate * math.cos(theta) * math.cos(phi)
    return checked((x, -y, -z - g), (p, -q, -r))


def xplane(data: bytes) -> VehicleMotion | str:
    """DATA packets with groups 4 and 16: loads in g, normal 1 at rest, axial and side positive forward and right.

    Layout: X-Plane's "Exchanging Data with X-Plane"; ArduPilot's simulator interface reads signs, places and the rates of
    both versions in the same way.
    """
    groups = _xplane_groups(data)
    if isinstance(groups, str):
        return groups
    q, p, r = groups[16][:3]
    return _of_loads(groups[4][4:7], (p, q, r))


def xplane12(data: bytes) -> VehicleMotion | str:
    """As `xplane`, with the rates as version 12 sends them."""
    groups = _xplane_groups(data)
    if isinstance(groups, str):
        return groups
    return _of_loads(groups[4][4:7], [math.radians(rate) for rate in groups[16][:3]])


def _xplane_groups(data: bytes) -> dict[int, tuple[float, ...]] | str:
    if data[:4] != b"DATA" or len(data) < 5 + GROUP.size or (len(data) - 5) % GROUP.size:
        return described(data)
    groups = {one[0]: one[1:] for one in GROUP.iter_unpack(data[5:])}
    missing = [str(number) for number in (4, 16) if number not in groups]
    if missing:
        return f"DATA without group {' and '.join(missing)}: tick 4 and 16 for the network in X-Plane's data output"
    return groups


def xplane_rref(data: bytes) -> VehicleMotion | str:
    """RREF packets: pairs of index and value (int32, float32) behind five bytes, as `rref_requests` asks for them.

    Layout: X-Plane's "Exchanging Data with X-Plane". Loads in g and rates in rad/s, signs as of `xplane`.
    """
    if data[:4] != b"RREF" or len(data) < 5 + RREF.size or (len(data) - 5) % RREF.size:
        return described(data)
    found = dict(RREF.iter_unpack(data[5:]))
    missing = [name for index, name in enumerate(RREF_NAMES, 1) if index not in found]
    if missing:
        return f"RREF without {missing[0]}, index {RREF_NAMES.index(missing[0]) + 1}"
    axial, side, normal, p, q, r = (found[index] for index in range(1, len(RREF_NAMES) + 1))
    return _of_loads((normal, axial, side), (p, q, r))


def rref_requests(rate_Hz: int) -> list[bytes]:
    """Packets that ask X-Plane, on its UDP port 49000, for the datarefs of `xplane_rref`; a rate of 0 ends them."""
    return [
        RREF_REQUEST.pack(b"RREF\0", rate_Hz, index, name.encode()) for index, name in enumerate(RREF_NAMES, start=1)
    ]


def _of_loads(loads: Sequence[float], rates: Sequence[float]) -> VehicleMotion | str:
    normal, axial, side = loads
    p, q, r = rates
    return checked((g * axial, -g * side, g * (normal - 1.0)), (p, -q, -r))


def outsim(data: bytes) -> VehicleMotion | str:
    """OutSim: world axes right, forward, up at heading 0; heading, pitch and roll anticlockwise from above, right, front.

    Layouts: Live for Speed's docs/InSim.txt (OutSimPack, 64 bytes, 68 with an id) and docs/OutSimPack.txt (OutSimPack2,
    280 bytes with all of `OutSim Opts 1ff`; whatever follows the main part may be left out).
    """
    if data[:4] == b"LFST" and len(data) in OUTSIM2_SIZES:
        time_ms, main = OUTSIM2_HEAD.unpack_from(data)[1], OUTSIM_MAIN.unpack_from(data, OUTSIM2_HEAD.size)
    elif len(data) in (OUTSIM.size, OUTSIM.size + 4) and data[:4] != b"LFST":
        time_ms, *main = OUTSIM.unpack_from(data)
    elif data[:4] == b"LFST":
        return f"OutSimPack2 of {len(data)} bytes without header, id, time or main part: set OutSim Opts to 1ff"
    else:
        return f"{len(data)} bytes (OutSimPack has 64 or 68, OutSimPack2 280)"
    turning, (heading, pitch, roll), acceleration = main[0:3], main[3:6], main[6:9]
    if not within((heading, pitch, roll), LARGEST) or not within((*turning, *acceleration), LARGEST):
        return "angles, rates or accelerations that are not finite or too large"
    c, s = math.cos(heading), math.sin(heading)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(pitch), math.sin(pitch)
    nose = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = math.cos(roll), math.sin(roll)
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    body = (yaw @ nose @ lean).T
    right, forward, up = body @ np.add(acceleration, (0.0, 0.0, g))
    about_right, about_forward, about_up = body @ np.array(turning)
    return checked((forward, -right, up - g), (about_forward, -about_right, about_up), 1e-3 * time_ms)


def beamng(data: bytes) -> VehicleMotion | str:
    """MotionSim: magic BNG1; position, velocity, acceleration without gravity, up vector; roll, pitch, yaw with their rates
    and accelerations, three float32 each.

    Layout: BeamNG's documentation, "Protocols". It names no axes: the acceleration's are taken as the vehicle's own, left,
    rear, up, and the rates' as right-handed about forward, left and up.
    """
    if data[:4] != b"BNG1":
        return described(data)
    if len(data) != MOTIONSIM.size:
        return f"BNG1 of {len(data)} bytes (MotionSim has {MOTIONSIM.size})"
    numbers = MOTIONSIM.unpack(data)[1:]
    left, rear, up = numbers[6:9]
    return checked((-rear, left, up), numbers[15:18])


PROTOCOLS: dict[str, Decode] = {
    "flightgear": flightgear,
    "jsbsim": flightgear,
    "xplane": xplane,
    "xplane12": xplane12,
    "xplane-rref": xplane_rref,
    "outsim": outsim,
    "lfs": outsim,
    "beamng": beamng,
}
