"""UDP link to the host: takes the commands of one host at a time, and answers it.

The host keeps the link until no packet of it was taken for `new_session_s`, by machine time or by this computer's clock:
in lockstep machine time waits for packets. Anything else is counted, with the reason, and ignored.
"""

from __future__ import annotations

import select
import socket
import time as clock
from collections.abc import Iterator
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.motion_computer.compensator_packet import LARGEST, AskedCompensator, Piece, Texts, is_asking, unpack_piece
from hexsim.motion_computer.host_buffer import PLAYING, HostBuffer
from hexsim.motion_computer.host_packet import HostCommand, Reply, unpack_command
from hexsim.packets import Refusals

# holds (212 kB by default, 0.8 kB each), so that none of the host's still waits behind a pause of this process


class HostLink:
    """A UDP socket that never blocks. counts: received, malformed, other host, not sent. buffer: setpoints of the host.

    refusals: why packets were not understood. spoke: whether the host in charge sent a valid packet at the last `receive`.
    Raises HexsimError where the address cannot be had.
    """

    protocol = "a host's protocol"
    largest = LARGEST + 1

    def __init__(self, host: str, port: int, buffer: HostBuffer) -> None:
        self.counts = {"received": 0, "malformed": 0, "other host": 0, "not sent": 0}
        self.refusals = Refusals()
        self.buffer = buffer
        self.peer: Any = None  # address of the host
        self.spoke = False
        self.asked: list[AskedCompensator] = []  # that it has asked for and nobody has taken yet
        self._texts = Texts()
        self._reads, self._heard_read, self._heard_s = (
            0,
            0,
            -np.inf,
        )  # of the peer's last packet, by this computer's clock
        self._socket = _bind(host, port)
        self.address = self._socket.getsockname()

    @property
    def heard(self) -> bool:
        """Whether anybody has sent a valid packet."""
        return self.peer is not None

    def close(self) -> None:
        self._socket.close()

    def receive(self, now_s: float) -> list[HostCommand]:
        """Valid commands of the host that came since the last tick; at most `packets_a_tick` packets are read."""
        taken, self.spoke = [], False
        for data, sender in self._packets():
            decoded = unpack_piece(data) if is_asking(data) else unpack_command(data)
            if isinstance(decoded, str):
                self._not_understood(decoded)
                continue
            is_free = self._is_free(now_s)
            if sender != self.peer and (isinstance(decoded, Piece) or not is_free):
                self.counts["other host"] += 1  # a compensator is for the host in charge to ask for
            elif isinstance(decoded, Piece):
                self._heard(sender)
                self._ask(self._texts.add(decoded))
            else:
                self.spoke = self.spoke or sender == self.peer
                if self.buffer.add(decoded, now_s):
                    self._heard(sender)
                    taken.append(decoded)
        return taken

    def _ask(self, found: AskedCompensator | str | None) -> None:
        """A leg's request that is whole, or why it is none."""
        if isinstance(found, str):
            self._not_understood(found)
        elif found is not None:
            self.asked.append(found)

    def _packets(
        self,
        *,
        packets_a_tick: int = 64,  # the rest waits in the socket, or is dropped by it
    ) -> Iterator[tuple[bytes, Any]]:
        """What waits in the socket with who sent it, at most `packets_a_tick`."""
        self._reads += 1
        for _ in range(packets_a_tick):
            try:
                packet = self._socket.recvfrom(self.largest)
            except BlockingIOError:
                return
            except OSError:  # an earlier reply could not be delivered
                continue
            self.counts["received"] += 1
            yield packet

    def _not_understood(self, reason: str) -> None:
        self.counts["malformed"] += 1
        self.refusals.note(reason)

    def _heard(self, sender: Any) -> None:
        if sender != self.peer:
            self._texts = Texts()
        self.peer, self.spoke = sender, True
        self._heard_s, self._heard_read = clock.monotonic(), self._reads

    @property
    def _peer_is_gone(self) -> bool:
        """By this computer's clock, and after 16 reads of the socket without its packets: 16 x 64 are more than a socket
        holds."""
        return clock.monotonic() - self._heard_s > PLAYING.new_session_s and self._reads - self._heard_read > 16

    def _is_free(self, now_s: float) -> bool:
        """Whether another host may take over; the first packet, whoever sends it, then begins a session."""
        if self.peer is not None and self._peer_is_gone:
            self.buffer.last_packet_s = -np.inf
        return self.peer is None or now_s - self.buffer.last_packet_s > PLAYING.new_session_s

    def send(self, reply: Reply) -> None:
        self.send_packet(reply.pack())

    def send_packet(self, data: bytes) -> None:
        """To the present host; a packet that the network does not take is counted."""
        try:
            self._socket.sendto(data, self.peer)
        except OSError:
            self.counts["not sent"] += 1

    def wait(self, timeout_s: float) -> None:
        """Until a packet is there, at most this long."""
        select.select([self._socket], [], [], timeout_s)


def _bind(host: str, port: int) -> socket.socket:
    made = None
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][0]
        made = socket.socket(family, socket.SOCK_DGRAM)
        made.bind((host, port))
    except (OSError, OverflowError) as error:
        if made is not None:
            made.close()
        raise HexsimError(
            f"cannot listen on {host}:{port}: {error}; give a free port or an address of this computer"
        ) from None
    made.setblocking(False)
    return made
