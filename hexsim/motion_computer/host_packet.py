"""The packets between host and motion computer: fixed size, little endian, no padding.

Command, host to machine, 72 bytes
    offset  type      field
    0       4 bytes   b"HXC1"
    4       uint16    command: 0 none, 1 start, 2 run_manual, 3 run_normal, 4 return_neutral, 5 settle, 6 reset
    6       uint16    mode: 0 degrees of freedom, 1 single actuators (read with run_normal)
    8       uint32    sequence, one more at each packet, wraps
    12      uint32    reserved, 0
    16      float64   time [s] of the setpoint, host's own clock, rising
    24      6 float64 setpoints: x y z [m] roll pitch yaw [rad] from neutral; mode 1: legs 1..6 [m] from mid stroke

The same with the derivatives of the setpoints, b"HXC2", 168 bytes
    72      6 float64 first derivatives of the setpoints [m/s, rad/s]
    120     6 float64 second derivatives [m/s2, rad/s2]

Reply, machine to host, 136 bytes, after each tick in which a valid command came
    0       4 bytes   b"HXS1"
    4       uint16    state: 0 off, 1 starting, 2 neutral, 3 manual, 4 normal, 5 settling, 6 fault
    6       uint16    errors, bits of `errors.Error`
    8       uint32    sequence of the newest command
    12      uint32    bit 0: arrived (neutral reached, or at rest); bit 1: the last command was refused; bit 2: machine
                      time follows the host's (lockstep); bit 3: telemetry is sent (`motion_computer.telemetry`);
                      bit 4: a compensator is in the loop (`motion_computer.compensator_packet`)
    16      float64   machine time [s]
    24      float64   lag behind real time [s]
    32      float64   age of the newest setpoint [s]
    40      6 float64 actual pose by the inverse axis transformation, x y z [m] roll pitch yaw [rad]
    88      6 float64 reference pose after limits, same units
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from hexsim.errors import HexsimError
from hexsim.motion_computer.computer import COMMANDS
from hexsim.motion_computer.errors import Error
from hexsim.motion_computer.states import State
from hexsim.packets import LARGEST, described

COMMAND = struct.Struct("<4sHHIId6d")
DERIVATIVES = struct.Struct("<6d6d")
REPLY = struct.Struct("<4sHHIIddd6d6d")
COMMAND_MAGIC, DERIVATIVES_MAGIC, REPLY_MAGIC = b"HXC1", b"HXC2", b"HXS1"
NUMBERS = ("none", *COMMANDS)
LATEST_S = 2.0**33  # of any clock, 272 years: a float64 still resolves it to 2 us
Six = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class HostCommand:
    """derivatives: first and second ones of the setpoints, where the host knows them."""

    sequence: int
    time_s: float
    setpoints: Six
    command: str = "none"
    mode: int = 0
    derivatives: tuple[Six, Six] | None = None

    def pack(self) -> bytes:
        if self.command not in NUMBERS:
            raise HexsimError(f"unknown command {self.command!r}: give one of {', '.join(NUMBERS)}")
        number = NUMBERS.index(self.command)
        magic = COMMAND_MAGIC if self.derivatives is None else DERIVATIVES_MAGIC
        packet = COMMAND.pack(magic, number, self.mode, self.sequence % 2**32, 0, self.time_s, *self.setpoints)
        if self.derivatives is None:
            return packet
        return packet + DERIVATIVES.pack(*self.derivatives[0], *self.derivatives[1])


def unpack_command(data: bytes) -> HostCommand | str:
    """The command, or why it is none, as text: size, magic, number, or values that are not finite. Never raises."""
    more = {COMMAND_MAGIC: 0, DERIVATIVES_MAGIC: DERIVATIVES.size}.get(data[:4])
    if more is None:
        return f"no command: {described(data)}"
    if len(data) != COMMAND.size + more:
        return f"{data[:4].decode()} of {len(data)} bytes (it has {COMMAND.size + more})"
    _, number, mode, sequence, reserved, time_s, *setpoints = COMMAND.unpack_from(data)
    changes = DERIVATIVES.unpack_from(data, COMMAND.size) if more else ()
    if number >= len(NUMBERS) or mode > 1 or reserved != 0:
        return "a command with an unknown number or mode"
    if not abs(time_s) <= LATEST_S:  # False for NaN too
        return "a command whose time is not finite or too large"
    if not all(abs(value) <= LARGEST for value in (*setpoints, *changes)):
        return f"a command with setpoints that are not finite or beyond {LARGEST:g} m or rad"
    return HostCommand(
        sequence=sequence,
        time_s=time_s,
        setpoints=tuple(setpoints),
        command=NUMBERS[number],
        mode=mode,
        derivatives=(changes[:6], changes[6:]) if more else None,
    )


@dataclass(frozen=True, kw_only=True)
class Reply:
    state: State
    errors: Error
    sequence: int
    arrived: bool
    refused: bool
    time_s: float
    behind_s: float
    age_s: float
    pose: Six
    reference: Six
    lockstep: bool = False
    telemetry: bool = False
    compensated: bool = False

    def pack(self) -> bytes:
        bits = (self.arrived, self.refused, self.lockstep, self.telemetry, self.compensated)
        flags = sum(int(bit) << k for k, bit in enumerate(bits))
        return REPLY.pack(
            REPLY_MAGIC,
            int(self.state),
            int(self.errors),
            self.sequence,
            flags,
            self.time_s,
            self.behind_s,
            self.age_s,
            *self.pose,
            *self.reference,
        )


def unpack_reply(data: bytes) -> Reply | str:
    """The reply, or why it is none, as text: size, magic, state, or values that are not finite. Never raises."""
    if data[:3] == REPLY_MAGIC[:3] and data[:4] != REPLY_MAGIC:
        return f"a reply of another version, {data[:4]!r}; this host speaks {REPLY_MAGIC!r}"
    if data[:4] != REPLY_MAGIC or len(data) != REPLY.size:
        return (
            f"no reply of a motion computer: {described(data)}; expected {REPLY.size} that begin with {REPLY_MAGIC!r}"
        )
    _, state, errors, sequence, flags, time_s, behind_s, age_s, *poses = REPLY.unpack(data)
    if state not in list(State):
        return f"a reply with the unknown state {state}"
    if not all(abs(value) <= LATEST_S for value in (time_s, behind_s, age_s)):
        return "a reply whose times are not finite or too large"
    if any(abs(value) > LARGEST for value in poses):  # not-a-number: a machine in fault may not know its pose
        return f"a reply with poses beyond {LARGEST:g} m or rad"
    return Reply(
        state=State(state),
        errors=Error(errors),
        sequence=sequence,
        arrived=bool(flags & 1),
        refused=bool(flags & 2),
        time_s=time_s,
        behind_s=behind_s,
        age_s=age_s,
        pose=tuple(poses[:6]),
        reference=tuple(poses[6:]),
        lockstep=bool(flags & 4),
        telemetry=bool(flags & 8),
        compensated=bool(flags & 16),
    )
