"""Motion cueing as a module: washout, packets of simulators, and the machine that they drive."""

import math
import socket
import struct

import numpy as np
import pytest

from hexsim.cueing.protocols import FDM_BYTES, flightgear, outsim, protocol, xplane, xplane12
from hexsim.cueing.washout import Washout, poses, washout_of
from hexsim.errors import HexsimError
from hexsim.machine import load_machine
from hexsim.motion_computer.states import State
from hexsim.recording.washout_figure import washout_figure
from hexsim.simulation.serve import HostInput, Server

FOOT = 0.3048


def fdm(x=0.0, y=0.0, z=-9.81, phi=0.0, theta=0.0, rates=(0.0, 0.0, 0.0)) -> bytes:
    """A native FDM packet: pilot's specific force [m/s2] forward, right, down."""
    data = bytearray(FDM_BYTES)
    struct.pack_into(">I", data, 0, 24)
    struct.pack_into(">3f", data, 36, phi, theta, 0.0)
    struct.pack_into(">3f", data, 56, *rates)
    struct.pack_into(">3f", data, 100, x / FOOT, y / FOOT, z / FOOT)
    return bytes(data)


def test_the_platform_returns_and_leans() -> None:
    """2 m/s2 forward for 40 s, scaled by 0.3: surge goes out and comes back, the nose rises until gravity gives 0.6 m/s2,
    no faster than 3 deg/s."""
    found = poses(Washout(), np.tile([2.0, 0.0, 0.0], (20_000, 1)))
    assert np.abs(found[:, 0]).max() > 0.03 and abs(found[-1, 0]) < 1e-4
    assert -9.81 * math.sin(found[-1, 4]) == pytest.approx(0.6, rel=0.01)
    assert np.abs(np.diff(found[:, 4])).max() * 500.0 <= math.radians(3.0) * 1.001


def test_adaptive_washout_keeps_large_manoeuvres_inside() -> None:
    """A push of 6 m/s2 takes the classical washout beyond 0.1 m and the adaptive one to 0.7 of that at most; a push of
    0.3 m/s2 is the same in both to 3 %."""
    push = np.zeros((3000, 3))
    push[100:600, 0] = 1.0
    for size, least, most in ((6.0, 0.0, 0.7), (0.3, 0.97, 1.0)):
        classical, adaptive = (np.abs(poses(Washout(adaptive=on), size * push)[:, 0]).max() for on in (False, True))
        assert least <= adaptive / classical <= most
        assert classical > 0.1 or size < 1.0


def test_a_washout_that_cannot_be_is_refused() -> None:
    """A corner frequency of zero would keep the platform out for ever."""
    with pytest.raises(HexsimError, match="washout: scale, corner frequencies"):
        Washout(high_pass_rad_s=(0.0, 1.0, 1.0))


def test_a_washout_from_a_file(tmp_path) -> None:
    """Keys of a TOML file over the defaults; an unknown key, a wrong type, a value that cannot be and an unknown name are said
    in one sentence with the file."""
    path = tmp_path / "mine.toml"
    path.write_text("scale = 0.5\nhigh_pass_rad_s = [2, 1.0, 3.0]\nadaptive = true\n")
    assert washout_of(str(path)) == Washout(scale=0.5, high_pass_rad_s=(2.0, 1.0, 3.0), adaptive=True)
    assert washout_of("adaptive") == Washout(adaptive=True) and washout_of("classical") == Washout()
    for text, said in (
        ("size = 1.0", "size: unexpected keyword argument; the keys are scale, high_pass_rad_s"),
        ("high_pass_rad_s = [1.0]", "high_pass_rad_s: field required; the keys"),
        ("scale = 0.0", "washout: scale, corner frequencies"),
        ("scale =", "is not valid TOML"),
    ):
        path.write_text(text)
        with pytest.raises(HexsimError, match=said) as caught:
            washout_of(str(path))
        assert str(caught.value).startswith(str(path))
    with pytest.raises(HexsimError, match="washout 'none' is unknown: give classical, adaptive"):
        washout_of("none")


