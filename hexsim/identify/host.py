"""The host's end of the link: drives a machine by packets, and collects its telemetry into a log.

In real time a packet goes out every `PERIOD_s`. Where the machine keeps in lockstep, the next goes out when the reply to
the last has come; a reply that does not come is asked for again.
"""

from __future__ import annotations

import select
import socket
import time as clock
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Self

import numpy as np
import polars as pl
from numpy.typing import NDArray

from compensation.compensator import Parameters
from hexsim.errors import HexsimError
from hexsim.motion_computer.compensator_packet import AskedCompensator
from hexsim.motion_computer.errors import labels
from hexsim.motion_computer.host_packet import HostCommand, Reply, unpack_reply
from hexsim.motion_computer.states import State
from hexsim.motion_computer.telemetry import LARGEST_PACKET, Telemetry, unpack_telemetry
from hexsim.signals.table import table

Array = NDArray[np.float64]
PERIOD_s = 0.01
ANSWER_s = 0.5  # a reply that takes longer is lost
REFUSALS = 6  # in a row, of an address at which nobody listens
FIRST_TRIES, TRIES = 120, 600  # in lockstep: machine time stands still meanwhile, and a machine may have to compile
ASKED, ANSWERED = 300, 20  # times that a compensator is asked for (a machine may compile it), packets between them
REST_s = 2.0  # at neutral: a log begins where the oil and the piston are at rest
SKIPPED_s = 0.25  # a longer silence of the host itself is not made up for
SETTLED_s = 60.0  # machine time in which a state must be reached
LOST_SHARE = 0.05  # of the telemetry that may be lost in a run
CLOCK_SHARE = 0.02  # by which machine time may run off the host's; a busy machine skips time
LATE_s, LATE_LIVE_s = 2 * PERIOD_s, 10 * PERIOD_s  # by which the ends of a motion are known, in lockstep and live
LOCKED_SHARE = 0.002  # the same in lockstep, and of telemetry against the machine's own replies


class MachineFault(HexsimError):
    """The machine went into fault; the message says which errors it shows."""


