"""A host that drives a foreign machine: it dies, lies, floods and breaks, and the host ends in a sentence, soon."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from fake_machine import FakeMachine
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.identification import host as hosts
from hexsim.identification import link as links
from hexsim.identification import plan
from hexsim.machine import load_machine
from hexsim.motion_computer import host_limiter, states, telemetry

MACHINES = {name: load_machine(name) for name in ("bench", "micro_motion_system")}
SINE = {"duration_s": 4.0, "fade_s": 0.5, "fade": "smooth"}


def motion(machine, amplitude=0.03, frequency=0.5):
    """A heave of the machine, as packets."""
    signal = {"kind": "sine", "amplitude": amplitude, "frequency_Hz": frequency}
    own = (
        {"mode": "dof", "axes": {"z": signal}}
        if machine.is_hexapod
        else {"mode": "actuator", "axes": {"leg_1": signal}}
    )
    return host_limiter.setpoints_of(machine, SINE | own)


def drive(fake, machine, rows=None, patience_s=3.0):
    """Start, drive, and what came of it. patience_s: without a reply, the host's own."""
    with hosts.Host(fake.address, machine, patience_s=patience_s) as host:
        host.until(states.State.NEUTRAL, "start")
        try:
            return host.drive(motion(machine) if rows is None else rows)
        finally:
            host.settle()


@pytest.mark.parametrize("name", MACHINES)
def test_a_healthy_machine_is_driven_and_measured(name):
    """The fake without a fault: a log of the motion, at the rate that it says."""
    machine = MACHINES[name]
    with FakeMachine(machine) as fake:
        log = drive(fake, machine)
    assert len(log) == pytest.approx(4000, abs=20)
    column = "position_m" if name == "bench" else "position_3_m"
    assert np.ptp(log[column].to_numpy()) > 0.03


FAULTS = {
    "valve_open": "leg {leg} (does not follow|is at its end stop)",
    "valve_back": "leg {leg} (does not follow|is at its end stop)",
    "valve_shut": "leg {leg} does not follow its setpoint",
    "valve_creeps": "leg {leg} does not follow its setpoint",
    "at_end": "leg {leg} is at its end stop",
    "encoder_frozen": r"leg {leg}: its position reads .* without any change",
    "encoder_nan": "leg {leg}: its position reads nan",
    "encoder_jumps": "leg {leg} does not follow its setpoint",
    "supply": "the supply is at 7.0 bar, declared 70.0 bar",
    "pressure": "leg {leg}: its bottom pressure is 1.0 bar",
    "jolt": "the acceleration is",
    "other_setpoint": "the machine says that its setpoint is",
}


PLACES = (("bench", 0), ("micro_motion_system", 3))
DAILY = {("bench", fault, 1.0) for fault in FAULTS} | {("micro_motion_system", "valve_open", 1.75)}  # of six legs one


@pytest.mark.parametrize(
    ("fault", "name", "leg", "at_s"),
    [
        pytest.param(fault, name, leg, at_s, marks=() if (name, fault, at_s) in DAILY else pytest.mark.slow)
        for fault in FAULTS
        for name, leg in PLACES
        for at_s in (1.0, 1.75, 2.3)
    ],
)
def test_a_fault_of_a_machine_without_monitors_is_noticed(fault, name, leg, at_s):
    """Within 0.5 s of when the fault can be seen, in words that name leg and reading, whether it moves up, down
    or turns; what then leaves the host is within the limits."""
    machine = MACHINES[name]
    with FakeMachine(machine, fault=fault, leg=leg, at_s=at_s) as fake:
        with pytest.raises(hosts.MachineFault, match=FAULTS[fault].format(leg=leg + 1)):
            drive(fake, machine)
        assert fake.state == states.State.OFF
    assert fake.broke_s < fake.stopped_s <= (fake.visible_s or fake.stopped_s) + 0.5
    assert host_limiter.HostLimiter(machine).worst(np.array([row for _, row in fake.rows]))[0] <= 1.0 + 1e-5


@pytest.mark.parametrize(("gain", "delay"), [(0.5, 0), (2.0, 0), (1.0, 2)])
def test_a_machine_that_is_not_quite_as_declared_is_no_fault(gain, delay):
    """Half and twice the declared velocity gain, packets that act 20 ms late: what an identification is for."""
    machine = MACHINES["bench"]
    with FakeMachine(machine) as fake:
        fake.velocity_gain = gain * fake.velocity_gain
        step, late = fake._step, []

        def stepped(setpoint):
            late.append(setpoint)
            return step(late[max(len(late) - 1 - 10 * delay, 0)])

        fake._step = stepped
        assert len(drive(fake, machine, motion(machine, 0.06, 0.6))) > 3000


