"""Packets of any content and at any time: every decoder gives a result or a reason and raises nothing, and the target
that a host's packets make stays a finite place."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_machine import neutral_reply
from harness import MORE, fuzz, refused
from hypothesis import strategies as st
from mutations import as_toml, mutated, numbers, texts, values

from hexsim.cueing import protocols, toml_protocol
from hexsim.motion_computer import compensator_packet, host_packet, states, telemetry
from hexsim.motion_computer.host_buffer import HostBuffer

SIX = (0.1,) * 6
ODD = [math.nan, math.inf, -math.inf, 1e30, -1e30, 1e-40, 0.0]
words = st.integers(0, 2**32 - 1)

VEHICLE_PACKETS = {
    "flightgear": [struct.pack(">I", version) + bytes(size - 4) for version, size in protocols.FDM_BYTES.items()],
    "xplane": [b"DATA*" + struct.pack("<i8f", 4, *SIX, 0, 0) + struct.pack("<i8f", 16, *SIX, 0, 0)],
    "xplane12": [b"DATA*" + struct.pack("<i8f", 4, *SIX, 0, 0) + struct.pack("<i8f", 16, *SIX, 0, 0)],
    "xplane-rref": [b"RREF," + b"".join(struct.pack("<if", k, 0.1) for k in range(1, len(protocols.RREF_NAMES) + 1))],
    "outsim": [bytes(64), bytes(68), *(b"LFST" + bytes(size - 4) for size in sorted(protocols.OUTSIM2_SIZES))],
    "beamng": [b"BNG1" + struct.pack("<21f", *[0.1] * 21)],
}
VEHICLE_PACKETS |= {"jsbsim": VEHICLE_PACKETS["flightgear"], "lfs": VEHICLE_PACKETS["outsim"]}
LAYOUT = toml_protocol.PacketLayout.model_validate(
    {
        "bytes": 40,
        "fields": {
            "time_s": {"type": "Q", "offset": 0},
            "up_m_s2": {"type": "f", "offset": 8, "factor": 1e300},
            "roll_rad_s": {"type": "d", "offset": 12},
            "left_m_s2": {"type": "h", "offset": 38, "zero": 3.0},
        },
    }
)
WIDE = toml_protocol.PacketLayout.model_validate(
    {
        "bytes": 10,
        "starts_with": "4d4f",
        "fields": {
            "up_m_s2": {"type": "i24", "offset": 2, "factor": 1e-4},
            "roll_rad_s": {"type": "u24", "offset": 5, "factor": 1e-6},
        },
    }
)
EXAMPLES = Path(__file__).parents[2] / "examples" / "protocols"
LEGS_TEXT = b",".join([b"32767"] * 6)
BRIDGE_JSON = json.dumps(
    {
        "ACCELERATION BODY X": 0.1,
        "ACCELERATION BODY Y": 0.1,
        "ACCELERATION BODY Z": 0.1,
        "PLANE BANK DEGREES": 0.1,
        "PLANE PITCH DEGREES": 0.1,
        "ROTATION VELOCITY BODY X": 0.1,
        "ROTATION VELOCITY BODY Y": 0.1,
        "ROTATION VELOCITY BODY Z": 0.1,
    }
).encode()
COMMAND = host_packet.HostCommand(sequence=1, time_s=0.5, setpoints=SIX, command="start")
MOVING = host_packet.HostCommand(sequence=1, time_s=0.5, setpoints=SIX, derivatives=(SIX, SIX))
REPLY = neutral_reply(state=states.State.NORMAL, sequence=1, time_s=1.0, pose=SIX, reference=SIX)
ASKED = compensator_packet.AskedCompensator(leg=1, n_legs=1, name="adaptive", parameters={"a": [1.0, None] * 200})
TELEMETRY = [
    telemetry.Telemetry(n_legs=n, sequence=1, time_s=0.0, rate_Hz=500.0, rows=np.full((m, telemetry.width(n)), 0.1))
    for n, m in ((1, 1), (6, 4))
]
DECODERS: dict[str, tuple[Callable[[bytes], Any], type, list[bytes]]] = {
    "command": (host_packet.unpack_command, host_packet.HostCommand, [COMMAND.pack(), MOVING.pack()]),
    "reply": (host_packet.unpack_reply, host_packet.Reply, [REPLY.pack()]),
    "telemetry": (telemetry.unpack_telemetry, telemetry.Telemetry, [one.pack() for one in TELEMETRY]),
    "compensator": (compensator_packet.unpack_piece, compensator_packet.Piece, ASKED.packets()),
    "TOML": (toml_protocol.TomlProtocol(LAYOUT), protocols.VehicleMotion, [bytes(40)]),
    "TOML, 24 bit": (toml_protocol.TomlProtocol(WIDE), protocols.VehicleMotion, [b"MO" + bytes(8)]),
    "TOML, text": (toml_protocol.protocol(str(EXAMPLES / "simtools.toml")), protocols.RigSetpoint, [LEGS_TEXT]),
    "TOML, JSON": (toml_protocol.protocol(str(EXAMPLES / "msfs.toml")), protocols.VehicleMotion, [BRIDGE_JSON]),
    **{name: (protocols.PROTOCOLS[name], protocols.VehicleMotion, good) for name, good in VEHICLE_PACKETS.items()},
}


@st.composite
def damaged(draw, good: list[bytes]) -> bytes:
    """Bytes of any kind; or a good packet with bytes changed, odd numbers put in at any place, cut short, made longer."""
    if draw(st.booleans()):
        return draw(st.one_of(st.binary(max_size=700), st.binary(max_size=80).map(lambda tail: good[0][:4] + tail)))
    data = bytearray(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(0, 4))):
        form = struct.Struct(draw(st.sampled_from("<>")) + draw(st.sampled_from("fd")))
        if draw(st.booleans()):
            data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
        elif len(data) >= form.size + 4:  # places of most protocols are even
            at = 4 * draw(st.integers(1, (len(data) - form.size) // 4))
            value = draw(st.sampled_from(ODD[:3] if form.format.endswith("f") else ODD))
            form.pack_into(data, at, value)
    size = draw(st.sampled_from([len(data)] * 6 + [len(data) - 1, len(data) + 1, 0, 5, 3 * len(data)]))
    return bytes(data * 3)[:size] if size > len(data) else bytes(data[:size])


def finite(decoded: Any) -> bool:
    """Whether every number that a decoder let through is finite (telemetry, and the poses of a reply: or not there)."""
    if isinstance(decoded, host_packet.Reply):
        poses = (*decoded.pose, *decoded.reference)
        return not np.isinf(poses).any() and finite((decoded.time_s, decoded.behind_s, decoded.age_s))
    if isinstance(decoded, telemetry.Telemetry):
        return not np.isinf(decoded.rows).any() and math.isfinite(decoded.time_s) and math.isfinite(decoded.rate_Hz)
    if isinstance(decoded, dict):
        return all(finite(one) for one in decoded.values())
    if isinstance(decoded, (list, tuple)):
        return all(finite(one) for one in decoded)
    if hasattr(decoded, "__dataclass_fields__"):
        return all(finite(getattr(decoded, name)) for name in decoded.__dataclass_fields__)
    return not isinstance(decoded, float) or math.isfinite(decoded)


@pytest.mark.parametrize("name", DECODERS)
@MORE
def test_a_decoder_gives_a_result_or_a_reason(name, examples):
    """Raw bytes, and good packets with changes: what the packet is, with finite numbers, or one short sentence of what it is
    not."""
    decode, kind, good = DECODERS[name]

    def claim(data: bytes) -> None:
        found = decode(data)
        if isinstance(found, str):
            assert 0 < len(found) < 300 and found.isprintable(), found
        else:
            assert isinstance(found, kind) and finite(found)

    fuzz(damaged(good), claim, examples)


@pytest.mark.parametrize("name", DECODERS)
def test_the_packets_that_are_mutated_are_good(name):
    """The claims are not about refusals alone: each packet that the mutations begin with is one of its protocol."""
    decode, kind, good = DECODERS[name]
    assert good and all(isinstance(decode(data), kind) for data in good)


@MORE
def test_bodies_of_any_json(examples):
    """A request for a compensator whose text is JSON of any kind, with numbers of any size and names of any sort."""
    tables = st.fixed_dictionaries({"compensator": st.one_of(texts, values), "parameters": values})
    raw = st.sampled_from([b"[" * 5000, b'{"a":' * 2000, b"1e999", b"NaN", b"9" * 5000, b"\xff\xfe", b'"\\ud800"', b""])
    body = st.one_of(tables.map(lambda table: json.dumps(table).encode()), raw, st.binary(max_size=60))

    def claim(text: bytes) -> None:
        texts, found = compensator_packet.Texts(), None
        for data in compensator_packet.in_pieces(1, 6, text):  # each piece of a text that is too long is refused
            piece = compensator_packet.unpack_piece(data)
            found = piece if isinstance(piece, str) else texts.add(piece)
        assert isinstance(found, str) or (found is not None and finite(found.parameters)) or not text

    fuzz(body, claim, examples)


@MORE
def test_pieces_in_any_order(examples):
    """Damaged pieces among those of two requests, in any order: no more than these two are put together, and nothing raises."""
    good = [
        ASKED,
        compensator_packet.AskedCompensator(leg=1, n_legs=1, name="none", parameters={"b": list(range(700))}),
    ]
    packets = [packet for one in good for packet in one.packets()]

    def claim(order: list[bytes]) -> None:
        texts = compensator_packet.Texts()
        for data in order:
            piece = compensator_packet.unpack_piece(data)
            found = piece if isinstance(piece, str) else texts.add(piece)
            assert found is None or isinstance(found, str) or found in good

    fuzz(st.lists(st.one_of(st.sampled_from(packets), damaged(packets)), max_size=20), claim, examples)


@MORE
def test_layouts_of_any_content(tmp_path, examples):
    """TOML files of packets, mutated: loaded, and then no packet raises, or refused in one sentence."""
    fields = {"time_s": {"type": "d", "offset": 0}, "up_m_s2": {"type": "f", "offset": 8, "factor": 2.0, "zero": 1.0}}
    kinds = [
        {"bytes": 40, "byte_order": "big", "fields": {**fields, "yaw_rad_s": {"type": kind, "offset": 12}}}
        for kind in (*toml_protocol.Type.__args__, "4s", "c", "", "P", "2f")
    ]
    path = tmp_path / "mine.toml"

    def claim(tables: dict[str, Any]) -> None:
        path.write_text(as_toml(tables), encoding="utf-8")

        def load() -> None:
            decode = toml_protocol.protocol(str(path))
            for data in (b"", bytes(40), b"\xff" * 40, b"\x7f\xf0" * 20):
                assert isinstance(decode(data), (str, protocols.VehicleMotion))

        refused(load)

    fuzz(mutated(kinds), claim, examples)


@st.composite
def traffic(draw) -> list[tuple[float, host_packet.HostCommand]]:
    """Commands with times and sequences that jump, stand still or run backwards, and when each arrives."""
    now, sent, sequence, out = 0.0, 0.0, draw(words), []
    for _ in range(draw(st.integers(1, 40))):
        now += draw(st.sampled_from([0.0, 1e-9, 0.002, 0.002, 0.5, 1.5]))
        sent += draw(st.sampled_from([0.002, 0.002, 0.0, -0.002, 1e-9, 0.9, 5.0, -1e9, 1e12]))
        sequence = (sequence + draw(st.sampled_from([1, 1, 1, 0, -1, 1000, 2**31]))) % 2**32
        place = tuple(draw(st.floats(-host_packet.LARGEST, host_packet.LARGEST)) for _ in range(6))
        out.append((now, host_packet.HostCommand(sequence=sequence, time_s=sent, setpoints=place)))
    return out


@MORE
def test_traffic_of_any_timing(examples):
    """Whatever comes when, the target, its velocity and its acceleration are finite."""

    def claim(packets: list[tuple[float, host_packet.HostCommand]]) -> None:
        buffer = HostBuffer()
        for now, command in packets:
            buffer.add(command, now)
            assert np.isfinite(buffer.target(now)).all()
        assert np.isfinite(buffer.target(packets[-1][0] + 10.0)).all()

    fuzz(traffic(), claim, examples)


@MORE
def test_commands_survive_the_way(examples):
    """What is packed is unpacked as it was, whatever the numbers are within their range; a number beyond it is refused."""
    place = st.lists(numbers.map(float), min_size=6, max_size=6)

    def claim(six: list[float]) -> None:
        command = host_packet.HostCommand(sequence=3, time_s=1.0, setpoints=tuple(six), derivatives=(tuple(six), SIX))
        found = host_packet.unpack_command(command.pack())
        assert found == command if all(abs(x) <= host_packet.LARGEST for x in six) else isinstance(found, str)

    fuzz(place, claim, examples)
