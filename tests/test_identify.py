"""A machine behind the host interface: telemetry, lockstep, the host's end, and what ends an identification."""

import json
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from fake_machine import neutral_reply
from typer.testing import CliRunner

import compensation
import hexsim as hx
from compensation import Context
from hexsim import HexsimError, load_scenario
from hexsim.cli import app
from hexsim.identification import bump, record, rounds
from hexsim.identification import host as hosts
from hexsim.identification import link as links
from hexsim.identification.telemetry_log import log_of
from hexsim.machine import load_machine
from hexsim.motion_computer import compensator_packet, host_limiter, states, telemetry
from hexsim.simulation import serve, simulate
from hexsim.simulation.asked_compensators import AskedCompensators

BENCH_HEAVE = {
    "mode": "actuator",
    "duration_s": 3.0,
    "fade_s": 1.0,
    "fade": "smooth",
    "axes": {"leg_1": {"kind": "sine", "amplitude": 0.03, "frequency_Hz": 0.5}},
}


def packet(sequence: int, time_s: float, rows: int = 2, n: int = 1, rate: float = 1000.0) -> telemetry.Telemetry:
    values = np.arange(rows * telemetry.width(n), dtype=float).reshape(rows, telemetry.width(n))
    return telemetry.Telemetry(n_legs=n, sequence=sequence, time_s=time_s, rate_Hz=rate, rows=values)


@pytest.fixture
def served():
    """A bench in lockstep, with telemetry, in a thread."""
    stop = threading.Event()
    with serve.Server(load_machine("bench"), port=0, telemetry=True, lockstep=True) as server:
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
    given = packet(7, 1.5, rows=telemetry.MOST_ROWS, n=n)
    found = telemetry.unpack_telemetry(given.pack())
    assert (found.n_legs, found.sequence, found.time_s, found.rate_Hz) == (n, 7, 1.5, 1000.0)
    np.testing.assert_array_equal(found.rows, given.rows)
    assert len(given.pack()) <= 1472


@pytest.mark.parametrize("spoil", [lambda d: d[:-1], lambda d: b"HXS1" + d[4:], lambda d: d[:6] + b"\x09\x00" + d[8:]])
def test_what_is_no_telemetry_is_none(spoil):
    """A cut packet, another magic and a wrong number of rows are refused."""
    assert isinstance(telemetry.unpack_telemetry(spoil(packet(0, 0.0).pack())), str)


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
        ([packet(k, 0.004 * k, rate=500.0, rows=4) for k in range(50)], "cannot be trusted"),
        ([packet(0, 0.0), packet(1, 0.002, rate=500.0)], "changes"),
    ],
)
def test_telemetry_that_cannot_be_used_is_refused(packets, says):
    """None, two thirds lost, a rate that the rows contradict, a rate that changes: a sentence each."""
    with pytest.raises(HexsimError, match=says):
        log_of(packets)


@pytest.mark.parametrize(("ran", "share"), [(20.1, 0.002), (19.9, 0.002), (21.0, 0.02)])
def test_a_clock_that_runs_off_is_refused(ran, share):
    """Beyond its share and two packets, to either side; within them it passes."""
    with pytest.raises(HexsimError, match="its time stamps cannot be trusted"):
        hosts.check_clock("the telemetry's clock", ran, 20.0, share)
    hosts.check_clock(
        "the telemetry's clock", 20.0 + 0.9 * (ran - 20.0) * (share * 20.0 + 0.02) / abs(ran - 20.0), 20.0, share
    )


