"""The socket between host and machine: every wait ends by the host's own clock, every queue has an end.

What comes is hostile until it is checked. A reply is taken where it can be read and its clock can be right; telemetry
where it continues the telemetry before it. The newest packet that was not understood is kept in words: where nothing
else comes, the link ends in a sentence that says what came instead.
"""

from __future__ import annotations

import math
import select
import socket
import time as clock
from collections import deque
from typing import NamedTuple

from hexsim.errors import HexsimError
from hexsim.motion_computer.host_limiter import PERIOD_s
from hexsim.motion_computer.host_packet import REPLY_MAGIC, Reply, unpack_reply
from hexsim.motion_computer.telemetry import LARGEST_PACKET, MAGIC, Telemetry, unpack_telemetry


class Packets(NamedTuple):
    """Limits on a machine's packets."""

    refused_s: float = 0.05  # between two packets to it
    read: int = 512  # packets at most between two of the host's: a log of 10 kHz, a row a packet, sends 100
    # by which a machine's clock may run ahead of the host's between two replies: a server makes up for 1 s
    jump_s: float = 1.5


PACKETS = Packets()


class LinkLost(HexsimError):
    """The machine cannot be reached any more, or what answers cannot be a machine."""


class Link:
    """A connected UDP socket. reply: the newest that was taken; telemetry: what came since it was last emptied, the newest `read`.

    patience_s: without a reply, by the host's clock, until the link is lost.
    """

    def __init__(self, address: tuple[str, int], patience_s: float) -> None:
        self.address, self.patience_s = address, patience_s
        self.reply: Reply | None = None
        self.telemetry: deque[Telemetry] = deque(maxlen=PACKETS.read)
        self.instead = ""  # what came and could not be used, in words
        self._refusals = self._full = self._useless = 0
        self._heard_s = clock.monotonic()
        self._anchor = (0.0, 0, 0.0)  # own clock, sequence and machine time at which its clock was last seen to run
        self._rows_until_s = -math.inf
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.connect(address)  # so that a port nobody listens at is refused at once
        except OSError as error:
            self._socket.close()
            raise HexsimError(f"cannot reach {address[0]}:{address[1]}: {error}") from None

    def close(self) -> None:
        self._socket.close()

    @property
    def where(self) -> str:
        return f"{self.address[0]}:{self.address[1]}"

    def resume(self) -> None:
        """The host was busy with something else: silence counts from now on."""
        self._heard_s = clock.monotonic()
        if self.reply is not None:
            self._anchor = (self._heard_s, self.reply.sequence, self.reply.time_s)

    def send(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except ConnectionRefusedError:
            self._refused()
        except OSError as error:
            raise LinkLost(f"cannot send to {self.where}: {error}") from None

    def _refused(self) -> None:
        self._refusals += 1
        clock.sleep(PACKETS.refused_s)

    def receive(self, until_s: float, wanted: int | None = None) -> bool:
        """Read what comes until this time of the monotonic clock, or until the reply to the packet `wanted` is there.

        Raises LinkLost where the link is over: silence, a flood, a clock that cannot be right.
        """
        answered = False
        for _ in range(PACKETS.read):
            left_s = max(until_s - clock.monotonic(), 0.0)
            if not select.select([self._socket], [], [], left_s)[0]:
                self._full = 0
                break
            try:
                data = self._socket.recv(LARGEST_PACKET + 1)
            except OSError:  # nobody listens at the address
                self._refused()
                break
            self._refusals = 0
            answered = self._take(data) == wanted or answered
            if answered and wanted is not None:
                break
        else:
            self._full += 1
        self._check_alive()
        return answered

    def _check_alive(
        self,
        *,
        most_refusals: int = 6,  # in a row, of an address at which nobody listens
        most_full_reads: int = 50,  # so often in a row: a backlog in the socket is read in one
        most_unusable: float = 8 * PACKETS.read,  # of telemetry that nobody could use, more than was used
    ) -> None:
        silent_s = clock.monotonic() - self._heard_s
        if self._full >= most_full_reads or self._useless > most_unusable:
            raise LinkLost(
                f"the machine at {self.where} floods the host: more than {PACKETS.read} packets for each of the host's; mend its rate "
                "of telemetry"
            )
        if self._refusals < most_refusals and silent_s < self.patience_s:
            return
        instead = f"; what comes instead is {self.instead}" if self.instead else ""
        if self.reply is not None:
            gone = (
                "nobody listens there any more" if self._refusals >= most_refusals else f"silent for {silent_s:.1f} s"
            )
            raise LinkLost(
                f"the machine at {self.where} does not answer any more: {gone}, at machine time {self.reply.time_s:.2f} s"
                f"{instead}"
            )
        if self.instead:
            raise LinkLost(
                f"what answers at {self.where} is no machine that this host can drive: it sends {self.instead}"
            )
        raise LinkLost(
            f"no machine answers at {self.where}: start one with `hexsim serve --telemetry`, or give its address and port"
        )

    def _take(self, data: bytes) -> int | None:
        """Use a packet; the sequence of the reply that it is, if it is one."""
        if data[:4] == REPLY_MAGIC:
            reply = unpack_reply(data)
            if isinstance(reply, str):
                self.instead = reply
                return None
            return self._take_reply(reply)
        rows = unpack_telemetry(data)
        if isinstance(rows, Telemetry):
            self._take_telemetry(rows)
        elif data[:3] in (REPLY_MAGIC[:3], MAGIC[:3]) and data[:4] != MAGIC:
            kind = "replies" if data[:3] == REPLY_MAGIC[:3] else "telemetry"
            known = REPLY_MAGIC if kind == "replies" else MAGIC
            self.instead = (
                f"{kind} of protocol version {_text(data[3:4])}, and this host speaks version {_text(known[3:])}"
            )
        elif data[:4] == MAGIC:
            self.instead = rows
        else:
            self.instead = f"packets of {len(data)} bytes that begin with {_text(data[:4])!r}"
        return None

    def _take_reply(
        self,
        reply: Reply,
        *,
        still_share: float = 0.1,  # in so long a clock must advance at least by this share
        still_s: float = 1.0,  # in so long a clock must advance at least by this share
    ) -> int | None:
        now, before = clock.monotonic(), self.reply
        if reply.time_s < 0.0:
            raise LinkLost(
                f"the machine's clock reads {reply.time_s:g} s, which is no time: its log could not be trusted"
            )
        if before is None:
            self._anchor = (now, reply.sequence, reply.time_s)
        else:
            newer = _ahead(reply.sequence, before.sequence)
            if newer < 0:  # overtaken on the way
                return None
            anchor_s, anchor_sequence, anchor_time_s = self._anchor
            own_s, asked_s = now - anchor_s, PERIOD_s * _ahead(reply.sequence, anchor_sequence)
            ran_s = reply.time_s - anchor_time_s
            if reply.time_s < before.time_s:
                raise LinkLost(
                    f"the machine's clock runs backwards, from {before.time_s:g} to {reply.time_s:g} s: was it started anew?"
                )
            if ran_s > max(own_s, asked_s) + PACKETS.jump_s:
                raise LinkLost(
                    f"the machine's clock jumps from {before.time_s:g} to {reply.time_s:g} s: its log could not be trusted"
                )
            if min(own_s, asked_s) > still_s:
                if ran_s < still_share * min(own_s, asked_s):
                    raise LinkLost(
                        f"the machine's clock stands still at {reply.time_s:g} s, while the host's ran {own_s:.1f} s: it "
                        "answers, but nothing moves on"
                    )
                self._anchor = (now, reply.sequence, reply.time_s)
        self.reply, self._heard_s = reply, now
        return reply.sequence

    def _take_telemetry(
        self,
        rows: Telemetry,
        *,
        fastest_Hz: float = 20_000.0,  # of telemetry that is kept: no transducer of a motion system is read faster
    ) -> None:
        """Keep what continues the telemetry before it, on the machine's own clock: nothing grows without machine time."""
        self._useless += 1
        newest_s = self.reply.time_s if self.reply is not None else 0.0
        if rows.rate_Hz > fastest_Hz:
            self.instead = f"telemetry at {rows.rate_Hz:g} rows a second, at most {fastest_Hz:g} can be"
        elif not self._rows_until_s - 0.5 / rows.rate_Hz < rows.time_s <= newest_s + PACKETS.jump_s:
            if rows.time_s > newest_s:
                self.instead = (
                    f"telemetry of the time {rows.time_s:g} s, while the machine's clock reads {newest_s:g} s"
                )
        else:
            self._useless = max(self._useless - 2, 0)
            self._rows_until_s = rows.time_s + len(rows.rows) / rows.rate_Hz
            self.telemetry.append(rows)


def _text(data: bytes) -> str:
    return data.decode("ascii", "backslashreplace")


def _ahead(sequence: int, other: int) -> int:
    """By how much a sequence is ahead of another; it wraps."""
    return (sequence - other + 2**31) % 2**32 - 2**31
