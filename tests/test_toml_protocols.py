"""Packets that a TOML file describes: attitude with accelerations, poses, actuators, text, JSON, 24 bit."""

import contextlib
import json
import math
import socket
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hexsim import HexsimError
from hexsim.cueing import protocols, toml_protocol
from hexsim.machine import load_machine
from hexsim.motion_computer import states
from hexsim.simulation import serve, vehicle_link

G = 9.81
SHIPPED = Path(__file__).parents[1] / "examples" / "protocols"


@pytest.fixture
def made(tmp_path):
    """A protocol of a TOML text."""

    def make(text: str):
        path = tmp_path / "packets.toml"
        path.write_text(text)
        return toml_protocol.protocol(str(path))

    return make


def fields(places: dict[str, str]) -> str:
    return "".join(f"[fields.{name}]\n{place}\n" for name, place in places.items())


@pytest.mark.parametrize("angles", [(0.3, 0.0, 0.0), (0.0, -0.4, 0.0), (0.2, 0.3, 2.5), (-1.0, 0.7, -3.0)])
def test_what_is_felt_is_the_specific_force_in_the_vehicles_axes(angles):
    """Against scipy's rotations (yaw, pitch, roll about z, y, x in turn): R^T (a + g e_z) - g e_z, whichever frame the
    acceleration is given in."""
    turn = Rotation.from_euler("ZYX", angles[::-1])
    world, gravity = np.array([1.0, -2.0, 3.0]), np.array([0.0, 0.0, G])
    expected = turn.inv().apply(world + gravity) - gravity
    assert toml_protocol.felt(world, angles, "world") == pytest.approx(expected, abs=1e-12)
    assert toml_protocol.felt(turn.inv().apply(world), angles, "body") == pytest.approx(expected, abs=1e-12)


def test_attitude_with_inertial_acceleration_in_a_packet(made):
    """Standing with the left side up by 30 deg: g/2 towards the right; level and thrown up by 2 m/s2: 2 up. East and degrees
    come in by factors."""
    packets = made(
        'bytes = 24\nacceleration = "world"\n'
        + fields(
            {
                "forward_m_s2": 'type = "f"\noffset = 0',
                "left_m_s2": 'type = "f"\noffset = 4\nfactor = -1.0',
                "up_m_s2": 'type = "f"\noffset = 8',
                "roll_rad": 'type = "f"\noffset = 12\nfactor = 0.017453292519943295',
                "pitch_rad": 'type = "f"\noffset = 16',
                "yaw_rad": 'type = "f"\noffset = 20',
            }
        )
    )
    rolled = packets(struct.pack("<6f", 0, 0, 0, 30.0, 0, 0))
    assert rolled.acceleration == pytest.approx((0.0, G / 2.0, G * (math.cos(math.pi / 6) - 1.0)), abs=1e-5)
    assert packets(struct.pack("<6f", 0, 0, 2, 0, 0, 0)).acceleration == pytest.approx((0.0, 0.0, 2.0), abs=1e-5)
    assert packets(struct.pack("<6f", 0, 5, 0, 0, 0, 0)).acceleration == pytest.approx((0.0, -5.0, 0.0), abs=1e-5)
    assert packets(struct.pack("<6f", 0, 0, 0, math.nan, 0, 0)).startswith(
        "attitude, accelerations or rates that are not"
    )


@pytest.mark.parametrize(("order", "signed"), [("little", False), ("big", False), ("little", True), ("big", True)])
def test_24_bit_integers(made, order, signed):
    """Three bytes of either order and sign; six legs of a rig in 24 bit unsigned about the middle."""
    kind, low = ("i24", -(2**23)) if signed else ("u24", 0)
    packets = made(
        f'bytes = 18\nbyte_order = "{order}"\n'
        + fields({f"leg_{k + 1}_m": f'type = "{kind}"\noffset = {3 * k}\nfactor = 1e-8' for k in range(6)})
    )
    raw = [low, -1 if signed else 1, 2**23 - 1, 100, 65_536, low]
    data = b"".join(value.to_bytes(3, order, signed=signed) for value in raw)
    assert packets(data) == protocols.RigSetpoint(values=tuple(pytest.approx(1e-8 * value) for value in raw), mode=1)


def test_a_pose(made):
    """Names of the platform's own degrees of freedom make a pose; one that no platform has is said."""
    packets = made(
        "bytes = 8\n" + fields({"z_m": 'type = "f"\noffset = 0', "pitch_rad": 'type = "f"\noffset = 4\nfactor = -1.0'})
    )
    assert packets(struct.pack("<2f", 0.5, 0.25)) == protocols.RigSetpoint(values=(0.0, 0.0, 0.5, 0.0, -0.25, 0.0))
    assert packets(struct.pack("<2f", 11.0, 0.0)) == "setpoints that are not finite, or beyond 10 m or rad"


def test_text(made):
    """A line with start, end and separator of its own, in decimals and in hexadecimals; what is none is said."""
    columns = fields({"up_m_s2": "column = 2\nfactor = 9.81\nzero = 1.0", "time_s": "column = 0"})
    packets = made('format = "text"\nstarts_with = "S~"\nends_with = "~"\nseparator = ";"\n' + columns)
    assert packets(b"S~12.5;x; 1.5e0;7~\r\n") == protocols.VehicleMotion(
        acceleration=(0.0, 0.0, pytest.approx(4.905)), rates=(0.0, 0.0, 0.0), time_s=12.5
    )
    assert packets(b"S~1;2~") == "2 columns (the file reads 3)"
    assert packets(b"S~1;2;up~") == "a column that is no number, for up_m_s2"
    assert "not finite" in packets(b"S~1;2;nan~")
    assert packets(b"1;2;3").startswith("5 bytes that begin with") and packets(b"\xff\xfe").startswith("2 bytes")
    hexadecimal = made(
        'format = "text"\nbase = 16\n' + fields({"leg_1_m": "column = 0\nzero = 32768.0\nfactor = 1e-5"})
    )
    assert hexadecimal(b"FFFF").values[0] == pytest.approx(0.32767)


