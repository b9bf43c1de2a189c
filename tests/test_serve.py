"""The machine in real time with its host interface, over loopback; clocked by hand so that nothing depends on load."""

import contextlib
import json
import random
import runpy
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.hydraulics import leg
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer import compensator_packet, host_packet, states
from hexsim.motion_computer.errors import Error
from hexsim.recording import run_files
from hexsim.simulation import serve as serving

MACHINE = load_machine("micro_motion_system")


class Host:
    """A host that sends when it is told to, with its own socket."""

    def __init__(self, server: serving.Server) -> None:
        self.server = server
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(2.0)
        self.sequence = 0
        self.reply: host_packet.Reply | None = None

    def run(
        self, seconds: float, setpoint=lambda t: (0.0,) * 6, command: str = "none", every: int = 8, mode: int = 0
    ) -> None:
        """Tick the server, sending each `every` ticks (8: 62.5 Hz) with the command in the first packet."""
        for k in range(round(seconds / self.server.tick_s)):
            if k % every == 0:
                now = self.server.time_s
                packet = host_packet.HostCommand(
                    sequence=self.sequence, time_s=now, setpoints=tuple(setpoint(now)), command=command, mode=mode
                )
                self.socket.sendto(packet.pack(), self.server.address)
                self.sequence, command = self.sequence + 1, "none"
            self.server.tick()
            if k % every == 0:
                reply = host_packet.unpack_reply(self.socket.recv(host_packet.REPLY.size))
                assert isinstance(reply, host_packet.Reply), reply
                self.reply = reply


@pytest.fixture
def server():
    with serving.Server(MACHINE, port=0, timestep=2e-4) as made:
        yield made


@pytest.fixture
def host(server):
    made = Host(server)
    yield made
    made.socket.close()


def smooth(t: float) -> float:
    g = min(max(t, 0.0), 1.0)
    return g * g * g * (10 - 15 * g + 6 * g * g)


def test_a_host_moves_the_platform_and_reads_its_pose(server, host) -> None:
    """20 mm of heave asked at 60 Hz arrive; the pose in the reply is the plant's to 50 um (transducers of 3 um)."""
    host.run(0.1, command="run_normal")
    start = server.time_s
    host.run(3.0, lambda t: (0, 0, 0.02 * smooth(t - start), 0, 0, 0))
    assert host.reply.state == states.State.NORMAL and host.reply.errors == Error.NONE
    true = server.plant.data.qpos[2] - server.plant.kinematics.neutral_height_m
    assert host.reply.pose[2] == pytest.approx(true, abs=5e-5)
    assert true == pytest.approx(0.02, abs=1.5e-3)  # position error of the loop: dead band over gain, 45 mV / 50 V/m
    assert host.reply.reference[2] == pytest.approx(0.02, abs=1e-6)


def test_the_whole_cycle_of_states() -> None:
    """From its stops: start, neutral, normal, back to neutral, settle, off; legs at rest on the stops at both ends."""
    with serving.Server(MACHINE, port=0, timestep=2e-4, start="off") as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            assert server.plant.piston_positions().max() < 0.006
            host.run(6.0, command="start")
            assert host.reply.state == states.State.NEUTRAL and host.reply.arrived
            assert server.plant.piston_positions() == pytest.approx(np.full(6, 0.1), abs=1.5e-3)
            host.run(0.5, command="run_normal")
            host.run(2.0, command="return_neutral")
            assert host.reply.state == states.State.NEUTRAL
            host.run(7.0, command="settle")
            assert host.reply.state == states.State.OFF and host.reply.arrived
            assert server.plant.piston_positions().max() < 0.006


def test_a_forbidden_command_is_refused_and_said(server, host) -> None:
    """start while in neutral: the state stays, the reply says refused, the message says what is possible."""
    host.run(0.1, command="start")
    assert host.reply.state == states.State.NEUTRAL and host.reply.refused
    assert any("'start' is not possible in state neutral; possible: " in text for _, _, text in server.messages)
    host.run(0.1, command="run_normal")
    assert host.reply.state == states.State.NORMAL and not host.reply.refused


