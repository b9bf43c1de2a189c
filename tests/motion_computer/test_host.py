"""Host interface without a network: packets, the buffer that plays them, the limits that hold them."""

import random
import struct

import numpy as np
import pytest
from fake_machine import neutral_reply

from hexsim import HexsimError
from hexsim.machine import load_machine
from hexsim.motion_computer import host_packet, states
from hexsim.motion_computer import limits as motion_limits
from hexsim.motion_computer.errors import Error
from hexsim.motion_computer.host_buffer import HostBuffer

MACHINE = load_machine("micro_motion_system")
SIX = (0.01, -0.02, 0.03, 0.1, -0.2, 0.3)


def test_packets_have_their_documented_layout() -> None:
    """72 and 136 bytes; each field stands at its documented offset."""
    data = host_packet.HostCommand(sequence=7, time_s=1.5, setpoints=SIX, command="run_normal", mode=1).pack()
    assert (len(data), host_packet.REPLY.size) == (72, 136)
    assert data[:4] == b"HXC1"
    assert struct.unpack_from("<HHII", data, 4) == (3, 1, 7, 0)
    assert struct.unpack_from("<d6d", data, 16) == (1.5, *SIX)
    more = host_packet.HostCommand(
        sequence=7, time_s=1.5, setpoints=SIX, command="run_normal", mode=1, derivatives=(SIX[::-1], SIX)
    )
    assert len(more.pack()) == 168 and more.pack()[:4] == b"HXC2" and more.pack()[4:72] == data[4:]
    assert struct.unpack_from("<6d6d", more.pack(), 72) == (*SIX[::-1], *SIX)


def test_packets_survive_the_wire() -> None:
    """Packing and unpacking gives back the same command and the same reply."""
    command = host_packet.HostCommand(sequence=2**32 - 1, time_s=-3.0, setpoints=SIX, command="settle")
    assert host_packet.unpack_command(command.pack()) == command
    more = host_packet.HostCommand(sequence=3, time_s=0.5, setpoints=SIX, derivatives=(SIX[::-1], SIX))
    assert host_packet.unpack_command(more.pack()) == more
    reply = host_packet.Reply(
        state=states.State.FAULT,
        errors=Error.SENSOR | Error.WORKSPACE,
        sequence=9,
        arrived=True,
        refused=False,
        time_s=1.0,
        behind_s=0.25,
        age_s=0.01,
        pose=SIX,
        reference=SIX[::-1],
    )
    assert host_packet.unpack_reply(reply.pack()) == reply


def test_what_is_no_reply_is_said() -> None:
    """Another size, another version, a state that there is not, times that are not finite, poses that cannot be: each in its
    words, so that a host can tell a machine of another version from silence. A pose that is not known is no lie."""
    good = neutral_reply(pose=SIX, reference=SIX).pack()
    assert "3 bytes that begin with b'abc'; expected 136" in host_packet.unpack_reply(b"abc")
    assert "another version, b'HXS2'" in host_packet.unpack_reply(b"HXS2" + good[4:])
    assert "unknown state 77" in host_packet.unpack_reply(good[:4] + struct.pack("<H", 77) + good[6:])
    for value in (float("nan"), float("inf"), 1e300):
        for at, said in ((16, "times"), (24, "times"), (32, "times"), (40, "poses"), (128, "poses")):
            changed = host_packet.unpack_reply(good[:at] + struct.pack("<d", value) + good[at + 8 :])
            assert isinstance(changed, host_packet.Reply) if value != value and said == "poses" else said in changed


def test_what_is_no_command_is_said() -> None:
    """Wrong length, magic, number, mode, reserved field, NaN, infinite or absurd numbers: never an exception."""
    good = host_packet.HostCommand(sequence=1, time_s=0.0, setpoints=SIX).pack()
    bad = [
        good[:-1],
        good + b"x",
        b"",
        b"HXC2" + good[4:],
        good[:4] + b"\xff\xff" + good[6:],
        good[:6] + b"\x02\x00" + good[8:],
    ]
    bad.append(good[:12] + b"\x01" + good[13:])
    more = host_packet.HostCommand(sequence=1, time_s=0.0, setpoints=SIX, derivatives=(SIX, SIX)).pack()
    bad += [more[:-8], b"HXC1" + more[4:], more[:-8] + struct.pack("<d", float("nan")), more[:72] + b"\xff" * 96]
    for value in (float("nan"), float("inf"), -1e300):
        bad.append(host_packet.COMMAND.pack(b"HXC1", 0, 0, 1, 0, 0.0, *SIX[:5], value))
    bad.append(host_packet.COMMAND.pack(b"HXC1", 0, 0, 1, 0, float("nan"), *SIX))
    assert all(isinstance(host_packet.unpack_command(data), str) for data in bad)
    assert isinstance(host_packet.unpack_command(good), host_packet.HostCommand)