class Host:
    """A link to the machine at `address`. `with Host(...) as host:`; closing it settles nothing, see `settle`."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(address)  # so that a port nobody listens at is refused at once
        self._refusals = 0
        self.address = address
        self.time_s, self.sequence = 0.0, 0
        self.reply: Reply | None = None
        self.telemetry: list[Telemetry] = []
        self._started = clock.perf_counter()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._socket.close()

    def exchange(self, setpoints: Array | None = None, command: str = "none") -> Reply:
        """Send one packet, `PERIOD_s` after the last by the host's clock, and return the newest reply.

        Raises HexsimError where nobody answers, MachineFault where the machine is in fault.
        """
        values = tuple(np.zeros(6) if setpoints is None else np.asarray(setpoints, dtype=float))
        packet = HostCommand(sequence=self.sequence, time_s=self.time_s, setpoints=values, command=command).pack()
        lockstep = self.reply is None or self.reply.lockstep
        behind_s = clock.perf_counter() - self._due()
        if behind_s > SKIPPED_s:  # it was busy: what is past is not sent in a burst
            self._started += behind_s + PERIOD_s
        for _ in range(TRIES if self.reply else FIRST_TRIES):
            self._send(packet)
            if self._receive(ANSWER_s if lockstep else max(self._due() - clock.perf_counter(), 0.0), lockstep):
                break
            if not lockstep:
                break
            if self._refusals >= REFUSALS:
                raise self._nobody()
        else:
            raise self._nobody()
        if not lockstep:
            clock.sleep(max(self._due() - clock.perf_counter(), 0.0))
        asked, self.sequence = self.sequence, self.sequence + 1
        self.time_s += PERIOD_s
        assert self.reply is not None
        if command != "none":  # in real time the answer to it comes packets later
            for _ in range(round(ANSWER_s / PERIOD_s)):
                if (self.reply.sequence - asked) % 2**32 < 2**31:
                    break
                self.exchange()
        if self.reply.state == State.FAULT and command != "reset":
            raise MachineFault(
                f"the machine is in fault: {', '.join(labels(self.reply.errors)) or 'it says no reason'}"
            )
        if self.reply.refused and command != "none":
            raise HexsimError(f"the machine refuses {command} in state {self.reply.state.name.lower()}")
        return self.reply

    def _nobody(self) -> HexsimError:
        return HexsimError(
            f"no machine answers at {self.address[0]}:{self.address[1]}: start one with `hexsim serve --telemetry`, or give "
            "its address and port"
        )

    def _due(self) -> float:
        return self._started + (self.sequence + 1) * PERIOD_s

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except ConnectionRefusedError:
            self._refusals += 1
        except OSError as error:
            raise HexsimError(f"cannot send to {self.address[0]}:{self.address[1]}: {error}") from None

    def _receive(self, timeout_s: float, until_reply: bool) -> bool:
        """Read what comes; True once the reply to the present packet is there."""
        end, answered = clock.perf_counter() + timeout_s, False
        while True:
            left = end - clock.perf_counter()
            if not select.select([self._socket], [], [], max(left, 0.0))[0]:
                return answered
            try:
                data = self._socket.recv(LARGEST_PACKET + 1)
            except OSError:  # nobody listens at the address
                self._refusals += 1
                return answered
            self._refusals = 0
            if isinstance(reply := unpack_reply(data), Reply):
                self.reply = reply
                answered = answered or self.reply.sequence == self.sequence % 2**32
                if answered and until_reply:
                    return True
            elif isinstance(rows := unpack_telemetry(data), Telemetry):
                self.telemetry.append(rows)

    def until(self, state: State, command: str = "none") -> None:
        """Give a command and wait until a state is reached and the machine has arrived."""
        reply = self.exchange(command=command)
        begin = reply.time_s
        while not (reply.state == state and reply.arrived):
            if reply.time_s - begin > SETTLED_s:
                raise HexsimError(
                    f"the machine does not reach {state.name.lower()}: it is in {reply.state.name.lower()}"
                )
            reply = self.exchange()

    def rest(self) -> None:
        """Let what moves come to rest, on the machine and in its motion computer."""
        for _ in range(round(REST_s / PERIOD_s)):
            self.exchange()

    def compensate(self, name: str, learned: Sequence[Parameters], n_legs: int) -> None:
        """Ask for a compensator that starts with what was learned, an entry a leg; "none": for plain control.

        Raises HexsimError where the machine refuses it, or does not take compensators by packets.
        """
        legs = enumerate(learned, start=1) if name != "none" else [(0, {})]
        packets = [AskedCompensator(leg=leg, n_legs=n_legs, name=name, parameters=own).pack() for leg, own in legs]
        for _ in range(ASKED):
            for packet in packets:
                self._send(packet)
            for _ in range(ANSWERED):
                reply = self.exchange()
                if reply.refused:
                    raise HexsimError(f"the machine refuses the compensator {name}: its messages say why")
                if reply.compensated == (name != "none"):
                    return
        raise HexsimError("the machine takes no compensator by packets (`motion_computer.compensator_packet`)")

    def drive(self, setpoints: Array, show: Callable[[float], None] = lambda share: None) -> pl.DataFrame:
        """Play setpoints (m, 6), a row a packet, from neutral and back to it; returns the log of the motion.

        Raises MachineFault, and HexsimError where the telemetry is missing, full of gaps, or of another rate than it says.
        """
        first = last = self.exchange(command="run_normal")
        self.telemetry.clear()
        for k, row in enumerate(setpoints):
            last = self.exchange(row)
            if k % 100 == 0:
                show(k / len(setpoints))
        packets = list(self.telemetry)
        self.until(State.NEUTRAL, "return_neutral")  # before anything that takes time: a silent host is a fault
        log = log_of(packets)
        commanded, ran = len(setpoints) * PERIOD_s, last.time_s - first.time_s
        late_s = LATE_s if last.lockstep else LATE_LIVE_s
        check_clock("the machine's clock", ran, commanded, LOCKED_SHARE if last.lockstep else CLOCK_SHARE, late_s)
        check_clock("the telemetry's clock", float(log["time_s"][-1]), ran, LOCKED_SHARE, late_s)
        return log


def check_clock(whose: str, ran_s: float, true_s: float, share: float, late_s: float = LATE_s) -> None:
    """Raises HexsimError where a clock has run off by more than `share` and what a packet may be late."""
    if abs(ran_s - true_s) > share * true_s + late_s:
        raise HexsimError(
            f"{whose} ran {ran_s:.2f} s while {true_s:.2f} s went by: its time stamps cannot be trusted; mend its clock "
            "or the rate that it says"
        )


def log_of(packets: list[Telemetry]) -> pl.DataFrame:
    """The log of telemetry packets: columns of the log format, a gap in time where packets were lost.

    Raises HexsimError where there is none, where too much is lost, or where times and rate contradict each other.
    """
    if not packets:
        raise HexsimError("the machine sends no telemetry: start it with `hexsim serve --telemetry`")
    newest: dict[int, Telemetry] = {packet.sequence: packet for packet in packets}
    kept = sorted(newest.values(), key=lambda packet: packet.time_s)
    n, rate = kept[0].n_legs, kept[0].rate_Hz
    if any(packet.n_legs != n or packet.rate_Hz != rate for packet in kept):
        raise HexsimError("the telemetry changes its number of legs or its rate in the middle of a run")
    time = np.concatenate([packet.time_s + np.arange(len(packet.rows)) / rate for packet in kept])
    rows = np.concatenate([packet.rows for packet in kept])
    following = [(one, other) for one, other in pairwise(kept) if (other.sequence - one.sequence) % 2**32 == 1]
    steps = [(other.time_s - one.time_s) / len(one.rows) for one, other in following]
    usual = float(np.median(steps)) if steps else 1.0 / rate
    if abs(usual * rate - 1.0) > CLOCK_SHARE:
        raise HexsimError(
            f"the telemetry says {rate:g} Hz, but its rows are {1e3 * usual:.3f} ms apart: its rate cannot be trusted; "
            "mend the rate or the time stamps"
        )
    expected = round((time[-1] - time[0]) * rate) + 1
    if len(time) < (1.0 - LOST_SHARE) * expected:
        raise HexsimError(
            f"{100 * (1 - len(time) / expected):.0f} % of the telemetry was lost, at most {100 * LOST_SHARE:g} % can be: "
            "use a nearer or a wired network"
        )
    return pl.DataFrame({"time_s": time - time[0]} | columns(rows, n))


def columns(rows: Array, n: int) -> dict[str, Array]:
    """Columns of the log format; sensors that the machine has not are left out."""
    parts = np.split(rows, [n, 2 * n, 3 * n, 4 * n, 5 * n, 5 * n + 1, 5 * n + 4], axis=1)
    stems = (
        "setpoint", "position", "pressure_bottom", "pressure_top", "valve", "pressure_supply", "acceleration",
        "angular_acceleration",
    )  # fmt: skip
    found = {}
    for stem, values in zip(stems, parts, strict=True):
        for name, value in zip(table()[stem].columns(n), values.T, strict=False):
            if not np.isnan(value).all():
                found[name] = np.ascontiguousarray(value)
    return found