def test_what_a_washout_makes_of_a_push_is_drawn() -> None:
    """A column a washout; after four seconds of push the lean alone gives the scaled acceleration, drawn in its own units."""
    figure = washout_figure({"mine": Washout(), "other": Washout(scale=0.2)}, 3.0)
    assert [plot.get_title() for plot in figure.axes[:2]] == ["mine", "other"]
    way, lean, force = (plot.lines[-1].get_ydata() for plot in figure.axes[::2])
    held = int(4.1 * 500)
    assert force[held] == pytest.approx(0.3 * 3.0, rel=0.03)
    assert 9.81 * np.sin(np.radians(lean[held])) == pytest.approx(0.9, rel=0.03)
    assert 50.0 < way.max() < 200.0


def test_flightgear_packets_are_read() -> None:
    """At rest 0; speeding up, a pull-up, acceleration to the right and a turn have their signs; a pitched aircraft at rest
    feels gravity forward; other sizes and versions are none."""
    assert flightgear(fdm()).acceleration == pytest.approx((0.0, 0.0, 0.0), abs=1e-5)
    assert flightgear(fdm(x=2.0, y=1.0, z=-14.0)).acceleration == pytest.approx((2.0, -1.0, 4.19), abs=1e-5)
    assert flightgear(fdm(rates=(0.1, 0.2, 0.3))).rates == pytest.approx((0.1, -0.2, -0.3), abs=1e-6)
    nose = flightgear(fdm(theta=0.5, rates=(0.0, 0.0, 0.3))).rates
    assert nose == pytest.approx((-0.3 * math.sin(0.5), 0.0, -0.3 * math.cos(0.5)), abs=1e-6)
    assert flightgear(fdm()[:-1]) is None and flightgear(b"\x00" * FDM_BYTES) is None
    assert flightgear(fdm(x=float("nan"))) is None


def test_xplane_packets_are_read() -> None:
    """Groups 4 and 16 in either order: 2 g upward is 9.81 m/s2 up, nose-up rate is negative about left; version 12 sends
    degrees and another order."""
    loads = struct.pack("<i8f", 4, 0, 0, 0, 0, 2.0, 0.1, 0.2, 0)
    rates = struct.pack("<i8f", 16, 0.3, 0.1, 0.2, 0, 0, 0, 0, 0)
    for body in (loads + rates, rates + loads):
        found = xplane(b"DATA*" + body)
        assert found.acceleration == pytest.approx((0.981, -1.962, 9.81), abs=1e-5)
        assert found.rates == pytest.approx((0.1, -0.3, -0.2), abs=1e-6)
    in_degrees = struct.pack("<i8f", 16, *np.degrees([0.1, 0.3, 0.2]), 0, 0, 0, 0, 0)
    assert xplane12(b"DATA*" + loads + in_degrees).rates == pytest.approx((0.1, -0.3, -0.2), abs=1e-5)
    assert xplane(b"DATA*" + loads) is None and xplane(b"DATA*" + loads + rates[:-1]) is None


def test_outsim_packets_are_turned_into_the_car() -> None:
    """A car that heads left (90 deg anticlockwise) and speeds up along it: forward; its clock in seconds."""
    data = struct.pack("<I12f3i", 2500, 0, 0, 0.4, math.pi / 2, 0, 0, -3.0, 0.0, 0.0, 0, 0, 0, 0, 0, 0)
    found = outsim(data)
    assert found.acceleration == pytest.approx((3.0, 0.0, 0.0), abs=1e-5)
    assert found.rates == pytest.approx((0.0, 0.0, 0.4), abs=1e-6) and found.time_s == 2.5
    assert outsim(data + b"\x00" * 4) == found and outsim(data + b"\x00") is None


def test_packets_that_a_file_describes(tmp_path) -> None:
    """Fields with format, offset, factor and zero; a field outside of the packet, an unknown one and other texts are refused."""
    path = tmp_path / "mine.toml"
    path.write_text('bytes = 8\n[fields.up_m_s2]\ntype = "f"\noffset = 4\nfactor = 9.81\nzero = 1.0\n')
    assert protocol(str(path))(struct.pack("<2f", 0.0, 1.5)).acceleration == pytest.approx((0.0, 0.0, 4.905))
    for text, said in (
        ('bytes = 4\n[fields.up_m_s2]\ntype = "f"\noffset = 4\n', "lies outside the packet"),
        ('bytes = 4\n[fields.up]\ntype = "f"\noffset = 0\n', "unknown field up"),
        ("nothing", "describes no packets"),
    ):
        path.write_text(text)
        with pytest.raises(HexsimError, match=said):
            protocol(str(path))
    with pytest.raises(HexsimError, match="--from 'aces' is unknown: give one of flightgear, xplane, xplane12, outsim"):
        protocol("aces")


