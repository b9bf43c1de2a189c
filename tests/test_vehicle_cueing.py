"""Motion cueing as a module: washout, packets of simulators, and the machine that they drive."""

import contextlib
import math
import runpy
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.cli import flown
from hexsim.cueing import protocols, toml_protocol, washout
from hexsim.machine import load_machine
from hexsim.motion_computer import states
from hexsim.simulation import serve, vehicle_link

beamng, flightgear, outsim, xplane, xplane12, xplane_rref = (
    protocols.PROTOCOLS[name] for name in ("beamng", "flightgear", "outsim", "xplane", "xplane12", "xplane-rref")
)

FOOT = 0.3048


def fdm(x=0.0, y=0.0, z=-9.81, phi=0.0, theta=0.0, rates=(0.0, 0.0, 0.0), version=24) -> bytes:
    """A native FDM packet: pilot's specific force [m/s2] forward, right, down."""
    data = bytearray({24: 408, 25: 552}.get(version, 408))
    struct.pack_into(">I", data, 0, version)
    struct.pack_into(">3f", data, 36, phi, theta, 0.0)
    struct.pack_into(">3f", data, 56, *rates)
    struct.pack_into(">3f", data, 100, x / FOOT, y / FOOT, z / FOOT)
    return bytes(data)


def test_the_platform_returns_and_leans() -> None:
    """2 m/s2 forward for 40 s, scaled by 0.3: surge goes out and comes back, the nose rises until gravity gives 0.6 m/s2,
    no faster than 3 deg/s."""
    found = washout.poses(washout.Washout(), np.tile([2.0, 0.0, 0.0], (20_000, 1)))
    assert np.abs(found[:, 0]).max() > 0.03 and abs(found[-1, 0]) < 1e-4
    assert -9.81 * math.sin(found[-1, 4]) == pytest.approx(0.6, rel=0.01)
    assert np.abs(np.diff(found[:, 4])).max() * 500.0 <= math.radians(3.0) * 1.001


def test_adaptive_washout_keeps_large_manoeuvres_inside() -> None:
    """A push of 6 m/s2 takes the classical washout beyond 0.1 m and the adaptive one to 0.7 of that at most; a push of
    0.3 m/s2 is the same in both to 3 %."""
    push = np.zeros((3000, 3))
    push[100:600, 0] = 1.0
    for size, least, most in ((6.0, 0.0, 0.7), (0.3, 0.97, 1.0)):
        classical, adaptive = (
            np.abs(washout.poses(washout.Washout(adaptive=on), size * push)[:, 0]).max() for on in (False, True)
        )
        assert least <= adaptive / classical <= most
        assert classical > 0.1 or size < 1.0


def test_a_washout_that_cannot_be_is_refused() -> None:
    """A corner frequency of zero would keep the platform out for ever."""
    with pytest.raises(HexsimError, match="washout: scale, corner frequencies"):
        washout.Washout(high_pass_rad_s=(0.0, 1.0, 1.0))


def test_a_washout_from_a_file(tmp_path) -> None:
    """Keys of a TOML file over the defaults; an unknown key, a wrong type, a value that cannot be and an unknown name are said
    in one sentence with the file."""
    path = tmp_path / "mine.toml"
    path.write_text("scale = 0.5\nhigh_pass_rad_s = [2, 1.0, 3.0]\nadaptive = true\n")
    assert washout.washout_of(str(path)) == washout.Washout(scale=0.5, high_pass_rad_s=(2.0, 1.0, 3.0), adaptive=True)
    assert (
        washout.washout_of("adaptive") == washout.Washout(adaptive=True)
        and washout.washout_of("classical") == washout.Washout()
    )
    for text, said in (
        ("size = 1.0", "size: unexpected keyword argument; the keys are scale, high_pass_rad_s"),
        ("high_pass_rad_s = [1.0]", "high_pass_rad_s: field required; the keys"),
        ("scale = 0.0", "washout: scale, corner frequencies"),
        ("scale =", "is not valid TOML"),
    ):
        path.write_text(text)
        with pytest.raises(HexsimError, match=said) as caught:
            washout.washout_of(str(path))
        assert str(caught.value).startswith(str(path))
    with pytest.raises(HexsimError, match="washout 'none' is unknown: give classical, adaptive"):
        washout.washout_of("none")


