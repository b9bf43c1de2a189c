"""UDP link to the host: takes the commands of one host at a time, and answers it.

The host keeps the link until no valid packet has come for `NEW_SESSION_S`. Anything else is counted and ignored.
"""

from __future__ import annotations

import select
import socket
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.motion_computer.compensator_packet import LARGEST, AskedCompensator, unpack_asked
from hexsim.motion_computer.host_buffer import NEW_SESSION_S, HostBuffer
from hexsim.motion_computer.host_packet import HostCommand, Reply, unpack_command

PACKETS_A_TICK = 64  # the rest waits in the socket, or is dropped by it


class HostLink:
    """A UDP socket that never blocks. counts: received, malformed, other host, not sent. buffer: setpoints of the host.

    Raises HexsimError where the address cannot be had.
    """

    def __init__(self, host: str, port: int, buffer: HostBuffer) -> None:
        self.counts = {"received": 0, "malformed": 0, "other host": 0, "not sent": 0}
        self.buffer = buffer
        self.peer: Any = None  # address of the host
        self.asked: list[AskedCompensator] = []  # that it has asked for and nobody has taken yet
        self._silent_s = 0.0  # by the clock, where somebody waits: in lockstep machine time waits for packets
        self._socket = _bind(host, port)
        self.address = self._socket.getsockname()

    @property
    def heard(self) -> bool:
        """Whether anybody has sent a valid packet."""
        return self.peer is not None

    def close(self) -> None:
        self._socket.close()

    def receive(self, now_s: float) -> list[HostCommand]:
        """Valid commands of the host that came since the last tick; at most `PACKETS_A_TICK` packets are read."""
        taken = []
        for _ in range(PACKETS_A_TICK):
            try:
                data, sender = self._socket.recvfrom(LARGEST + 1)
            except BlockingIOError:
                break
            except OSError:  # an earlier reply could not be delivered
                continue
            self.counts["received"] += 1
            if sender == self.peer:
                self._silent_s = 0.0
            command = unpack_command(data)
            asked = unpack_asked(data) if sender == self.peer else None
            if asked is not None:
                self.asked.append(asked)
            elif command is None:
                self.counts["malformed"] += 1
            elif self.peer not in (None, sender) and not self._is_free(now_s):
                self.counts["other host"] += 1
            elif self.buffer.add(command, now_s):
                self.peer = sender
                taken.append(command)
        return taken

    def _is_free(self, now_s: float) -> bool:
        """Whether another host may take over; its first packet then begins a session."""
        if self._silent_s > NEW_SESSION_S:
            self.buffer.last_packet_s, self._silent_s = -np.inf, 0.0
        return now_s - self.buffer.last_packet_s > NEW_SESSION_S

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
        if not select.select([self._socket], [], [], timeout_s)[0]:
            self._silent_s += timeout_s


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