def test_in_real_time_the_ends_of_a_motion_are_known_less_well():
    """A motion of 5.01 s of which 4.96 s of telemetry came, as measured on loopback: refused in lockstep, taken in real
    time; a clock 1 % off is still refused in a motion of 20 s."""
    with pytest.raises(HexsimError, match="its time stamps cannot be trusted"):
        hosts.check_clock("the telemetry's clock", 4.96, 5.01, hosts.LOCKED_SHARE, hosts.LATE_s)
    hosts.check_clock("the telemetry's clock", 4.96, 5.01, hosts.LOCKED_SHARE, 0.1)
    with pytest.raises(HexsimError, match="its time stamps cannot be trusted"):
        hosts.check_clock("the telemetry's clock", 20.2, 20.0, hosts.LOCKED_SHARE, 0.1)


LONG = compensator_packet.AskedCompensator(
    leg=2, n_legs=6, name="adaptive", parameters={"a": [k / 7.0 for k in range(350)], "b": {"c": 0.1}}
)


def test_a_request_in_pieces_is_what_was_packed():
    """Each piece fits an Ethernet frame (1472 bytes); put together in any order, with one that comes twice, the request is what
    was packed. A piece that is missing or of another text, changed bytes, another leg, version 1: nothing, or a reason."""

    def pieces_of(asked):
        return [
            piece
            for data in asked.packets()
            if isinstance(piece := compensator_packet.unpack_piece(data), compensator_packet.Piece)
        ]

    pieces, other = pieces_of(LONG), pieces_of(replace(LONG, name="none"))
    assert len(pieces) == 6 and max(len(data) for data in LONG.packets()) <= 1472
    texts = compensator_packet.Texts()
    found = [texts.add(pieces[k]) for k in (3, 0, 5, 5, 1, 4, 2)]
    assert found == [None] * 6 + [LONG]
    assert [texts.add(one) for one in (*pieces[:3], *other[3:], *pieces[3:])] == [None] * 9
    first = LONG.packets()[0]
    changed = [replace(pieces[0], part=pieces[0].part[:-1] + b"?"), *pieces[1:]]
    assert any("CRC-32" in str(texts.add(one)) for one in changed)
    heads = (b"HXC1" + first[4:8], b"HXP1" + first[4:8], first[:4] + b"\x07\x00\x06\x00", first[:8] + b"\x06")
    for spoilt in (first[:-1], *(head + first[len(head) :] for head in heads)):
        assert isinstance(compensator_packet.unpack_piece(spoilt), str)
    assert "another version" in str(compensator_packet.unpack_piece(b"HXP1" + first[4:]))


def test_what_a_machine_keeps_of_pieces_is_bounded():
    """Ten thousand first pieces of texts that never end: six legs and leg 0 keep at most one text each."""
    texts = compensator_packet.Texts()
    for k in range(10_000):
        piece = compensator_packet.Piece(
            leg=k % 7, n_legs=6, number=k % 27, size=compensator_packet.LONGEST, check=k, part=bytes(1200)
        )
        assert texts.add(piece) is None
    assert (
        sum(len(piece.part) for pieces in texts._pieces.values() for piece in pieces.values())
        <= 7 * compensator_packet.LONGEST
    )


def test_every_number_of_a_leg_fits_into_a_request():
    """Start parameters of `adaptive` with as many digits as a number may have: their text is whole after its pieces; one that is
    longer than a machine takes is refused where it is packed, and by the machine."""
    made = compensation.create("adaptive")
    longest = json.loads(
        json.dumps(made.parameters(made.start(Context()))), parse_float=lambda text: -1.2345678901234567e-100
    )
    asked, texts = (
        compensator_packet.AskedCompensator(leg=1, n_legs=1, name="adaptive", parameters=longest),
        compensator_packet.Texts(),
    )
    found = [
        texts.add(piece)
        for data in asked.packets()
        if isinstance(piece := compensator_packet.unpack_piece(data), compensator_packet.Piece)
    ]
    assert len(found) > 7 and found[-1] == asked
    with pytest.raises(HexsimError, match="a machine takes 32768"):
        replace(asked, parameters={"a": [0.1] * 8000}).packets()
    head = asked.packets()[0]
    assert "at most 32768" in str(
        compensator_packet.unpack_piece(head[:12] + (compensator_packet.LONGEST + 1).to_bytes(4, "little") + head[16:])
    )


