"""A machine behind the host interface: telemetry, lockstep, the host's end, and what ends an identification."""

import threading
import time

import numpy as np
import polars as pl
import pytest

from hexsim.errors import HexsimError
from hexsim.identify.host import Host, PERIOD_s, log_of
from hexsim.identify.rounds import Round, Story, check_careful, setpoints_of
from hexsim.identify.story import errors_by_kind, write_story
from hexsim.machine import load_machine
from hexsim.motion_computer.telemetry import MOST_ROWS, Telemetry, unpack_telemetry, width
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
from hexsim.simulation.serve import Server

BENCH_HEAVE = {
    "mode": "actuator", "duration_s": 3.0, "fade_s": 1.0, "fade": "smooth",
    "axes": {"leg_1": {"kind": "sine", "amplitude": 0.03, "frequency_Hz": 0.5}},
}  # fmt: skip


def packet(sequence: int, time_s: float, rows: int = 2, n: int = 1, rate: float = 1000.0) -> Telemetry:
    values = np.arange(rows * width(n), dtype=float).reshape(rows, width(n))
    return Telemetry(n_legs=n, sequence=sequence, time_s=time_s, rate_Hz=rate, rows=values)


@pytest.fixture
def served():
    """A bench in lockstep, with telemetry, in a thread."""
    stop = threading.Event()
    with Server(load_machine("bench"), port=0, telemetry=True, lockstep=True) as server:
        thread = threading.Thread(target=server.run, kwargs={"stop": stop})
        thread.start()
        try:
            yield server
        finally:
            stop.set()
            thread.join()


@pytest.mark.parametrize("n", [1, 6])
def test_a_telemetry_packet_is_what_was_packed(n):
    """Packing and unpacking is the identity; a packet of four rows fits a network's frame of 1,472 bytes."""
    given = packet(7, 1.5, rows=MOST_ROWS, n=n)
    found = unpack_telemetry(given.pack())
    assert (found.n_legs, found.sequence, found.time_s, found.rate_Hz) == (n, 7, 1.5, 1000.0)
    np.testing.assert_array_equal(found.rows, given.rows)
    assert len(given.pack()) <= 1472


@pytest.mark.parametrize("spoil", [lambda d: d[:-1], lambda d: b"HXS1" + d[4:], lambda d: d[:6] + b"\x09\x00" + d[8:]])
def test_what_is_no_telemetry_is_none(spoil):
    """A cut packet, another magic and a wrong number of rows are refused."""
    assert unpack_telemetry(spoil(packet(0, 0.0).pack())) is None


def test_lost_packets_are_a_gap():
    """One packet of fifty lost: its rows are missing in time and nothing else moves."""
    packets = [packet(k, 0.002 * k) for k in range(50) if k != 20]
    log = log_of(packets)
    assert len(log) == 98
    assert np.diff(log["time_s"].to_numpy()).max() == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("packets", "says"),
    [
        ([], "sends no telemetry"),
        ([packet(k, 0.002 * k) for k in range(0, 50, 3)], "lost"),
        ([packet(k, 0.004 * k, rate=1000.0, rows=1) for k in range(50)], "cannot be trusted"),
        ([packet(0, 0.0), packet(1, 0.002, rate=500.0)], "changes"),
    ],
)
def test_telemetry_that_cannot_be_used_is_refused(packets, says):
    """None, two thirds lost, a rate that the rows contradict, a rate that changes: a sentence each."""
    with pytest.raises(HexsimError, match=says):
        log_of(packets)


def test_nobody_there():
    """An address at which no machine answers is named."""
    with Host(("127.0.0.1", 9)) as host, pytest.raises(HexsimError, match=r"no machine answers at 127\.0\.0\.1:9"):
        host.exchange()


def test_a_driven_machine_sends_the_log_of_a_run(served):
    """Motion over packets in lockstep: positions within 0.2 mm of the same scenario run headless, once the delay of the
    host's buffer is taken off; every channel of a bench's log is there at the log rate; faster than real time."""
    machine = load_machine("bench")
    begun = time.perf_counter()
    with Host(served.address) as host:
        log = host.drive(setpoints_of(machine, BENCH_HEAVE))
        taken = time.perf_counter() - begun
        assert host.time_s / taken > 1.0
    wanted = {"setpoint_m", "position_m", "pressure_bottom_Pa", "valve_V", "pressure_supply_Pa", "acceleration_m_s2"}
    assert wanted <= set(log.columns)
    time_s = log["time_s"].to_numpy()
    np.testing.assert_allclose(np.diff(time_s), 1.0 / machine.sensors.log_rate_Hz, atol=1e-9)
    scenario = load_scenario("heave", amplitude=0.03, duration_s=3.0)
    from dataclasses import replace

    run = simulate(machine, replace(scenario, fade_s=1.0, fade="smooth"))
    reference, there = run.log["position_m"].to_numpy(), log["position_m"].to_numpy()
    inside = slice(0, int(1.9 * machine.sensors.log_rate_Hz))  # then the way back to neutral begins
    shifts = range(60)
    off = [np.abs(there[k:][inside] - reference[inside]).max() for k in shifts]
    assert min(off) < 2e-4
    assert int(np.argmin(off)) / machine.sensors.log_rate_Hz < 5 * PERIOD_s


def test_the_story_names_what_is_named(tmp_path):
    """One page: the effect with its number, a curve without a name left out, the error of each round in the picture."""
    error = {"held_out": {"position_m": {"declared": 9e-4, "refit": 8e-4, "with_effect": 4e-6, "noise": 3e-6}}}
    leak = {
        "name": "leakage_supply_to_chamber", "where": "leg 1", "parameters": {"conductance_m3_s_Pa": 2e-12},
        "standard_error": {"conductance_m3_s_Pa": 1e-14}, "tied_with": [],
    }  # fmt: skip
    curve = {"name": None, "where": "leg 1"}
    only = Round(
        number=1,
        purpose="a rich motion",
        log="round_1",
        verdict="explained",
        sentences=(),
        effects=[leak, curve],
        error=error,
    )
    story = Story(machine=load_machine("bench"), folder=tmp_path, rounds=[only], ended="done", machine_s=72.0)
    page = write_story(story).read_text(encoding="utf-8")
    assert "What the declared machine lacks: leakage supply to chamber (explained)." in page
    assert "1 round, 1.2 minutes" in page
    assert errors_by_kind(error, "declared") == {"position_m": pytest.approx(300.0)}


def test_a_leg_that_does_not_follow_is_refused():
    """Against its setpoint, and a reading that never changes: the small motion ends in a sentence; one that follows passes."""
    setpoint = 0.1 + 0.01 * np.sin(np.linspace(0.0, 10.0, 500))
    machine = load_machine("bench")
    for position in (0.2 - setpoint, np.full(500, 0.1)):
        with pytest.raises(HexsimError, match="position_m does not follow"):
            check_careful(machine, pl.DataFrame({"setpoint_m": setpoint, "position_m": position}))
    check_careful(machine, pl.DataFrame({"setpoint_m": setpoint, "position_m": np.roll(setpoint, 20)}))