def test_what_a_washout_makes_of_a_push_is_drawn() -> None:
    """A column a washout; after four seconds of push the lean alone gives the scaled acceleration, drawn in its own units."""
    drawn = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "washout_figure.py"))
    figure = drawn["washout_figure"]({"mine": washout.Washout(), "other": washout.Washout(scale=0.2)}, 3.0)
    assert [plot.get_title() for plot in figure.axes[:2]] == ["mine", "other"]
    way, lean, force = (plot.lines[-1].get_ydata() for plot in figure.axes[::2])
    held = int(4.1 * 500)
    assert force[held] == pytest.approx(0.3 * 3.0, rel=0.03)
    assert 9.81 * np.sin(np.radians(lean[held])) == pytest.approx(0.9, rel=0.03)
    assert 50.0 < way.max() < 200.0


def test_jsbsims_own_packets_have_the_signs_that_are_read(tmp_path, monkeypatch) -> None:
    """JSBSim flies a Cessna 172 and sends FGNetFDM itself: level flight is felt as nothing, a pull as up by (Nz - 1) g with the nose
    going up (negative about left), aileron to the right as a roll to the right; rates as JSBSim's own properties."""
    jsbsim = pytest.importorskip("jsbsim", reason="sends the packets; pip install jsbsim")
    monkeypatch.chdir(tmp_path)  # JSBSim leaves a table where it runs
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.setblocking(False)
        port = there.getsockname()[1]
        output = f'<output name="127.0.0.1" type="FLIGHTGEAR" port="{port}" protocol="UDP" rate="60"/>'
        (tmp_path / "output.xml").write_text(f'<?xml version="1.0"?>{output}')
        flight = jsbsim.FGFDMExec(None)
        flight.set_debug_level(0)
        flight.load_model("c172x")
        flight.set_dt(1.0 / 120.0)
        assert flight.set_output_directive(str(tmp_path / "output.xml"))
        flight["ic/h-sl-ft"], flight["ic/vc-kts"] = 4000.0, 100.0
        flight.run_ic()
        flight["propulsion/set-running"] = -1
        flight.do_trim(1)
        trimmed, rows = flight["fcs/elevator-cmd-norm"], []
        for k in range(480):
            flight["fcs/elevator-cmd-norm"] = trimmed - 0.15 * (120 <= k < 240)
            flight["fcs/aileron-cmd-norm"] = 0.3 * (k >= 360)
            flight.run()
            with contextlib.suppress(BlockingIOError):
                while True:
                    told = flightgear(there.recv(4096))
                    known = [
                        flight[name] for name in ("accelerations/Nz", "velocities/p-rad_sec", "velocities/q-rad_sec")
                    ]
                    rows.append((k / 120.0, *told.acceleration, *told.rates, *known))
    rows = [row for row in rows if row[0] > 0.1]  # the first is of before the trim
    time, _, _, up, roll, pitch, _, load, p, q = np.array(rows).T
    level, pull, bank = ((time > a) & (time < b) for a, b in ((0.2, 0.9), (1.1, 1.6), (3.2, 4.0)))
    assert (
        abs(up[level]).max() < 0.1 and up[pull].mean() > 2.0 and pitch[pull].mean() < -0.05 and roll[bank].mean() > 0.2
    )
    assert up == pytest.approx(9.81 * (load - 1.0), abs=0.3)
    assert roll == pytest.approx(p, abs=0.02) and pitch == pytest.approx(-q, abs=0.02)