def test_a_silent_host_ends_in_fault_and_the_platform_settles(server, host) -> None:
    """Silence for more than 0.25 s in normal state: host timeout, fault, and after some seconds down at rest."""
    host.run(0.5, command="run_normal")
    for _ in range(round(8.0 / server.tick_s)):
        server.tick()
    host.run(0.1)
    assert host.reply.state == states.State.FAULT and host.reply.errors == Error.HOST_TIMEOUT and host.reply.arrived
    assert server.plant.piston_positions().max() < 0.006
    host.run(0.1, command="reset")
    assert host.reply.state == states.State.OFF and host.reply.errors == Error.NONE


def test_actuator_mode_moves_one_leg(server, host) -> None:
    """Mode 1: 5 mm for leg 2 alone moves leg 2 by 5 mm and the others not at all (within the dead band)."""
    host.run(0.1, command="run_normal", mode=1)
    start = server.time_s
    host.run(2.0, lambda t: (0, 0.005 * smooth(t - start), 0, 0, 0, 0), mode=1)
    moved = server.plant.piston_positions() - 0.1
    assert moved[1] == pytest.approx(0.005, abs=1.5e-3)
    assert np.abs(np.delete(moved, 1)).max() < 1.5e-3


def test_an_absurd_wish_is_held_within_the_limits(server, host) -> None:
    """A jump to 900 m in all axes: workspace shown, state normal, legs clear of cushions, acceleration of the pose
    within a few m/s2."""
    host.run(0.2, command="run_normal")
    peak = 0.0
    for _ in range(20):
        host.run(0.1, lambda t: (900.0,) * 6)
        peak = max(peak, float(np.abs(server.plant.data.qacc[:3]).max()))
    assert host.reply.state == states.State.NORMAL and host.reply.errors == Error.WORKSPACE
    positions = server.plant.piston_positions()
    assert positions.min() > MACHINE.cylinder.cushion_length_m
    assert positions.max() < MACHINE.cylinder.stroke_m - MACHINE.cylinder.cushion_length_m
    assert peak < 12.0  # three axes at 3 m/s2, three rotations, and the oil's resonance


def test_a_flood_of_noise_does_not_stop_the_machine(server, host) -> None:
    """Seeded noise, damaged packets and a second host that shouts: the host in charge is still followed."""
    source = random.Random(5)
    flooder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    host.run(0.1, command="run_normal")
    start, good = (
        server.time_s,
        host_packet.HostCommand(sequence=9, time_s=1.0, setpoints=(0.1,) * 6, command="settle").pack(),
    )

    def wish(t: float):
        for k in range(20):
            data = bytearray(good) if k % 2 else bytearray(source.randbytes(source.randrange(0, 200)))
            if k % 4 == 1:
                data[source.randrange(len(data))] ^= 1 << source.randrange(8)
            flooder.sendto(bytes(data), server.address)
        return (0, 0, 0.02 * smooth(t - start), 0, 0, 0)

    with contextlib.closing(flooder):
        host.run(2.5, wish)
    assert host.reply.state == states.State.NORMAL
    assert host.reply.pose[2] == pytest.approx(0.02, abs=1.5e-3)
    assert server.link.counts["malformed"] > 500 and server.link.counts["other host"] > 500


def test_more_packets_than_a_tick_can_take(server) -> None:
    """Ten thousand packets at once: a tick takes 64 of them and goes on."""
    flooder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with contextlib.closing(flooder):
        for _ in range(10_000):
            flooder.sendto(b"\x00" * 72, server.address)
        server.tick()
        assert server.link.counts["received"] == 64
        for _ in range(20):
            server.tick()
    assert server.computer.state == states.State.NEUTRAL


def test_a_host_that_is_gone_is_survived(server) -> None:
    """Answers to a closed socket come back as errors of the operating system: the machine goes on."""
    gone = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    gone.sendto(host_packet.HostCommand(sequence=1, time_s=0.0, setpoints=(0.0,) * 6).pack(), server.address)
    gone.close()
    for _ in range(20):
        server.tick()
    assert server.ticks == 20


def test_it_binds_to_loopback_unless_told_otherwise(server) -> None:
    """The default address is 127.0.0.1; a port in use is a sentence."""
    assert server.address[0] == "127.0.0.1"
    with pytest.raises(HexsimError, match=r"cannot listen on 127.0.0.1:\d+: .*; give a free port"):
        serving.Server(MACHINE, port=server.address[1])


def test_real_time_is_kept_and_said() -> None:
    """Half a second of machine time takes at least half a second; the status tells margin and lag."""
    begin = time.perf_counter()
    status = serving.serve(MACHINE, port=0, duration_s=0.5, timestep=2e-4)
    assert time.perf_counter() - begin >= 0.5 - 0.002
    assert status.time_s == pytest.approx(0.5)
    assert status.margin > 1.0
    assert status.worst_behind_s >= 0.0 and status.state == "neutral"


