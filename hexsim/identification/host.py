"""The host's end of the link: drives a machine by packets, watches it meanwhile, and collects its telemetry into a log.

In real time a packet goes out every `PERIOD_s`. Where the machine keeps in lockstep, the next goes out when the reply to
the last has come; a reply that does not come is asked for again. Every setpoint that leaves has passed `HostLimiter`.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections import deque
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np
import polars as pl
from numpy.typing import NDArray

from compensation.compensator import Parameters
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.identification.link import Link, LinkLost
from hexsim.identification.telemetry_log import log_of
from hexsim.identification.watch import Watch
from hexsim.motion_computer.compensator_packet import AskedCompensator
from hexsim.motion_computer.errors import labels
from hexsim.motion_computer.host_limiter import Gate, HostLimiter, PERIOD_s
from hexsim.motion_computer.host_packet import HostCommand, Reply
from hexsim.motion_computer.states import State
from hexsim.motion_computer.telemetry import Telemetry
from hexsim.packets import HOST_PORT

Array = NDArray[np.float64]
LATE_s = 2 * PERIOD_s  # by which the ends of a motion are known, in lockstep and live
LOCKED_SHARE = 0.002  # the same in lockstep, and of telemetry against the machine's own replies


class MachineFault(HexsimError):
    """The machine went into fault; the message says which errors it shows."""


class Stopped(MachineFault):
    """The host has stopped the machine, because of what it saw while it drove it."""


class Host:
    """A link to the machine at `address`, driven within the limits of its declaration, or a `largest` share of them.

    Without `machine` the host can start, settle and hold it at neutral, and moves nothing. `with Host(...) as host:`; closing
    it settles nothing, see `settle`. measured: the telemetry of a motion that is driven, or was broken off.
    """

    def __init__(
        self,
        address: tuple[str, int],
        machine: Machine | None = None,
        *,
        largest: float = 1.0,
        patience_s: float = 3.0,  # without a reply: the machine is gone. A lost packet or a busy computer take tenths of it
    ) -> None:
        self.machine = machine
        self.limiter = HostLimiter(machine, largest) if machine is not None else None
        self._gate = Gate(self.limiter)
        self._back: deque[Array] = deque()  # rows that lead to neutral
        self._link = Link(address, patience_s)
        self.time_s, self.sequence, self._lost = 0.0, 0, False
        self.measured: list[Telemetry] = []
        self._answered: Reply | None = None  # that was looked at last
        self._started = self._sent_s = clock.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._link.close()

    @property
    def address(self) -> tuple[str, int]:
        return self._link.address

    @property
    def reply(self) -> Reply | None:
        return self._link.reply

    def exchange(
        self,
        setpoints: Array | None = None,
        command: str = "none",
        *,
        skipped_s: float = 0.25,  # a longer silence of the host itself is not made up for
        answer_s: float = 0.5,  # a reply that takes longer is lost
    ) -> Reply:
        """Send one packet, `PERIOD_s` after the last by the host's clock, and return the newest reply.

        Without setpoints the last are held, or go on to neutral where a motion was broken off. Raises LinkLost where nobody
        answers or what answers is no machine, MachineFault where the machine is in fault, HexsimError for setpoints beyond
        the limits.
        """
        row = (self._back.popleft() if self._back else self._gate.sent[-1]) if setpoints is None else setpoints
        values = tuple(self._gate.let_out(row))
        packet = HostCommand(sequence=self.sequence, time_s=self.time_s, setpoints=values, command=command).pack()
        link, lockstep = self._link, self.reply is None or self.reply.lockstep
        now = clock.monotonic()
        if now - self._sent_s > skipped_s:
            link.resume()
        if now - self._due() > skipped_s:  # it was busy: what is past is not sent in a burst
            self._started += now - self._due() + PERIOD_s
        answered = False
        try:
            while not answered:
                link.send(packet)
                self._sent_s = clock.monotonic()
                until_s = self._sent_s + answer_s if lockstep else self._due()
                answered = link.receive(until_s, self.sequence % 2**32 if lockstep else None) or not lockstep
        except LinkLost:
            self._lost = True
            raise
        if not lockstep:
            clock.sleep(max(self._due() - clock.monotonic(), 0.0))
        asked, self.sequence = self.sequence, self.sequence + 1
        self.time_s += PERIOD_s
        reply = self.reply
        assert reply is not None
        if command != "none":  # in real time the answer to it comes packets later
            for _ in range(round(answer_s / PERIOD_s)):
                if (reply.sequence - asked) % 2**32 < 2**31:
                    break
                reply = self.exchange()
        if reply.state == State.FAULT and command != "reset":
            raise MachineFault(f"the machine is in fault: {', '.join(labels(reply.errors)) or 'it says no reason'}")
        if reply.refused and command != "none":
            raise HexsimError(f"the machine refuses {command} in state {reply.state.name.lower()}")
        return reply

    def _due(self) -> float:
        return self._started + (self.sequence + 1) * PERIOD_s

    def until(
        self,
        state: State,
        command: str = "none",
        within_s: float = 60.0,  # by the host's clock, in which a state must be reached
    ) -> None:
        """Give a command and wait until a state is reached and the machine has arrived, so long by the host's clock."""
        end_s = clock.monotonic() + within_s
        reply = self.exchange(command=command)
        while not (reply.state == state and reply.arrived):
            if clock.monotonic() > end_s:
                raise HexsimError(
                    f"the machine does not reach {state.name.lower()} within {within_s:g} s: it is in "
                    f"{reply.state.name.lower()}"
                )
            reply = self.exchange()

    def rest(
        self,
        *,
        rest_s: float = 2.0,  # at neutral: a log begins where the oil and the piston are at rest
    ) -> None:
        """Let what moves come to rest, on the machine and in its motion computer."""
        for _ in range(round(rest_s / PERIOD_s)):
            self.exchange()

    def settle(
        self,
        within_s: float = 10.0,  # in which a machine that is given up is lowered
    ) -> str:
        """Lower the machine; why it is not down after this time by the host's clock, or nothing.

        One that does not answer is asked all the same, and not waited for.
        """
        if self.reply is None or self.reply.state in (State.OFF, State.FAULT):
            return ""
        if self._lost:
            return self._farewell()
        try:
            if self.reply.state == State.SETTLING:
                self.until(State.OFF, within_s=within_s)
            else:
                self.until(State.OFF, "settle", within_s)
        except MachineFault:
            return ""  # it lowers itself
        except HexsimError as error:
            return f"{error}; its own timeout of the host must do the rest"
        return ""

    def _farewell(
        self,
        *,
        packets: int = 5,  # packets that ask a machine to settle which does not answer
    ) -> str:
        """Ask a machine to settle whose replies cannot be used, without waiting for any."""
        with contextlib.suppress(LinkLost):
            for _ in range(packets):
                row = tuple(self._gate.let_out(self._back.popleft() if self._back else self._gate.sent[-1]))
                packet = HostCommand(sequence=self.sequence, time_s=self.time_s, setpoints=row, command="settle")
                self._link.send(packet.pack())
                self.sequence, self.time_s = self.sequence + 1, self.time_s + PERIOD_s
                clock.sleep(PERIOD_s)
        return ""

    def compensate(
        self,
        name: str,
        learned: Sequence[Parameters],
        n_legs: int,
        *,
        most_requests: int = 300,  # times that a compensator is asked for
        answer_packets: int = 20,  # between two of them
        compile_s: float = 120.0,  # without a reply while a machine makes a compensator: it may compile it
    ) -> None:
        """Ask for a compensator that starts with what was learned, an entry a leg; "none": for plain control.

        Raises HexsimError where the machine refuses it, or does not take compensators by packets.
        """
        legs = enumerate(learned, start=1) if name != "none" else [(0, {})]
        asked = [AskedCompensator(leg=leg, n_legs=n_legs, name=name, parameters=own) for leg, own in legs]
        packets = [packet for one in asked for packet in one.packets()]
        patience_s, self._link.patience_s = self._link.patience_s, compile_s
        try:
            for _ in range(most_requests):
                for packet in packets:
                    self._link.send(packet)
                for _ in range(answer_packets):
                    reply = self.exchange()
                    if reply.refused:
                        raise HexsimError(f"the machine refuses the compensator {name}: its messages say why")
                    if reply.compensated == (name != "none"):
                        return
        finally:
            self._link.patience_s = patience_s
        raise HexsimError("the machine takes no compensator by packets (`motion_computer.compensator_packet`)")

    def drive(
        self,
        setpoints: Array,
        show: Callable[[float], None] = lambda share: None,
        *,
        clock_share: float = 0.02,  # by which machine time may run off the host's; a busy machine skips time
        late_live_s: float = 10 * PERIOD_s,  # by which the ends of a motion are known when it runs live
    ) -> pl.DataFrame:
        """Play setpoints (m, 6), a row a packet, from neutral and back to it; returns the log of the motion.

        They pass the limiter first. A motion that is broken off, by whatever is raised, goes on to neutral within the limits
        with the packets that follow. Raises Stopped for what the host sees while it drives, MachineFault, LinkLost, and
        HexsimError where the telemetry is missing, full of gaps, of another rate than it says, or no measurement.
        """
        rows = self.limiter.limit(setpoints) if self.limiter is not None else np.asarray(setpoints, dtype=float)
        watch = Watch(self.machine, self.limiter) if self.machine is not None and self.limiter is not None else None
        first = last = self.exchange(command="run_normal")
        self._link.telemetry.clear()
        self.measured.clear()
        before = self._gate.count
        try:
            for k, row in enumerate(rows):
                last = self.exchange(row)
                self._look(watch, row)
                if k % 100 == 0:
                    show(k / len(rows))
        except BaseException:
            if self.limiter is not None:
                self._back.extend(self.limiter.way_back(self._gate.sent, rows[self._gate.count - before :]))
            raise
        packets, self.measured = self.measured, []
        self.until(State.NEUTRAL, "return_neutral")  # before anything that takes time: a silent host is a fault
        log = log_of(packets, self.machine)
        commanded, ran = len(rows) * PERIOD_s, last.time_s - first.time_s
        late_s = LATE_s if last.lockstep else late_live_s
        check_clock("the machine's clock", ran, commanded, LOCKED_SHARE if last.lockstep else clock_share, late_s)
        check_clock("the telemetry's clock", float(log["time_s"][-1]), ran, LOCKED_SHARE, late_s)
        return log

    def _look(self, watch: Watch | None, row: Array) -> None:
        """Keep the telemetry that has come, and stop where the watch sees something."""
        new = list(self._link.telemetry)
        self._link.telemetry.clear()
        self.measured += new
        if watch is None:
            return
        watch.sent(row)
        answered, self._answered = self.reply is not self._answered, self.reply
        found = watch.silent(len(new) or not answered) or next(
            (words for packet in new if (words := watch.look(packet))), ""
        )
        if found:
            instead = f" (what comes instead is {self._link.instead})" if self._link.instead and not new else ""
            raise Stopped(f"the host has stopped the machine: {found}{instead}")


def check_clock(whose: str, ran_s: float, true_s: float, share: float, late_s: float = LATE_s) -> None:
    """Raises HexsimError where a clock has run off by more than `share` and what a packet may be late."""
    if abs(ran_s - true_s) > share * true_s + late_s:
        raise HexsimError(
            f"{whose} ran {ran_s:.2f} s while {true_s:.2f} s went by: its time stamps cannot be trusted; mend its clock "
            "or the rate that it says"
        )


def address_of(text: str) -> tuple[str, int]:
    """ADDRESS:PORT. Raises HexsimError for anything else."""
    name, _, port = text.rpartition(":")
    if not name or not port.isdecimal() or not 0 < int(port) < 65536:
        raise HexsimError(f"the host is {text!r}: give ADDRESS:PORT, such as 127.0.0.1:{HOST_PORT}")
    return name, int(port)