def test_flightgear_packets_are_read() -> None:
    """At rest 0; speeding up, a pull-up, acceleration to the right and a turn have their signs; a pitched aircraft at rest
    feels gravity forward; version 25 reads the same; other sizes and versions are named."""
    assert flightgear(fdm()).acceleration == pytest.approx((0.0, 0.0, 0.0), abs=1e-5)
    for version in (24, 25):
        found = flightgear(fdm(x=2.0, y=1.0, z=-14.0, version=version))
        assert found.acceleration == pytest.approx((2.0, -1.0, 4.19), abs=1e-5)
        assert flightgear(fdm(rates=(0.1, 0.2, 0.3), version=version)).rates == pytest.approx(
            (0.1, -0.2, -0.3), abs=1e-6
        )
    nose = flightgear(fdm(theta=0.5, rates=(0.0, 0.0, 0.3))).rates
    assert nose == pytest.approx((-0.3 * math.sin(0.5), 0.0, -0.3 * math.cos(0.5)), abs=1e-6)
    assert flightgear(fdm(version=26)).startswith("version 26, 408 bytes")
    assert flightgear(fdm()[:-1]).startswith("version 24, 407 bytes")
    assert flightgear(b"\x00" * 408).startswith("408 bytes that begin with")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e30])
def test_angles_and_numbers_that_cannot_be_are_refused(bad: float) -> None:
    """Not a number, infinite and huge, in each place of each protocol that is read: a reason, and no exception."""
    for place in ("x", "y", "z", "phi", "theta"):
        assert isinstance(flightgear(fdm(**{place: bad})), str), place
    for k in range(3):
        assert isinstance(flightgear(fdm(rates=tuple(bad if j == k else 0.0 for j in range(3)))), str)
    for k in range(9):
        numbers = [bad if j == k else 0.0 for j in range(12)]
        for data in (struct.pack("<I12f3i", 1, *numbers, 0, 0, 0), outsim2(numbers)):
            assert isinstance(outsim(data), str), k
    for k in range(6):
        assert isinstance(xplane_rref(rref([bad if j == k else 0.0 for j in range(6)])), str), k


def test_xplane_packets_are_read() -> None:
    """Groups 4 and 16 in either order: 2 g upward is 9.81 m/s2 up, nose-up rate is negative about left; version 12 sends
    degrees and another order; a group that is missing is named."""
    loads = struct.pack("<i8f", 4, 0, 0, 0, 0, 2.0, 0.1, 0.2, 0)
    rates = struct.pack("<i8f", 16, 0.3, 0.1, 0.2, 0, 0, 0, 0, 0)
    for body in (loads + rates, rates + loads):
        found = xplane(b"DATA*" + body)
        assert found.acceleration == pytest.approx((0.981, -1.962, 9.81), abs=1e-5)
        assert found.rates == pytest.approx((0.1, -0.3, -0.2), abs=1e-6)
    in_degrees = struct.pack("<i8f", 16, *np.degrees([0.1, 0.3, 0.2]), 0, 0, 0, 0, 0)
    assert xplane12(b"DATA*" + loads + in_degrees).rates == pytest.approx((0.1, -0.3, -0.2), abs=1e-5)
    assert "without group 16" in xplane(b"DATA*" + loads) and "without group 4" in xplane12(b"DATA*" + rates)
    assert "72 bytes" in xplane(b"DATA*" + loads + rates[:-5])


def rref(values, first: int = 1) -> bytes:
    """RREF of X-Plane: axial, side, normal [g], P Q R [rad/s], by index."""
    return b"RREF," + b"".join(struct.pack("<if", k, value) for k, value in enumerate(values, first))


