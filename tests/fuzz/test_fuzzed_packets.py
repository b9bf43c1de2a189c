"""Packets of a host, of any content and at any time: nothing is raised, and the target stays a finite place."""

import numpy as np
from harness import MORE, fuzz, refused
from hypothesis import strategies as st
from mutations import numbers

from hexsim.motion_computer.host_buffer import HostBuffer
from hexsim.motion_computer.host_packet import (
    COMMAND,
    COMMAND_MAGIC,
    LARGEST,
    REPLY,
    REPLY_MAGIC,
    HostCommand,
    unpack_command,
    unpack_reply,
)

words = st.integers(0, 2**32 - 1)
halves = st.one_of(st.integers(0, 8), st.integers(0, 2**16 - 1))
floats = st.one_of(st.floats(-1.0, 1.0), numbers.map(float))


@st.composite
def packet(draw) -> bytes:
    """A command with odd fields, cut short, or bytes of any kind."""
    six = [draw(floats) for _ in range(6)]
    data = COMMAND.pack(
        COMMAND_MAGIC, draw(halves), draw(halves), draw(words), draw(st.sampled_from([0, 0, 1])), draw(floats), *six
    )
    return draw(st.one_of(st.just(data), st.binary(max_size=100), st.integers(0, 80).map(lambda n: (data * 2)[:n])))


@st.composite
def traffic(draw) -> list[tuple[float, HostCommand]]:
    """Commands with times and sequences that jump, stand still or run backwards, and when each arrives."""
    now, sent, sequence, out = 0.0, 0.0, draw(words), []
    for _ in range(draw(st.integers(1, 40))):
        now += draw(st.sampled_from([0.0, 1e-9, 0.002, 0.002, 0.5, 1.5]))
        sent += draw(st.sampled_from([0.002, 0.002, 0.0, -0.002, 1e-9, 0.9, 5.0, -1e9, 1e12]))
        sequence = (sequence + draw(st.sampled_from([1, 1, 1, 0, -1, 1000, 2**31]))) % 2**32
        place = tuple(draw(st.floats(-LARGEST, LARGEST)) for _ in range(6))
        out.append((now, HostCommand(sequence=sequence, time_s=sent, setpoints=place)))
    return out


@MORE
def test_packets_of_any_content(examples):
    """A command or None; a reply or one sentence."""

    def claim(data: bytes) -> None:
        command = unpack_command(data)
        assert command is None or unpack_command(command.pack()) == command
        refused(unpack_reply, data)

    fuzz(packet(), claim, examples)


@MORE
def test_replies_of_any_content(examples):
    """136 bytes that begin like a reply are one, or are said to be none."""
    body = st.binary(min_size=REPLY.size - 4, max_size=REPLY.size - 4)
    fuzz(body, lambda data: refused(unpack_reply, REPLY_MAGIC + data), examples)


@MORE
def test_traffic_of_any_timing(examples):
    """Whatever comes when, the target, its velocity and its acceleration are finite."""

    def claim(packets: list[tuple[float, HostCommand]]) -> None:
        buffer = HostBuffer()
        for now, command in packets:
            buffer.add(command, now)
            assert np.isfinite(buffer.target(now)).all()
        assert np.isfinite(buffer.target(packets[-1][0] + 10.0)).all()

    fuzz(traffic(), claim, examples)


def test_the_packets_above_reach_the_buffer():
    """Some of what is made here is accepted: the claims are not about refusals alone."""
    buffer = HostBuffer()
    command = HostCommand(sequence=1, time_s=0.0, setpoints=(0.0,) * 6)
    assert unpack_command(command.pack()) == command and buffer.add(command, 0.0)