def test_random_bytes_never_raise() -> None:
    """Ten thousand packets of noise, and of single bits turned in good ones (seeded), are survived."""
    source = random.Random(1)
    buffer = HostBuffer()
    good = host_packet.HostCommand(sequence=1, time_s=0.5, setpoints=SIX).pack()
    for k in range(10_000):
        data = bytearray(good) if k % 2 else bytearray(source.randbytes(source.randrange(0, 160)))
        for _ in range(source.randrange(1, 4) if data else 0):
            data[source.randrange(len(data))] ^= 1 << source.randrange(8)
        command = host_packet.unpack_command(bytes(data))
        if isinstance(command, host_packet.HostCommand):
            buffer.add(command, k * 0.002)
        assert all(np.isfinite(part).all() for part in buffer.target(k * 0.002))


def played(packets, until=2.0, tick=0.002):
    """Targets at each tick from packets [(arrival_s, HostCommand)]."""
    buffer, waiting = HostBuffer(), sorted(packets, key=lambda packet: packet[0])
    times, targets = np.arange(0.0, until, tick), []
    for now in times:
        while waiting and waiting[0][0] <= now:
            buffer.add(waiting.pop(0)[1], now)
        targets.append(np.array(buffer.target(now)))
    return buffer, times, np.array(targets)