def test_what_acts_and_is_asked_for_again_changes_nothing(monkeypatch):
    """Six legs: once all have come they are made, once; packets of the same again make nothing, until another is asked for."""
    made = compensation.create("adaptive")
    learned = made.parameters(made.start(Context()))
    asked = AskedCompensators(load_machine("micro_motion_system"))
    count = []
    monkeypatch.setattr(asked, "_started", lambda one: count.append(one.leg) or made)
    packets = [
        compensator_packet.AskedCompensator(leg=leg, n_legs=6, name="adaptive", parameters=learned)
        for leg in range(1, 7)
    ]
    found = [asked.take(one) for one in packets]
    assert found[:5] == [None] * 5 and len(found[5]) == 6
    asked.accept()
    assert [asked.take(one) for one in packets * 3] == [None] * 18 and count == [1, 2, 3, 4, 5, 6]
    packets[1] = compensator_packet.AskedCompensator(
        leg=2, n_legs=6, name="adaptive", parameters=learned | {"noise": [2e-6, 2e3]}
    )
    assert len([asked.take(one) for one in packets][-1]) == 6  # one leg's changed
    assert asked.take(compensator_packet.AskedCompensator(leg=0, n_legs=6, name="none", parameters={})) == []
    asked.accept()
    assert len([asked.take(one) for one in packets][-1]) == 6


def test_a_host_puts_a_compensator_into_the_loop_and_takes_it_out(served):
    """With what it learned elsewhere; a name with a module and parameters of another algorithm are refused, plain control stays."""
    made = compensation.create("adaptive")
    learned = made.parameters(made.start(Context()))
    asked = compensator_packet.AskedCompensator(leg=1, n_legs=1, name="adaptive", parameters=learned)
    assert [one.name for one in AskedCompensators(served.machine).take(asked) or []] == ["adaptive"]  # compiles it
    with hosts.Host(served.address) as host:
        host.exchange()
        for name, wrong in (
            ("os:system", learned),
            ("adaptive", {"numbers": {}}),
            ("adaptive", learned | {"numbers": 10**400}),
        ):
            with pytest.raises(HexsimError, match="refuses the compensator"):
                host.compensate(name, [wrong], 1)
        assert served.computer.compensators == []
        host.compensate("adaptive", [learned], 1)
        assert served.computer.learned()[0]["numbers"] == learned["numbers"]
        assert host.exchange().compensated
        host.compensate("none", [], 1)
        assert not host.exchange().compensated


def test_the_bump_is_the_worst_peak_from_the_second_reversal_on():
    """A sine with a bump of 0.3 m/s2 at each reversal and one of 0.8 at the first: 0.3 within what 50 Hz rounds off; lost
    samples are filled."""
    time = np.arange(0.0, 20.0, 1e-3)
    felt = 0.5 * np.sin(np.pi * time)
    for k in range(20):
        felt += (0.8 if k == round(bump.MOTION.fade_s) else 0.3) * (-1) ** k * np.exp(-(((time - k - 0.5) / 0.02) ** 2))
    log = pl.DataFrame({"time_s": time, "acceleration_m_s2": felt})
    for given in (log, log.filter(pl.int_range(pl.len()) % 97 != 5)):
        assert bump.worst(bump.taken_apart(load_machine("bench"), given)) == pytest.approx(0.3, abs=0.04)


def with_held_out(folder):
    """A folder in which the motions to judge on are measured already."""
    (folder / "logs").mkdir()
    for name in ("held_out", "held_out_2"):
        pl.DataFrame({"time_s": [0.0]}).write_parquet(folder / "logs" / f"{name}.parquet")
    return folder


def identified(served, folder, machine="bench", **options):
    """What `hx.identify` finds behind a served machine's packets."""
    return hx.identify(machine, folder, "{}:{}".format(*served.address), **options)