def test_json(made):
    """Numbers by names and places; truth, texts, huge integers and a missing key are no numbers, deep nesting no JSON."""
    packets = made(
        'format = "json"\n'
        + fields({"forward_m_s2": 'key = ["a", 1]', "yaw_rad_s": 'key = ["rates", "r"]\nfactor = -1.0'})
    )
    good = {"a": [0, 2.5], "rates": {"r": 1}}
    assert packets(json.dumps(good).encode()) == protocols.VehicleMotion(
        acceleration=(2.5, 0.0, 0.0), rates=(0.0, 0.0, -1.0)
    )
    for value in (True, "2.5", None, 10**400):
        said = packets(json.dumps({"a": [0, value], "rates": {"r": 1}}).encode())
        assert said == "JSON without a number at a.1, for forward_m_s2"
    assert packets(b'{"a": [0]}').startswith("JSON without a number at a.1")
    for data in (b"", b"{", b"\xff", b"[" * 60_000):
        assert packets(data).startswith("no JSON")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bytes = 4\n[fields]\n", r"\[fields\] is empty"),
        ('bytes = 4\n[fields.up]\ntype = "f"\noffset = 0\n', r"\[fields.up\] is unknown: give any of forward_m_s2"),
        ("bytes = 4\n[fields.up_m_s2]\ncolumn = 0\n", r"has column: a field of binary packets has type and offset"),
        ('[fields.up_m_s2]\ntype = "f"\noffset = 0\n', "bytes is missing"),
        ('bytes = 4\nstarts_with = "xy"\n[fields.up_m_s2]\ntype = "f"\noffset = 0\n', "is no hexadecimal text"),
        ('format = "text"\n' + fields({"leg_1_m": "column = 0", "x_m": "column = 1"}), "legs and something else"),
        ('format = "text"\n' + fields({"z_m": "column = 0", "up_m_s2": "column = 1"}), "a pose and a vehicle's motion"),
        ('format = "text"\nacceleration = "world"\n' + fields({"up_m_s2": "column = 1"}), "needs the attitude"),
        ('format = "text"\n' + fields({"up_m_s2": "column = 1", "roll_rad": "column = 2"}), "nothing uses"),
    ],
)
def test_a_file_that_no_packet_can_follow_is_refused(made, text, said):
    """One sentence with the file's name, when it is loaded."""
    with pytest.raises(HexsimError, match=said):
        made(text)


def test_the_shipped_layouts():
    """A flight simulator on its tail's side: standing, banked left by 90 deg, 1 g towards the left; thrown forward by 10 ft/s2.
    Rigs in mid stroke stand in neutral, and the largest number is the longest leg."""
    msfs = toml_protocol.protocol(str(SHIPPED / "msfs.toml"))
    names = [
        "ACCELERATION BODY X",
        "ACCELERATION BODY Y",
        "ACCELERATION BODY Z",
        "PLANE BANK DEGREES",
        "PLANE PITCH DEGREES",
    ]
    names += [f"ROTATION VELOCITY BODY {axis}" for axis in "XYZ"]
    level = dict.fromkeys(names, 0.0)
    banked = msfs(json.dumps(level | {"PLANE BANK DEGREES": math.pi / 2}).encode())
    assert banked.acceleration == pytest.approx((0.0, -G, -G))
    pushed = msfs(json.dumps(level | {"ACCELERATION BODY Z": 10.0, "ROTATION VELOCITY BODY Y": 0.1}).encode())
    assert pushed.acceleration == pytest.approx((3.048, 0.0, 0.0)) and pushed.rates == pytest.approx((0.0, 0.0, -0.1))
    mover, simtools = (toml_protocol.protocol(str(SHIPPED / f"{name}.toml")) for name in ("mover", "simtools"))
    middle, most = mover(b"AB" + b"\x80\0\0" * 6), mover(b"AB" + b"\xff" * 18)
    assert middle.values == pytest.approx([0.0] * 6, abs=1e-7) and most.values == pytest.approx([0.151] * 6, abs=1e-3)
    assert simtools(b"0,32767,32768,65535,0,0").values == pytest.approx(
        [-0.151, 0.0, 0.0, 0.151, -0.151, -0.151], abs=1e-3
    )


def test_a_rigs_packets_move_the_legs(made):
    """Six actuators at 60 Hz to 20 mm on the bench's one leg: it goes there, holds through 0.3 s of silence without a fault,
    and comes back to neutral after a longer one, where the machine still runs."""
    packets = made('format = "text"\n' + fields({"leg_1_m": "column = 0\nfactor = 0.001"}))
    vehicle = vehicle_link.Vehicle(decode=packets, name="rig")
    server = serve.Server(load_machine("bench"), port=0, host_input=serve.HostInput(vehicle=vehicle))
    with server, contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as rig:

        def play(seconds: float, sends: bool) -> float:
            for k in range(round(seconds / server.tick_s)):
                if sends and k % 8 == 0:
                    rig.sendto(b"20", server.address)
                server.tick()
            return float(server.sensors.read(server.ticks)[0][0])

        neutral = play(0.1, False)
        assert play(4.0, True) - neutral == pytest.approx(0.020, abs=1e-3)
        assert play(0.3, False) - neutral == pytest.approx(0.020, abs=1e-3)
        assert play(3.0, False) - neutral == pytest.approx(0.0, abs=1e-3)
        assert server.computer.state == states.State.NORMAL and not server.computer.errors