def test_it_says_what_the_compensator_does(tmp_path) -> None:
    """A served bench with `adaptive` that has just begun: the line, the JSON and the summary of its folder give the reason why the
    leg is not compensated yet."""
    serve = ["serve", "--machine", "bench", "--port", "0", "--compensator", "adaptive", "--duration", "0.05"]
    line = CliRunner().invoke(app, serve, env={"COLUMNS": "1000"}).stdout
    assert "the leg's numbers are not known yet, at most" in line
    status = json.loads(CliRunner().invoke(app, [*serve, "--json", "--out", str(tmp_path / "run")]).stdout)
    (leg,) = status["compensation"]
    assert leg["reason"].endswith("the leg's numbers are not known yet") and not leg["engaged"]
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["compensation"] == [leg]


@pytest.mark.slow  # waits in real time; the cycle of states is below
def test_the_example_host_drives_the_machine(monkeypatch, capsys) -> None:
    """examples/host.py starts a machine, moves it and settles it."""
    example = Path(__file__).parents[1] / "examples" / "host.py"
    monkeypatch.setattr(sys, "argv", ["host.py", "--seconds", "0.5"])
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr().out
    assert "highest heave" in said and "settled at machine time" in said


def test_valve_delay_and_hysteresis_act_in_serve() -> None:
    """10 ms of delay and 0.2 V of hysteresis: the spools get the volts of five ticks ago through the play of 0.2 V."""
    effects = {"effects.valve_delay": {"delay_s": 0.01}, "effects.valve_hysteresis": {"half_width_V": 0.2}}
    with serving.Server(changed(MACHINE, effects), port=0, timestep=2e-4) as server:
        server.computer.command("run_manual", 0.0)
        commanded, spools = [], []
        for _ in range(400):
            server.tick()
            commanded.append(server.computer.valve.copy())
            spools.append(server.plant.data.ctrl[:6].copy())
    for i in range(6):
        expected = leg.valve_volts(np.concatenate([[0.0], np.array(commanded)[:, i]]), 0.2, 5)[1:]
        np.testing.assert_allclose(np.array(spools)[:, i], expected, atol=1e-12)
    assert np.abs(np.array(spools) - np.array(commanded)).max() > 0.1


def test_a_bench_reports_its_pose_and_its_reference() -> None:
    """A bench in mode 0: heave of 10 mm is followed, and the reply holds pose and reference in z, zeros elsewhere."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4) as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            host.run(0.1, command="run_normal")
            start = server.time_s
            host.run(2.0, lambda t: (0, 0, 0.01 * smooth(t - start), 0, 0, 0))
        assert host.reply.reference == pytest.approx((0, 0, 0.01, 0, 0, 0), abs=1e-6)
        assert host.reply.pose == pytest.approx((0, 0, 0.01, 0, 0, 0), abs=1.5e-3)


def ask(host, server, asked: compensator_packet.AskedCompensator) -> None:
    for packet in asked.packets():
        host.socket.sendto(packet, server.address)


def test_a_compensator_that_was_asked_for_twice_does_not_refuse_the_command_after_it() -> None:
    """Plain control asked for twice and run_normal wait in the socket together, as after a machine that compiled: all are
    taken, nothing is refused."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4) as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            host.run(0.1)
            for _ in range(2):
                ask(host, server, compensator_packet.AskedCompensator(leg=0, n_legs=1))
            host.run(0.1, command="run_normal")
        assert host.reply.state == states.State.NORMAL and not host.reply.refused


def test_a_served_run_leaves_a_folder_like_any_other(tmp_path: Path) -> None:
    """Half a second at rest and half a second of manual mode, of which 0.8 s are kept: log, configuration and summary
    are written; the log has every tick of them, its setpoints those of the motion computer."""
    with serving.Server(MACHINE, port=0, record_s=0.8) as server:
        for _ in range(250):
            server.tick()
        server.computer.command("run_manual", server.time_s)
        for _ in range(150):
            server.tick()
        setpoint = server.computer.setpoint.copy()
        for _ in range(100):
            server.tick()
        assert server.record is not None
        run = server.record.run()
    names = run_files.write_essentials(run, tmp_path, "parquet")
    assert {"log.parquet", "config.toml", "summary.json"} <= set(names)
    log = pl.read_parquet(tmp_path / "log.parquet")
    assert log.height == 400
    legs = [name for name in log.columns if name.startswith("setpoint")]
    assert log.select(legs).row(399) == pytest.approx(setpoint, abs=1e-12)