def test_datarefs_of_xplane_are_asked_for_and_read() -> None:
    """A request is 413 bytes with rate, index and name; its answers, in any order and with others among them, read as the
    DATA groups do; one that is missing is named."""
    requests = [struct.unpack("<5sii400s", data) for data in protocols.rref_requests(60)]
    assert [(head, rate) for head, rate, _, _ in requests] == [(b"RREF\0", 60)] * 6
    asked = {index: name.rstrip(b"\0").decode() for _, _, index, name in requests}
    told = {"g_axil": 0.1, "g_side": 0.2, "g_nrml": 2.0, "Prad": 0.1, "Qrad": 0.3, "Rrad": 0.2}
    pairs = [struct.pack("<if", index, told[name.rpartition("/")[2]]) for index, name in asked.items()]
    for order in (pairs, [struct.pack("<if", 77, 1.0), *reversed(pairs)]):
        found = xplane_rref(b"RREF," + b"".join(order))
        assert found.acceleration == pytest.approx((0.981, -1.962, 9.81), abs=1e-5)
        assert found.rates == pytest.approx((0.1, -0.3, -0.2), abs=1e-6)
    assert f"without {protocols.RREF_NAMES[5]}, index 6" in xplane_rref(rref([0.0] * 5))


def outsim2(main, parts: int = 208) -> bytes:
    """OutSimPack2 of Live for Speed: header, id, time 2500 ms, main, and `parts` bytes of inputs, drive, distance, wheels
    and extra."""
    return struct.pack("<4siI12f3i", b"LFST", 7, 2500, *main, 0, 0, 0) + b"\x01" * parts


def test_outsim_packets_are_turned_into_the_car() -> None:
    """A car that heads left (90 deg anticlockwise) and speeds up along it: forward; its clock in seconds. OutSimPack with
    and without id, OutSimPack2 whole (280 bytes), without extra (272) and with the main part alone; with options that lack
    a part that is needed, the option is named."""
    main = (0, 0, 0.4, math.pi / 2, 0, 0, -3.0, 0.0, 0.0, 0, 0, 0)
    data = struct.pack("<I12f3i", 2500, *main, 0, 0, 0)
    found = outsim(data)
    assert found.acceleration == pytest.approx((3.0, 0.0, 0.0), abs=1e-5)
    assert found.rates == pytest.approx((0.0, 0.0, 0.4), abs=1e-6) and found.time_s == 2.5
    assert outsim(data + b"\x00" * 4) == found and "65 bytes" in outsim(data + b"\x00")
    assert [outsim(outsim2(main, parts)) for parts in (208, 200, 0)] == [found] * 3
    assert len(outsim2(main)) == 280
    assert "set OutSim Opts to 1ff" in outsim(outsim2(main)[:68])


def test_packets_that_a_file_describes(tmp_path) -> None:
    """Fields with format, offset, factor and zero. A type that is no number, sizes and offsets that are none, a field outside
    of the packet, an unknown one and other texts are refused as the file is loaded, in one sentence that names it."""
    path = tmp_path / "mine.toml"
    path.write_text('bytes = 8\n[fields.up_m_s2]\ntype = "f"\noffset = 4\nfactor = 9.81\nzero = 1.0\n')
    assert toml_protocol.protocol(str(path))(struct.pack("<2f", 0.0, 1.5)).acceleration == pytest.approx(
        (0.0, 0.0, 4.905)
    )
    for text, said in (
        ('bytes = 4\n[fields.up_m_s2]\ntype = "f"\noffset = 4\n', "lies outside the packet"),
        ('bytes = 4\n[fields.up]\ntype = "f"\noffset = 0\n', r"\[fields.up\] is unknown: give any of forward_m_s2"),
        ("nothing", "is not valid TOML"),
        ("bytes = 4\nfields = 5", "must be a table"),
        ("bytes = 4\n[fields]", "is empty: give any of forward_m_s2"),
        *(
            (f'bytes = 8\n[fields.up_m_s2]\ntype = "{kind}"\noffset = 0\n', "type = ")
            for kind in ("4s", "c", "", "2f", "P")
        ),
        *(
            (f'bytes = {size}\n[fields.up_m_s2]\ntype = "f"\noffset = 0\n', "bytes = ")
            for size in ("inf", "true", "0", "1e3")
        ),
        *((f'bytes = 8\n[fields.up_m_s2]\ntype = "f"\noffset = {at}\n', "offset = ") for at in ("-1", "0.5", "nan")),
        *(
            (f'bytes = 8\n[fields.up_m_s2]\ntype = "f"\noffset = 0\nfactor = {by}', "factor = ")
            for by in ("nan", '"2"')
        ),
    ):
        path.write_text(text)
        with pytest.raises(HexsimError, match=said) as caught:
            toml_protocol.protocol(str(path))
        assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)
    with pytest.raises(
        HexsimError, match="--from 'aces' is unknown: give one of flightgear, jsbsim, xplane, xplane12, xplane-rref"
    ):
        toml_protocol.protocol("aces")