def test_a_flight_model_moves_the_machine() -> None:
    """FlightGear packets at 60 Hz with 5 % lost: the machine goes to normal by itself, a pull-up of 3 m/s2 for half a second
    moves it, what is felt up is the washout's within the loop's lag, and silence ends in a fault."""
    rng = np.random.default_rng(0)
    with Server(
        load_machine("micro_motion_system"), port=0, host_input=HostInput(vehicle=flightgear), timestep=2e-4
    ) as server:
        host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        highest = asked = 0.0
        for k in range(1500):
            if k % 8 == 0 and rng.random() > 0.05:
                pull = 3.0 * (1.0 < k * server.tick_s < 1.5)
                host.sendto(fdm(z=-9.81 - pull), server.address)
            server.tick()
            asked = max(asked, server.link.pose[2])
            highest = max(highest, float(server.plant.data.qpos[2] - server.plant.kinematics.neutral_height_m))
        assert server.computer.state == State.NORMAL
        assert asked > 0.01 and highest == pytest.approx(asked, rel=0.3)
        for _ in range(600):
            server.tick()
        assert server.computer.state == State.FAULT
        host.close()


def take_off(seconds: float, folder) -> list[tuple[float, bytes]]:
    """(time, packet): JSBSim's own FlightGear packets of a C172 that takes off at full throttle and is pulled up at 60 kt."""
    jsbsim = pytest.importorskip("jsbsim")
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    listener.setblocking(False)
    flight = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    flight.set_debug_level(0)
    flight.load_model("c172p")
    flight.set_dt(1 / 120)
    port = listener.getsockname()[1]
    (folder / "out.xml").write_text(
        f'<?xml version="1.0"?><output name="127.0.0.1" type="FLIGHTGEAR" port="{port}" protocol="UDP" rate="60"/>'
    )
    flight["ic/h-agl-ft"] = 4.5
    flight.set_output_directive(str(folder / "out.xml"))
    flight.run_ic()
    flight["propulsion/set-running"] = -1
    flight["fcs/throttle-cmd-norm"] = flight["fcs/mixture-cmd-norm"] = 1.0
    packets = []
    while flight.get_sim_time() < seconds:
        flight["fcs/elevator-cmd-norm"] = -0.2 if flight["velocities/vc-kts"] > 60 else 0.0
        flight.run()
        while True:
            try:
                packets.append((flight.get_sim_time(), listener.recv(2048)))
            except BlockingIOError:
                break
    listener.close()
    return packets


def test_a_take_off_is_felt(tmp_path) -> None:
    """JSBSim's C172 takes off and is pulled up: packets at 60 Hz, 5 % lost, up to 5 ms late, on the tuned machine. Full
    throttle pushes forward, the pull-up raises; the machine follows the washout without a fault, and what is felt comes
    at most 40 ms after the setpoint in every axis that moves."""
    rng, packets = np.random.default_rng(0), take_off(19.0, tmp_path)
    found = [flightgear(data) for _, data in packets]
    assert all(one is not None for one in found) and len(found) > 1000
    assert np.mean([one.acceleration[0] for one in found[300:600]]) == pytest.approx(2.6, abs=0.4)
    assert max(one.acceleration[2] for one in found[800:]) > 1.0
    waiting = sorted((t + rng.uniform(0.0, 0.005), data) for t, data in packets if rng.random() > 0.05)
    with Server(
        load_machine("micro_motion_system/tuned"), port=0, host_input=HostInput(vehicle=flightgear), timestep=2e-4
    ) as server:
        host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        while waiting:
            while waiting and waiting[0][0] <= server.time_s:
                host.sendto(waiting.pop(0)[1], server.address)
            server.tick()
        host.close()
        assert server.computer.state == State.NORMAL
        latency = server.latency.ms()
    assert {"x", "pitch"} <= set(latency)
    assert max(latency.values()) < 40.0
