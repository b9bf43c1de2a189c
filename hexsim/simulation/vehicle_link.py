"""A simulator that knows no motion base drives the machine: its packets, through a washout, become setpoints.

The washout runs at the control rate with the newest packet's motion; its pose is a setpoint of this tick. The machine goes
to normal by itself once packets come and it stands in neutral. While packets fail, the vehicle is taken to move on evenly;
after `SILENT_S` nothing is sent any more, and the motion computer's host timeout follows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hexsim.cueing.protocols import Decode, VehicleMotion
from hexsim.cueing.washout import Cueing
from hexsim.motion_computer.host_buffer import HostBuffer
from hexsim.motion_computer.host_link import PACKETS_A_TICK, HostLink
from hexsim.motion_computer.host_packet import HostCommand, Reply

LARGEST_PACKET = 65_535
SILENT_S = 0.5


class VehicleLink(HostLink):
    """ready: whether the machine stands in neutral and may be told to run. late: seconds between packets, kept."""

    def __init__(
        self, host: str, port: int, buffer: HostBuffer, decode: Decode, cueing: Cueing, ready: Callable[[], bool]
    ) -> None:
        super().__init__(host, port, buffer)
        self.decode, self.cueing, self.ready = decode, cueing, ready
        self.motion: VehicleMotion | None = None
        self.pose = np.zeros(6)
        self._came_s, self._sequence, self._clock = -np.inf, 0, -np.inf

    @property
    def heard(self) -> bool:
        return self.motion is not None

    def receive(self, now_s: float) -> list[HostCommand]:
        """The washout's setpoint of this tick; none while no vehicle is heard."""
        for _ in range(PACKETS_A_TICK):
            try:
                data = self._socket.recv(LARGEST_PACKET)
            except BlockingIOError:
                break
            except OSError:
                continue
            self.counts["received"] += 1
            found = self.decode(data)
            if found is None:
                self.counts["malformed"] += 1
            elif found.time_s is None or found.time_s > self._clock or now_s - self._came_s > SILENT_S:
                self.motion, self._came_s = found, now_s
                self._clock = -np.inf if found.time_s is None else found.time_s
        if self.motion is None or now_s - self._came_s > SILENT_S:
            return []
        self.pose = self.cueing.step(self.motion.acceleration, self.motion.rates)
        self._sequence += 1
        event = "run_normal" if self.ready() else "none"
        pose = tuple(float(x) for x in self.pose)
        command = HostCommand(sequence=self._sequence % 2**32, time_s=now_s, setpoints=pose, command=event)
        self.buffer.add(command, now_s)
        return [command]

    def send(self, reply: Reply) -> None:
        """A vehicle takes no reply."""

    def send_packet(self, data: bytes) -> None:
        """Nor telemetry."""