def drive(server: serve.Server, seconds: float, packet, every: int = 8):
    """Tick a server, sending a packet each `every` ticks (8: 62.5 Hz), where there is one."""
    host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        for k in range(round(seconds / server.tick_s)):
            data = packet() if k % every == 0 else None
            if data is not None:
                host.sendto(data, server.address)
            server.tick()
            yield server
    finally:
        host.close()


def hexapod(**more) -> serve.Server:
    vehicle = vehicle_link.Vehicle(decode=flightgear, name="flightgear", **more)
    return serve.Server(
        load_machine("micro_motion_system"), port=0, host_input=serve.HostInput(vehicle=vehicle), timestep=2e-4
    )


def test_a_flight_model_moves_the_machine() -> None:
    """FlightGear packets at 60 Hz with 5 % lost: the machine goes to normal by itself, a pull-up of 3 m/s2 for half a second
    moves it, and what is felt up is the washout's within the loop's lag."""
    rng = np.random.default_rng(0)
    with hexapod() as server:

        def packet() -> bytes | None:
            pull = 3.0 * (1.5 < server.time_s < 2.0)
            return fdm(z=-9.81 - pull) if rng.random() > 0.05 else None

        highest = asked = 0.0
        for _ in drive(server, 3.0, packet):
            asked = max(asked, server.link.pose[2])
            highest = max(highest, float(server.plant.data.qpos[2] - server.plant.kinematics.neutral_height_m))
        assert server.computer.state == states.State.NORMAL
        assert asked > 0.01 and highest == pytest.approx(asked, rel=0.3)


@pytest.mark.slow
def test_a_pause_settles_the_machine_and_it_goes_on() -> None:
    """A banked climb, 3 s of silence, the same again: no fault, the platform near neutral in the pause, the setpoint's
    acceleration at the pause and at the return within what the washout makes of the flight itself, and two messages."""
    with hexapod() as server:
        flight = lambda: fdm(x=2.0, z=-11.0, rates=(0.05, 0.02, 0.0))  # noqa: E731
        poses = [server.link.pose.copy() for server in drive(server, 4.0, flight)]
        for _ in drive(server, 8.0, lambda: None):
            poses.append(server.link.pose.copy())
        assert server.computer.state == states.State.NORMAL and not server.computer.errors
        assert np.abs(poses[-1]).max() < 0.02 < np.abs(poses[1999]).max()
        for _ in drive(server, 4.0, flight):
            poses.append(server.link.pose.copy())
        assert server.computer.state == states.State.NORMAL and server.link.share == 1.0
        np.testing.assert_allclose(poses[-1], poses[1999], atol=0.02)
        change = np.abs(np.diff(poses, 2, axis=0)).max(axis=1) / server.tick_s**2
        flown = change[:250].max()  # the fade from rest into the flight
        assert change[250:].max() < 1.2 * flown
        said = [text for _, _, text in server.messages]
        assert any("no packets of flightgear for 0.5 s" in text for text in said)
        assert any("packets of flightgear again" in text for text in said)