def sine_packets(rate_Hz, duration=2.0, amplitude=0.05, frequency=0.5):
    for k in range(int(duration * rate_Hz)):
        t = k / rate_Hz
        z = amplitude * np.sin(2 * np.pi * frequency * t)
        yield t, host_packet.HostCommand(sequence=k, time_s=100.0 + t, setpoints=(0.0, 0.0, z, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("rate_Hz", [60, 200, 500])
def test_a_sine_is_played_back_smooth_and_late_by_two_periods(rate_Hz: int) -> None:
    """The target is the sine moved by two packet periods, position within 20 um, velocity within 2 % of its peak."""
    buffer, times, targets = played(list(sine_packets(rate_Hz)))
    late = max(2.0 / rate_Hz, 0.004)
    assert buffer.delay_s == pytest.approx(late, rel=1e-6)
    inside = times > 0.2
    w = np.pi
    assert np.abs(targets[inside, 0, 2] - 0.05 * np.sin(w * (times[inside] - late))).max() < 20e-6
    assert np.abs(targets[inside, 1, 2] - 0.05 * w * np.cos(w * (times[inside] - late))).max() < 0.02 * 0.05 * w


def test_loss_reorder_and_doubles_change_little() -> None:
    """One packet in ten lost, one in ten doubled, one in ten 1.5 periods late (seeded): within 0.5 mm of the sine."""
    source, packets = random.Random(2), []
    for t, command in sine_packets(60):
        draw = source.random()
        if draw < 0.1:
            continue
        packets.append((t + (0.025 if draw < 0.2 else 0.0), command))
        if draw > 0.9:
            packets.append((t + 0.001, command))
    buffer, times, targets = played(packets)
    inside = times > 0.2
    sine = 0.05 * np.sin(np.pi * (times[inside] - buffer.delay_s))
    assert np.abs(targets[inside, 0, 2] - sine).max() < 5e-4
    assert buffer.counts["duplicate"] > 5
    steps = np.abs(np.diff(targets[inside, 0, 2]))
    assert steps.max() < 2 * 0.05 * np.pi * 0.002  # no jump: twice the peak velocity times a tick


def test_a_host_that_starts_anew_is_heard_again() -> None:
    """A new host, with another clock and sequence, is refused while the old one is heard and taken after a second."""
    buffer = HostBuffer()
    assert buffer.add(host_packet.HostCommand(sequence=500, time_s=10.0, setpoints=SIX), 0.0)
    assert not buffer.add(host_packet.HostCommand(sequence=0, time_s=0.0, setpoints=SIX), 0.5)
    assert buffer.add(host_packet.HostCommand(sequence=0, time_s=0.6, setpoints=SIX), 1.1)
    assert buffer.counts["sessions"] == 2


def test_the_sequence_wraps() -> None:
    """After 2**32 - 1 comes 0."""
    buffer = HostBuffer()
    assert buffer.add(host_packet.HostCommand(sequence=2**32 - 1, time_s=0.0, setpoints=SIX), 0.0)
    assert buffer.add(host_packet.HostCommand(sequence=0, time_s=0.01, setpoints=SIX), 0.01)


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize(("ahead_s", "sequences"), [(0.9, 0), (0.0, 1000), (0.0, 40), (0.9, 1000), (-0.9, 0), (1e6, 0)])
def test_one_wrong_packet_stands_in_the_way_of_no_more_than_three(ahead_s, sequences, first) -> None:
    """A valid packet with its time or its sequence far off, in a stream of 200 Hz or as its first: no more than three
    right packets are refused or doubled for it, and the target stays on the sine of 0.05 m to 1 mm."""
    packets = list(sine_packets(200))
    place = 0 if first else 200
    t, right = packets[place]
    wrong = host_packet.HostCommand(
        sequence=right.sequence + sequences, time_s=right.time_s + ahead_s, setpoints=right.setpoints
    )
    packets[place] = t, wrong
    buffer, times, targets = played(packets)
    assert buffer.counts["accepted"] >= len(packets) - 4
    late = times > (0.2 if first else 0.0) + 0.05
    sine = 0.05 * np.sin(np.pi * (times - buffer.delay_s))
    assert np.abs(targets[late, 0, 2] - sine[late]).max() < 1e-3


def test_a_stream_with_wrong_packets_is_heard_on_fuzzed() -> None:
    """Streams of 100 Hz in which one packet in twenty has a wrong time or sequence, of any size (20 seeds): nine tenths
    of the right ones are used, and no silence between two used ones lasts 0.1 s, far from the host's timeout."""
    for seed in range(20):
        source, buffer, used, right = random.Random(seed), HostBuffer(), [], 0
        for k in range(1000):
            time_s, sequence = 50.0 + 0.01 * k, k
            wrong = source.random() < 0.05
            if wrong and source.random() < 0.5:
                time_s += source.choice([-1, 1]) * 10 ** source.uniform(-2, 6)
            elif wrong:
                sequence += source.choice([-1, 1]) * round(10 ** source.uniform(1, 9))
            command = host_packet.HostCommand(sequence=sequence % 2**32, time_s=time_s, setpoints=SIX)
            right += not wrong
            if buffer.add(command, 0.01 * k) and not wrong:
                used.append(k)
            assert all(np.isfinite(part).all() for part in buffer.target(0.01 * k))
        assert len(used) > 0.9 * right, seed
        assert np.diff(used).max() < 10, seed


ONE_AXIS = {"excursion": 0.1, "velocity": 0.3, "acceleration": 3.0, "jerk": 300.0}


def run_limiter(target, duration=4.0, dt=0.002, limits=None):
    limits = limits or motion_limits.Limits(**{name: np.array([value]) for name, value in ONE_AXIS.items()})
    limiter, out = motion_limits.CommandLimiter(limits), []
    for t in np.arange(0, duration, dt):
        out.append(limiter.step(*(np.array([value]) for value in target(t)), dt)[0])
    out = np.array(out)
    velocity = np.diff(out) / dt
    return out, velocity, np.diff(velocity) / dt


def test_within_the_limits_a_command_passes_unchanged() -> None:
    """A sine of 0.05 m at 0.5 Hz, faded in from rest, comes out within 50 um: no lag.

    What is left is half a tick of jerk, divided by the follower's own w: 0.1 % of the amplitude.
    """

    def target(t):
        w, g = np.pi, min(t, 1.0)
        fade = g**3 * (10 - 15 * g + 6 * g**2)
        rate = 30 * g**2 * (1 - g) ** 2 * (t < 1)
        bend = 60 * g * (1 - g) * (1 - 2 * g) * (t < 1)
        s, c = 0.05 * np.sin(w * t), 0.05 * np.cos(w * t)
        return fade * s, rate * s + fade * w * c, bend * s + 2 * rate * w * c - fade * w * w * s

    out, _, _ = run_limiter(target)
    wanted = np.array([target(t + 0.002)[0] for t in np.arange(0, 4.0, 0.002)])
    assert np.abs(out - wanted).max() < 5e-5


@pytest.mark.parametrize("height", [0.05, 0.5, -3.0])
def test_a_step_is_smoothed_to_the_limits(height: float) -> None:
    """Whatever jump the host asks: velocity and acceleration within their limits and both used, never beyond the
    excursion, and the platform stands in the end."""
    out, velocity, acceleration = run_limiter(lambda t: (height, 0.0, 0.0))
    assert np.abs(velocity).max() <= 0.3 * (1 + 1e-9)
    assert np.abs(acceleration).max() <= 3.0 * 1.02  # a tick at the corner between two limits
    assert np.abs(acceleration).max() > 2.0
    assert np.abs(out).max() < 0.1
    assert abs(velocity[-1]) < 1e-4


def test_dof_limits_keep_every_single_motion_inside() -> None:
    """Each degree of freedom alone at its limit keeps all legs inside their strokes."""
    kinematics, limits = MACHINE.mechanics, motion_limits.dof_limits(MACHINE)
    for sign in (-1, 1):
        kinematics.check_trajectory(np.arange(6.0), sign * np.diag(limits.excursion))


def test_no_leg_is_sent_into_its_cushion() -> None:
    """Leg setpoints far outside are held clear of the cushions, monotonic; ones inside pass unchanged."""
    stroke, cushion = 0.2, 0.005
    asked = np.linspace(-0.5, 0.7, 2001)
    held, touched = motion_limits.soft_legs(asked, stroke, cushion)
    assert touched
    assert held.min() >= cushion + 0.005 - 1e-12 and held.max() <= stroke - cushion - 0.005 + 1e-12
    assert (np.diff(held) >= 0).all()
    same = (asked > 0.02) & (asked < 0.18)
    assert np.array_equal(held[same], asked[same])
    assert motion_limits.soft_legs(np.array([0.1, 0.15]), stroke, cushion)[1] is False


def test_limits_must_be_positive() -> None:
    """A limit of zero would lock the platform: refused with a sentence."""
    with pytest.raises(HexsimError, match=r"limits: velocity is .*; give a number above zero for each coordinate"):
        motion_limits.Limits(excursion=np.ones(6), velocity=np.zeros(6), acceleration=np.ones(6), jerk=np.ones(6))