@pytest.mark.parametrize(
    "name", ["{folder}/evil.so", "evil_module:Evil", "foreign", "{folder}/learned.json", "", "os", "x" * 8000]
)
def test_a_packet_names_built_in_algorithms_alone(tmp_path: Path, monkeypatch, name: str) -> None:
    """A library, a module, what an installed package announces, a file and nonsense, asked for by the host: none is looked
    at, the machine stays in plain control and goes on, and the status counts the refusal with its reason."""
    loaded = []
    point = SimpleNamespace(name="foreign", load=lambda: loaded.append("foreign"))
    monkeypatch.setattr("compensation.registry._announced", lambda: {"foreign": point})
    monkeypatch.setattr("compensation.library.Library", lambda **how: loaded.append("library"))
    monkeypatch.setitem(sys.modules, "evil_module", None)
    monkeypatch.setattr("compensation.registry._import", loaded.append)
    asked = compensator_packet.AskedCompensator(leg=1, n_legs=1, name=name.format(folder=tmp_path), parameters={})
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4) as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            host.run(0.1)
            ask(host, server, asked)
            host.run(0.1)
            assert host.reply.refused and not host.reply.compensated
            assert server.compensator == "none" and loaded == []
            status = server.run(duration_s=0.0)
            assert any("no built-in compensator" in reason for reason in status.refused_orders)
            assert "refused 1 orders" in status.line() and len(status.line()) < 400


def test_nothing_is_made_while_the_machine_moves(monkeypatch) -> None:
    """To make a compensator takes longer than a tick: a host that asks for other ones all the time in normal state is
    refused, and none is made."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4) as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            host.run(0.1, command="run_normal")
            made = []
            monkeypatch.setattr(server.orders.asked, "_started", made.append)
            for k in range(20):
                asked = compensator_packet.AskedCompensator(leg=1, n_legs=1, name="adaptive", parameters={"k": k})
                ask(host, server, asked)
            host.run(0.1)
            assert host.reply.state == states.State.NORMAL and host.reply.refused and made == []


@pytest.mark.parametrize(
    "parameters", [{"a": None}, {"a": 1e308}, {"numbers": 5}, {"legs": "x"}, {"a": [[]]}, {"a": 10**300}]
)
def test_parameters_of_any_kind_are_survived(parameters) -> None:
    """Parameters that are not the algorithm's: taken or refused, and the machine ticks on."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4) as server:
        host = Host(server)
        with contextlib.closing(host.socket):
            host.run(0.1)
            ask(
                host,
                server,
                compensator_packet.AskedCompensator(leg=1, n_legs=1, name="adaptive", parameters=parameters),
            )
            host.run(0.1)
            assert host.reply.state == states.State.NEUTRAL


def test_a_new_host_takes_over_in_lockstep(monkeypatch) -> None:
    """The first host is gone and machine time stands still: a new host that sends 20 times a second is kept out for a second
    by the clock, then it is the host, and machine time goes on with its clock. The old one, back again, is refused."""
    now = [100.0]
    monkeypatch.setattr("hexsim.motion_computer.host_link.clock", SimpleNamespace(monotonic=lambda: now[0]))
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4, lockstep=True) as server:
        first, second = (Lockstep(server, now) for _ in range(2))
        with contextlib.closing(first.socket), contextlib.closing(second.socket):
            assert sum(first.exchange(0.05) for _ in range(20)) == 20
            stood = server.time_s
            answers = [second.exchange(0.05) for _ in range(60)]
            assert not any(answers[:19]) and all(answers[22:])
            assert server.time_s == pytest.approx(stood + 0.05 * (sum(answers) - 1), abs=1e-9)
            assert not first.exchange(0.05)