def test_strictly_a_pause_is_a_fault() -> None:
    """`--strict`: silence of 0.5 s and the host timeout end in a fault."""
    with hexapod(strict=True) as server:
        for _ in drive(server, 0.6, fdm):
            pass
        assert server.computer.state == states.State.NORMAL
        for _ in drive(server, 1.2, lambda: None):
            pass
        assert server.computer.state == states.State.FAULT


def test_one_simulator_at_a_time_is_listened_to() -> None:
    """Another sender's wild packets between those of the simulator: counted, and the platform stays; once the simulator is
    silent for half a second the other one has it."""
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with hexapod() as server, stranger:
        server.tick()
        for _ in drive(server, 0.5, fdm):
            stranger.sendto(fdm(x=30.0), server.address)
        assert server.link.counts["other host"] >= 200
        assert np.abs(server.link.pose).max() < 1e-3
        for _ in range(round(1.0 / server.tick_s)):
            stranger.sendto(fdm(x=30.0), server.address)
            server.tick()
        assert np.abs(server.link.pose).max() > 0.01


def test_xplane_is_asked_until_it_answers_and_told_the_end() -> None:
    """An X-Plane on loopback: it is asked for six datarefs once a second while it is silent and not while it answers, its
    answers drive the machine, and as the machine goes away it is asked for none any more."""
    xplane_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    xplane_socket.bind(("127.0.0.1", 0))
    xplane_socket.setblocking(False)

    def asked() -> list[tuple[int, int]]:
        """Rate and index of the requests that came."""
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                found.append(struct.unpack_from("<ii", xplane_socket.recv(1000), 5))
        return found

    vehicle = flown.vehicle_of(f"xplane-rref@127.0.0.1:{xplane_socket.getsockname()[1]}", strict=False)
    everything = [(60, index) for index in range(1, 7)]
    with xplane_socket:
        with serve.Server(
            load_machine("bench"), port=0, host_input=serve.HostInput(vehicle=vehicle), timestep=2e-4
        ) as server:
            for _ in range(round(1.5 / server.tick_s)):
                server.tick()
            assert asked() == 2 * everything
            for _ in range(round(1.0 / server.tick_s)):
                xplane_socket.sendto(rref([0.0, 0.0, 1.2, 0.0, 0.0, 0.0]), server.address)
                server.tick()
            assert server.computer.state == states.State.NORMAL and server.link.pose[2] > 1e-3 and asked() == []
        assert asked() == [(0, index) for index in range(1, 7)]
    for wrong in ("xplane-rref@", "xplane-rref@127.0.0.1:x", "xplane-rref@127.0.0.1:70000", "xplane-rref@no such host"):
        with pytest.raises(HexsimError, match="xplane-rref@"):
            flown.vehicle_of(wrong, strict=False)


def test_a_clock_that_stands_still_is_a_pause() -> None:
    """OutSim packets that go on with the same time: the simulator is in a menu, and its last acceleration is not held."""
    main = (0.0,) * 3 + (0.0,) * 3 + (0.0, 4.0, 0.0) + (0.0,) * 3
    clock = iter(range(1, 1_000_000))
    with serve.Server(
        load_machine("bench"),
        port=0,
        host_input=serve.HostInput(vehicle=vehicle_link.Vehicle(decode=outsim, name="outsim")),
        timestep=2e-4,
    ) as server:
        for _ in drive(server, 1.5, lambda: struct.pack("<I12f3i", 16 * next(clock), *main, 0, 0, 0)):
            pass
        assert server.link.share == 1.0
        for _ in drive(server, 2.0, lambda: struct.pack("<I12f3i", 9999, *main, 0, 0, 0)):
            pass
        assert server.link.share == 0.0 and server.link.silent_s > 1.0