def test_an_interrupted_machine_is_lowered_though_the_display_raises(served, tmp_path, monkeypatch):
    """Ctrl-C while it moves, passed on by every later call of the display: the machine ends off, and the story says so."""
    monkeypatch.setattr(hosts.Host.settle, "__defaults__", (120.0,))  # s, of a computer that does other work, too
    calls = []

    def show(doing: str, share: float) -> None:
        calls.append(doing)
        if "measuring" in doing and share > 0.05:
            show.caught = True  # type: ignore[attr-defined]
        if getattr(show, "caught", False):
            raise KeyboardInterrupt

    story = identified(served, with_held_out(tmp_path), progress=show)
    assert story.ended == "interrupted by the user"
    assert calls[-1] == "lowering the machine"
    assert served.computer.state == states.State.OFF


SHORT_s = 6.0  # of a round


@pytest.fixture
def told_traces(monkeypatch):
    """Motions of SHORT_s. Traces and designs that are told: a tie after the first round, which the designed motion resolves; then no
    motion tells more."""
    known = []
    monkeypatch.setattr("hexsim.tracing.rules.MOTION_S", SHORT_s)
    monkeypatch.setitem(bump.start_parameters.__kwdefaults__, "bench_s", 4.0)  # of the twin's lesson

    def trace(folder, fit, held_out, out, tell):
        known.append([pl.read_parquet(path)["position_m"].to_numpy() for path in fit])
        return SimpleNamespace(
            predicted=(),
            verdict="explained",
            effects=[],
            report={},
            fitted=load_machine("bench"),
            ties=[],
            final=None,
            open=len(fit) < 2,
        )

    def design(result, duration_s, tell, *, may_load, largest):
        assert not may_load  # nobody is there to put one on
        tables = BENCH_HEAVE | {"name": "next-measurement"}
        promise = {"separations": [{"effects": ["a", "b"], "chi2": 500.0}], "numbers": [], "information": 0.0}
        return SimpleNamespace(tables=tables, purpose="to separate a, b", to_json=lambda: promise)

    monkeypatch.setattr(rounds, "trace", trace)
    monkeypatch.setattr(rounds, "next_measurement", design)
    monkeypatch.setattr(rounds, "open_points", lambda result: ["a or b"] if result.open else [])
    monkeypatch.setattr(bump, "start_parameters", lambda machine, show: [{}])
    return known


def test_the_designed_motion_is_measured_and_fitted_on(served, tmp_path, told_traces):
    """A tie after round 1: round 2 drives the designed sine, both logs are fitted on, and then it ends."""
    first = identified(served, with_held_out(tmp_path))
    assert first.rounds["purpose"].to_list() == ["a rich motion, to begin with", "to separate a, b"]
    assert [len(logs) for logs in told_traces] == [1, 2]
    commanded = np.ptp(host_limiter.setpoints_of(first.machine, BENCH_HEAVE)[:, 2])
    assert np.ptp(told_traces[1][1]) == pytest.approx(
        commanded, rel=0.15
    )  # its loop takes 8 % at 0.5 Hz, its dead band 2 mm
    assert first.ended == "explained: nothing is left to be told apart, and every number is sharp"
    assert served.computer.state == states.State.OFF
    assert json.loads((tmp_path / "compensator.json").read_text())["compensator"] == bump.ALGORITHM


@pytest.mark.slow  # a machine that is driven four times; whose folder is of another declaration is refused in a daily test
def test_a_folder_of_before_is_not_measured_anew(served, tmp_path, told_traces):
    """The same folder again measures nothing, and its machine time counts on."""
    before_s = identified(served, with_held_out(tmp_path)).story["machine_s"]
    time.sleep(1.3)  # until another host is listened to
    again = identified(served, tmp_path)
    assert len(again.rounds) == 2
    assert before_s < again.story["machine_s"] < before_s + 30.0  # up and down again