LIES = {
    "dies": "does not answer any more: nobody listens there",
    "silent": r"does not answer any more: silent for 3\.",
    "clock_nan": "a reply whose times are not finite",
    "clock_inf": "a reply whose times are not finite",
    "clock_negative": "clock reads -5 s, which is no time",
    "clock_still": "clock stands still at|clock runs backwards",
    "clock_jumps": "clock jumps from",
    "clock_back": "clock runs backwards",
    "flood": "floods the host",
    "state": "a reply with the unknown state 99",
    "version": "replies of protocol version 9, and this host speaks version 1",
    "short": "no reply of a motion computer: 50 bytes",
    "nonsense": "packets of 136 bytes that begin with|what answers at",
    "state_always": "what answers at .* is no machine that this host can drive: it sends a reply with the unknown state 99",
    "inf": "telemetry with readings beyond",
    "nan": "reads nan",
    "zero": "at its end stop",
    "same": "its bottom pressure is|the machine says that its setpoint is",
    "huge": "telemetry with readings beyond|outside its stroke",
    "no_telemetry": "no telemetry has come for 1 s",
}
REFUSED = {"clock_nan", "clock_inf", "state", "state_always", "version", "short", "nonsense"}  # every packet


@pytest.mark.parametrize("lockstep", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("lie", LIES)
def test_every_lie_ends_in_its_own_sentence_within_five_seconds(lie, lockstep):
    """Of the machine's time from the first packet that is wrong on, in lockstep and in real time, for which the computer must be idle.

    Whose packets are all refused is silent for the host: its patience of 3 s is waited for once.
    """
    machine = MACHINES["bench"]
    with FakeMachine(machine, lie=lie, at_s=0.2, lockstep=lockstep) as fake:
        with pytest.raises(HexsimError, match=LIES[lie]):
            drive(fake, machine, patience_s=1.0 if lockstep and lie in REFUSED else 3.0)
        assert fake.time_s < 5.0 + 0.2  # until it lies


@pytest.mark.parametrize("spread", [0.0, 1e-3])
def test_memory_stays_flat_under_a_flood(spread):
    """50,000 packets of telemetry, the same one and ever later ones: the link keeps a few hundred."""
    packet = telemetry.Telemetry(
        n_legs=1, sequence=0, time_s=0.0, rate_Hz=1000.0, rows=np.zeros((1, telemetry.width(1)))
    )
    link = links.Link(("127.0.0.1", 9), patience_s=3.0)
    try:
        for k in range(50_000):
            link._take(replace(packet, sequence=k, time_s=spread * k).pack())
        assert len(link.telemetry) <= links.PACKETS.read
    finally:
        link.close()


@pytest.mark.slow  # in real time; test_identify.py interrupts a machine in lockstep
@pytest.mark.parametrize(("number", "down_s"), [(signal.SIGINT, 0.0), (signal.SIGTERM, 1.5)])
def test_the_first_interrupt_lowers_the_machine_and_keeps_what_was_measured(number, down_s, tmp_path):
    """While a motion is driven in real time: the machine is asked to settle at once, the command ends when it is down,
    says so, the broken motion is on disk, and no setpoint left beyond the limits."""
    machine = MACHINES["bench"]
    with FakeMachine(machine, lockstep=False, down_s=down_s) as fake:
        address = f"{fake.address[0]}:{fake.address[1]}"
        command = [
            sys.executable,
            "-m",
            "hexsim",
            "identify",
            "bench",
            "--host",
            address,
            "--out",
            str(tmp_path / "out"),
        ]
        process = subprocess.Popen(
            command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=dict(os.environ)
        )
        end_s = time.monotonic() + 60.0
        while fake.moving_since_s is None or fake.time_s - fake.moving_since_s < 2.5:
            assert process.poll() is None and time.monotonic() < end_s, process.stderr.read()
            time.sleep(0.01)
        process.send_signal(number)
        _, said = process.communicate(timeout=60.0)
        assert fake.state == states.State.OFF
    assert process.returncode == 130 and "lowering the machine: up to 10 s" in said
    story = json.loads((tmp_path / "out" / "story.json").read_text())
    assert story["ended"] == "interrupted by the user"
    assert pl.read_parquet(tmp_path / "out" / "logs" / "broken_off.parquet")["time_s"][-1] > 1.5
    assert host_limiter.HostLimiter(machine).worst(np.array([row for _, row in fake.rows]))[0] <= 1.0 + 1e-5


def test_a_dry_run_draws_every_motion_and_drives_nothing(tmp_path):
    """Nobody listens: a picture of each motion, none beyond a third of a limit, and no packet is missed."""
    command = ["identify", "bench", "--dry-run", "--compensate", "--largest", "0.3", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, [*command, "--host", "127.0.0.1:9"])
    assert result.exit_code == 0 and "nothing was" in result.output
    names = ["heave_compensated", "heave_plain", "held_out", "held_out_2", "round_1", "small"]
    assert sorted(path.stem for path in (tmp_path / "out" / "motions").iterdir()) == names
    for rows in plan.planned(MACHINES["bench"], 0.3, compensate=True).values():
        assert 0.0 < host_limiter.HostLimiter(MACHINES["bench"]).share(rows) <= 0.3 + 1e-5