def test_the_status_says_what_came_instead() -> None:
    """A simulator of another version: how many packets, that none is understood, and what they are; among packets that are,
    how many are not."""
    with hexapod() as server:
        for _ in drive(server, 0.2, lambda: fdm(version=26)):
            pass
        status = server.run(duration_s=0.0)
        assert "13 packets, none is of flightgear: version 26, 408 bytes" in status.line()
        for _ in drive(server, 0.2, fdm):
            pass
        assert "26 packets, 13 are not of flightgear: version 26" in server.run(duration_s=0.0).line()
        for _ in drive(server, 0.4, lambda: np.random.default_rng(server.ticks).bytes(40), every=1):
            pass
        assert len(server.link.refusals) < 20  # a flood of noise fills no memory


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


@pytest.mark.slow
def test_a_take_off_is_felt(tmp_path, monkeypatch) -> None:
    """JSBSim's C172 takes off and is pulled up: packets at 60 Hz, 5 % lost, up to 5 ms late, on the tuned machine. Full
    throttle pushes forward, the pull-up raises; the machine follows the washout without a fault, and what is felt comes
    at most 40 ms after the setpoint in every axis that moves."""
    monkeypatch.chdir(tmp_path)  # JSBSim leaves a table where it runs
    rng, packets = np.random.default_rng(0), take_off(19.0, tmp_path)
    found = [flightgear(data) for _, data in packets]
    assert all(isinstance(one, protocols.VehicleMotion) for one in found) and len(found) > 1000
    assert np.mean([one.acceleration[0] for one in found[300:600]]) == pytest.approx(2.6, abs=0.4)
    assert max(one.acceleration[2] for one in found[800:]) > 1.0
    waiting = sorted((t + rng.uniform(0.0, 0.005), data) for t, data in packets if rng.random() > 0.05)
    with serve.Server(
        load_machine("micro_motion_system/tuned"),
        port=0,
        timestep=2e-4,
        host_input=serve.HostInput(vehicle=vehicle_link.Vehicle(decode=flightgear)),
    ) as server:
        host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        while waiting:
            while waiting and waiting[0][0] <= server.time_s:
                host.sendto(waiting.pop(0)[1], server.address)
            server.tick()
        host.close()
        assert server.computer.state == states.State.NORMAL
        latency = server.latency.ms()
    assert {"x", "pitch"} <= set(latency)
    assert max(latency.values()) < 40.0


def motionsim(left=0.0, rear=0.0, up=0.0, rates=(0.0, 0.0, 0.0), magic=b"BNG1") -> bytes:
    """MotionSim of BeamNG: 21 floats behind the magic, acceleration from the 7th, rates from the 16th."""
    numbers = [9.0] * 6 + [left, rear, up] + [9.0] * 6 + list(rates) + [9.0] * 3
    return magic + struct.pack("<21f", *numbers)


def test_beamng() -> None:
    """Braking (towards the rear) is backwards, a bump up is up; rates go on as they come; another magic and another size
    are said."""
    assert beamng(motionsim()).acceleration == (0.0, 0.0, 0.0)
    assert beamng(motionsim(rear=2.0, up=1.0)).acceleration == pytest.approx((-2.0, 0.0, 1.0))
    assert beamng(motionsim(left=-3.0, rates=(0.1, -0.2, 0.3))) == protocols.VehicleMotion(
        acceleration=(0.0, -3.0, 0.0), rates=struct.unpack("<3f", struct.pack("<3f", 0.1, -0.2, 0.3))
    )
    assert beamng(motionsim(magic=b"BNG2")) == "88 bytes that begin with b'BNG2'"
    assert beamng(motionsim()[:-4]) == "BNG1 of 84 bytes (MotionSim has 88)"


def test_other_names_of_the_same_packets() -> None:
    """JSBSim sends FlightGear's packets and Live for Speed OutSim's."""
    assert protocols.PROTOCOLS["jsbsim"](fdm(x=1.0)) == protocols.PROTOCOLS["flightgear"](fdm(x=1.0))
    assert protocols.PROTOCOLS["lfs"] is outsim