@pytest.mark.parametrize(("information", "runs"), [(0.69, True), (0.3, False), (float("-inf"), False)])
def test_a_machine_with_more_than_noise_left_is_measured_again_while_that_tells_something(information, runs):
    """Unexplained or partly explained: a run that halves the variances is worth it, one that leaves 0.86 of the errors is not; of
    an explained machine neither is."""
    design = {"separations": [], "numbers": [], "information": information}
    assert rounds.worth_a_run(design, more_is_left=True) == runs
    assert not rounds.worth_a_run(design, more_is_left=False)


@pytest.mark.slow
def test_machine_time_counts_though_the_host_was_killed(served, tmp_path, told_traces, monkeypatch):
    """Killed in the first trace, when nothing ends in order: the time of the motion is in the folder."""

    class Killed(BaseException):
        pass

    def killed(folder, fit, held_out, out, tell):
        raise Killed

    monkeypatch.setattr(rounds, "trace", killed)
    monkeypatch.setattr(rounds, "_settle", lambda *arguments: None)
    with pytest.raises(Killed):
        identified(served, with_held_out(tmp_path))
    assert json.loads((tmp_path / "story.json").read_text())["machine_s"] > SHORT_s


@pytest.mark.slow
def test_the_time_is_used(served, tmp_path, told_traces, monkeypatch):
    """Half a minute holds round 1 and no second of 10 s: it says so, with the tie in the story."""
    monkeypatch.setattr("hexsim.tracing.rules.MOTION_S", 10.0)
    story = identified(served, with_held_out(tmp_path), minutes=0.5)
    assert story.ended.startswith("the time is used")
    assert story.rounds["open"].to_list() == ["a or b"]


def test_a_fault_ends_it_with_what_was_kept(served, tmp_path):
    """The position is lost in the middle of a motion: a sentence, exit code 2, the logs before it are kept, and another
    declaration does not take the folder over."""
    read = served.sensors.read

    def broken(tick):
        position, *rest = read(tick)
        return (np.full_like(position, np.nan) if served.time_s > 3.0 else position, *rest)

    served.sensors.read = broken
    address = f"{served.address[0]}:{served.address[1]}"
    result = CliRunner().invoke(app, ["identify", "bench", "--host", address, "--out", str(with_held_out(tmp_path))])
    assert result.exit_code == 2
    assert "the machine is in fault: sensor fault" in " ".join(result.output.split())
    assert (tmp_path / "report.html").is_file()
    assert sorted(path.stem for path in (tmp_path / "logs").iterdir()) == ["broken_off", "held_out", "held_out_2"]
    kept = pl.read_parquet(tmp_path / "logs" / "broken_off.parquet")["time_s"]
    assert 0.3 < kept[-1] < 3.0  # what was measured until then
    with pytest.raises(HexsimError, match="of another declaration"):
        identified(served, tmp_path, "micro_motion_system")


@pytest.mark.slow
def test_another_host_takes_over_in_lockstep(served):
    """The first host is gone while the machine follows it: machine time stands still, and yet a second one gets in after a
    second of silence, lowers the machine, and starts it again."""
    with hosts.Host(served.address) as first:
        first.until(states.State.NEUTRAL)
        first.exchange(command="run_normal")
    time.sleep(1.3)
    with hosts.Host(served.address) as second:
        assert second.exchange().state == states.State.NORMAL
        second.until(states.State.NEUTRAL, "return_neutral")
        second.until(states.State.OFF, "settle")
        second.until(states.State.NEUTRAL, "start")


def test_nobody_there():
    """An address at which no machine answers is named."""
    with (
        hosts.Host(("127.0.0.1", 9)) as host,
        pytest.raises(HexsimError, match=r"no machine answers at 127\.0\.0\.1:9"),
    ):
        host.exchange()