@pytest.mark.parametrize(("step_s", "exchanges"), [(0.04, 12), (0.05, 30)])
def test_a_host_that_begins_anew_in_lockstep_is_followed(monkeypatch, step_s: float, exchanges: int) -> None:
    """The same host starts again at once, with its clock and its counting at zero: machine time goes on, within a few packets
    where they are other ones, within a second by the clock where they are the same bytes once more."""
    now = [100.0]
    monkeypatch.setattr("hexsim.motion_computer.host_link.clock", SimpleNamespace(monotonic=lambda: now[0]))
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4, lockstep=True) as server:
        host = Lockstep(server, now)
        with contextlib.closing(host.socket):
            for _ in range(40):
                host.exchange(0.05)
            before = server.time_s
            host.sequence, host.time_s = 0, 0.0
            for _ in range(exchanges):
                host.exchange(step_s)
            assert server.time_s >= before + 6 * step_s


class Lockstep:
    """A host of a machine in lockstep; each exchange takes as long by the clock `now` as it asks the machine to run."""

    def __init__(self, server: serving.Server, now: list[float]) -> None:
        self.server, self.now, self.sequence, self.time_s = server, now, 0, 0.0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)

    def exchange(self, step_s: float) -> bool:
        """Whether the machine answers."""
        self.now[0] += step_s
        self.sequence, self.time_s = self.sequence + 1, self.time_s + step_s
        command = host_packet.HostCommand(sequence=self.sequence, time_s=self.time_s, setpoints=(0.0,) * 6)
        self.socket.sendto(command.pack(), self.server.address)
        self.server.follow()
        try:
            return isinstance(host_packet.unpack_reply(self.socket.recv(host_packet.REPLY.size)), host_packet.Reply)
        except TimeoutError:
            return False


def test_a_stranger_gets_no_answer_in_lockstep() -> None:
    """Noise and another host's packets: nothing is sent to the host in charge for them."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4, lockstep=True) as server:
        host, stranger = Lockstep(server, [0.0]), Lockstep(server, [0.0])
        with contextlib.closing(host.socket), contextlib.closing(stranger.socket):
            assert host.exchange(0.01)
            for data in (b"x", host_packet.HostCommand(sequence=5, time_s=9.0, setpoints=(0.0,) * 6).pack()):
                stranger.socket.sendto(data, server.address)
                server.follow()
            with pytest.raises(TimeoutError):
                host.socket.recv(host_packet.REPLY.size)


def test_what_waits_behind_a_pause_of_the_server_is_not_a_new_host() -> None:
    """The server stood still for longer than a host may be silent, with packets of a stranger before the host's in its
    socket: the host keeps the link."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4, lockstep=True) as server:
        host, stranger = Lockstep(server, [0.0]), Lockstep(server, [0.0])
        with contextlib.closing(host.socket), contextlib.closing(stranger.socket):
            assert host.exchange(0.01)
            server.link._heard_s -= 5.0
            stranger.socket.sendto(
                host_packet.HostCommand(sequence=5, time_s=9.0, setpoints=(0.0,) * 6).pack(), server.address
            )
            assert host.exchange(0.01)
            assert server.link.counts["other host"] == 1


def test_telemetry_without_a_host_is_not_kept() -> None:
    """A second of telemetry that nobody takes: at most the rows of a packet wait."""
    with serving.Server(load_machine("bench"), port=0, timestep=2e-4, telemetry=True) as server:
        for _ in range(500):
            server.tick()
        assert len(server.telemetry._rows) < 4


@pytest.mark.parametrize(
    ("signal_name", "more"),
    [
        ("SIGINT", ["--lockstep"]),
        pytest.param("SIGTERM", ["--from", "outsim"], marks=pytest.mark.slow),
        *(pytest.param(name, [], marks=pytest.mark.slow) for name in ("SIGINT", "SIGTERM")),
    ],
)
def test_the_first_signal_ends_serve(signal_name: str, more: list[str]) -> None:
    """Silent and flooded, in real time and in lockstep: the command ends by itself after one signal, with its status and
    code 0, and no traceback."""
    command = [sys.executable, "-m", "hexsim", "serve", "--machine", "bench", "--port", "0", *more]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert running.stderr is not None
        line = next(text for text in running.stderr if "listens on" in text)
        address = "127.0.0.1", int(line.split("127.0.0.1:")[1].split(",")[0])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flooder:
            for k in range(2000):
                flooder.sendto(
                    host_packet.HostCommand(sequence=k, time_s=0.5 * k, setpoints=(0.0,) * 6).pack(), address
                )
        running.send_signal(getattr(signal, signal_name))
        out, said = running.communicate(timeout=100.0)  # a tick that compiles ends first
    finally:
        running.kill()
        running.communicate()
    assert running.returncode == 0 and "at most" in out and "Traceback" not in said + out