@pytest.mark.parametrize("refused", [False, True])
def test_in_real_time_a_command_waits_for_its_own_answer(refused, monkeypatch):
    """Replies that come three packets late: whether a command was refused is judged by the reply that answers it."""
    answer = neutral_reply()
    asked = 20

    sent = []

    def late(link, until_s, wanted=None):
        newest = max(len(sent) - 4, 0)
        taken = newest >= asked
        state = states.State.NORMAL if taken and not refused else states.State.NEUTRAL
        link.reply = replace(answer, sequence=newest, state=state, refused=taken and refused)
        return True

    monkeypatch.setattr(links.Link, "receive", late)
    monkeypatch.setattr(links.Link, "send", lambda link, data: sent.append(data))
    monkeypatch.setattr(hosts.Host, "_due", lambda host: 0.0)
    with hosts.Host(("127.0.0.1", 9)) as host:
        for _ in range(asked):
            host.exchange()
        if refused:
            with pytest.raises(HexsimError, match="the machine refuses run_normal in state neutral"):
                host.exchange(command="run_normal")
        else:
            assert host.exchange(command="run_normal").state == states.State.NORMAL


def test_a_host_that_was_busy_sends_no_burst(monkeypatch):
    """Ten packets, ten seconds of silence, ten packets: in real time the last ten are as far apart as the first."""
    now, sent = [100.0], []
    monkeypatch.setattr("hexsim.identification.host.clock.monotonic", lambda: now[0])
    monkeypatch.setattr("hexsim.identification.host.clock.sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    monkeypatch.setattr(links.Link, "send", lambda link, data: sent.append(now[0]))
    monkeypatch.setattr(links.Link, "receive", lambda link, until_s, wanted=None: True)
    with hosts.Host(("127.0.0.1", 9)) as host:
        host._link.reply = neutral_reply()
        for silence_s in (0.0, 10.0):
            now[0] += silence_s
            for _ in range(10):
                host.exchange()
    np.testing.assert_allclose(np.diff(sent[10:]), host_limiter.PERIOD_s, atol=1e-9)
    assert sent[10] - sent[9] > 9.9


def test_a_driven_machine_sends_the_log_of_a_run(served):
    """Motion over packets in lockstep: positions within 0.2 mm of the same scenario run headless, once the delay of the
    host's buffer is taken off; every channel of a bench's log is there at the log rate."""
    machine = load_machine("bench")
    with hosts.Host(served.address, machine) as host:
        log = host.drive(host_limiter.setpoints_of(machine, BENCH_HEAVE))
    wanted = {"setpoint_m", "position_m", "pressure_bottom_Pa", "valve_V", "pressure_supply_Pa", "acceleration_m_s2"}
    assert wanted <= set(log.columns)
    time_s = log["time_s"].to_numpy()
    np.testing.assert_allclose(np.diff(time_s), 1.0 / machine.sensors.log_rate_Hz, atol=1e-9)
    scenario = load_scenario("heave", amplitude=0.03, duration_s=3.0)
    run = simulate(machine, replace(scenario, fade_s=1.0, fade="smooth"))
    reference, there = run.log["position_m"].to_numpy(), log["position_m"].to_numpy()
    inside = slice(0, int(1.9 * machine.sensors.log_rate_Hz))  # then the way back to neutral begins
    shifts = range(60)
    off = [np.abs(there[k:][inside] - reference[inside]).max() for k in shifts]
    assert min(off) < 2e-4
    assert int(np.argmin(off)) / machine.sensors.log_rate_Hz < 5 * host_limiter.PERIOD_s


def test_the_story_names_what_is_named(tmp_path):
    """One page: the effect with its number, a curve without a name left out, the error of each round in the picture."""
    error = {"held_out": {"position_m": {"declared": 9e-4, "refit": 8e-4, "with_effect": 4e-6, "noise": 3e-6}}}
    leak = {
        "name": "leakage_supply_to_chamber",
        "where": "leg 1",
        "parameters": {"conductance_m3_s_Pa": 2e-12},
        "standard_error": {"conductance_m3_s_Pa": 1e-14},
        "tied_with": [],
    }
    curve = {"name": None, "where": "leg 1"}
    only = record.Round(
        number=1,
        purpose="a rich motion",
        log="round_1",
        verdict="explained",
        sentences=(),
        effects=[leak, curve],
        error=error,
    )
    story = record.Story(machine=load_machine("bench"), folder=tmp_path, rounds=[only], ended="done", machine_s=72.0)
    page = (hx.Identification(story).to_folder() / "report.html").read_text(encoding="utf-8")
    assert "What the declared machine is missing: leakage supply to chamber (explained)." in page
    assert "1 round, 1.2 minutes" in page


def test_the_page_says_what_a_partly_explained_machine_keeps(tmp_path):
    """The rest that has no name stands beside the verdict and in the round's line; the verdict is said once; a bump that is no
    smaller is no 1/1."""
    found = {"name": "valve_hysteresis", "where": "leg 1", "parameters": {"half_width_V": 0.026}}
    left = (rounds.BESIDE,)
    only = record.Round(
        number=1, purpose="a rich motion", log="round_1", verdict="partly", sentences=left, effects=[found], error={}
    )
    ended = "no motion tells more"
    story = record.Story(machine=load_machine("bench"), folder=tmp_path, rounds=[only], ended=ended)
    page = (hx.Identification(story).to_folder() / "report.html").read_text(encoding="utf-8")
    assert "What the declared machine is missing: valve hysteresis (partly: a residual without a name remains)." in page
    assert f"It ended because: {ended}" in page
    assert rounds.BESIDE in page
    for after, words in ((0.454, "no smaller"), (0.2, "44%"), (0.04, "1/11")):
        both = SimpleNamespace(before=0.453, after=after)
        assert bump.Bump.share.fget(both).startswith(words)


def test_a_leg_that_does_not_follow_is_refused():
    """Against its setpoint, and a reading that never changes: the small motion ends in a sentence; one that follows passes."""
    setpoint = 0.1 + 0.01 * np.sin(np.linspace(0.0, 10.0, 500))
    for position in (0.2 - setpoint, np.full(500, 0.1)):
        with pytest.raises(HexsimError, match="position_m does not follow"):
            rounds.check_careful(pl.DataFrame({"setpoint_m": setpoint, "position_m": position}))
    rounds.check_careful(pl.DataFrame({"setpoint_m": setpoint, "position_m": np.roll(setpoint, 20)}))


def test_what_is_left_beside_names_asks_for_a_run():
    """Of a partly explained machine whose numbers are sharp the rest is open; of an explained one nothing is."""
    own = SimpleNamespace(
        name="leak", parameters=(SimpleNamespace(name="g", of_the_file=False, neutral=0.0, bounds=(0.0, 1.0)),)
    )
    leak = SimpleNamespace(
        candidate=SimpleNamespace(label="leak", effect=own), apart=(), values={"g": 2e-12}, standard_errors={"g": 1e-14}
    )
    known = {"predicted": (), "effects": [leak]}
    assert rounds.open_points(SimpleNamespace(verdict="explained", **known)) == []
    assert rounds.open_points(SimpleNamespace(verdict="partly", **known)) == [rounds.BESIDE]
    leak.standard_errors["g"] = 3e-13
    assert rounds.open_points(SimpleNamespace(verdict="partly", **known)) == [
        rounds.BESIDE,
        "g of leak is known to 15 %",
    ]


def test_what_follows_a_signal_at_the_noise_is_said():
    """Of a machine at its noise whose rest follows a signal, the rest is open, and no rival that is not there."""
    rest = SimpleNamespace(sentence="what is left of pressure follows itself by a curve")
    trace = SimpleNamespace(verdict="unexplained", predicted=(rest,), effects=[])
    assert rounds.open_points(trace) == [f"every channel is at its noise, and {rest.sentence}"]
