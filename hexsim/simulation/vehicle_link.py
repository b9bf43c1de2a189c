"""A simulator that knows no motion base drives the machine: its packets, through a washout, become setpoints.

The washout runs at the control rate with the newest packet's motion; its pose is a setpoint of this tick. The machine goes
to normal by itself once packets come and it stands in neutral. While single packets fail, the vehicle is taken to move on
evenly. After `SILENT_S` without one (a pause, a menu, a clock that stands still) its motion fades out within a second, so
that the washout brings the platform to neutral, where it waits; when packets return the motion fades in again. strict:
nothing is sent after `SILENT_S`, and the motion computer's host timeout follows, a fault.

A motion software's packets for a rig (`RigSetpoint`) are not washed out: each is a setpoint of the tick in which it comes,
as a host's own, and fades in and out in the same way. Of silence nothing is said in between, but that the last one holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hexsim.cueing.protocols import Decode, RigSetpoint, VehicleMotion
from hexsim.cueing.washout import Cueing
from hexsim.motion_computer.host_buffer import HostBuffer
from hexsim.motion_computer.host_link import HostLink
from hexsim.motion_computer.host_packet import HostCommand, Reply

SILENT_S = 0.5  # no simulator sends so seldom: without a packet for so long it is waited for


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A simulator. name: of its protocol, as typed. requests: packets that ask it for its own, sent to `address` while it is
    silent; farewell: those that end them."""

    decode: Decode
    name: str = "the protocol"
    strict: bool = False
    address: tuple[str, int] | None = None
    requests: tuple[bytes, ...] = ()
    farewell: tuple[bytes, ...] = ()


class VehicleLink(HostLink):
    """ready: whether the machine stands in neutral and may be told to run. say: takes messages. silent_s: since the last
    packet, infinite before the first one. share: of the vehicle's motion that is shown, 0 to 1."""

    largest = 65_535  # bytes of a packet

    def __init__(
        self,
        host: str,
        port: int,
        buffer: HostBuffer,
        vehicle: Vehicle,
        cueing: Cueing,
        ready: Callable[[], bool],
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        super().__init__(host, port, buffer)
        self.vehicle, self.cueing, self.ready, self.say = vehicle, cueing, ready, say
        self.protocol = vehicle.name
        self.counts["not newer"] = 0  # packets whose clock has not gone on
        self.motion: VehicleMotion | RigSetpoint | None = None
        self._is_new = False  # the motion came with this tick
        self.pose = np.zeros(6)
        self.silent_s, self.share, self._fade = np.inf, 0.0, 0.0
        self._came_s, self._asked_s, self._sequence, self._time_s = -np.inf, -np.inf, 0, -np.inf
        self._waits = False

    @property
    def heard(self) -> bool:
        return self.motion is not None

    def close(self) -> None:
        self._ask(self.vehicle.farewell)
        super().close()

    def receive(
        self,
        now_s: float,
        *,
        ask_again_s: float = 1.0,  # between two requests to a simulator that is silent
        hold_s: float = 0.1,  # without a rig's packet, then its last one counts in every tick: before the host's timeout of 0.25 s
    ) -> list[HostCommand]:
        """The washout's setpoint of this tick; none while no vehicle is heard, or, strictly, while it is silent."""
        self._is_new = False
        for data, sender in self._packets():
            found = self.vehicle.decode(data)
            if isinstance(found, str):
                self._not_understood(found)
            elif self.peer not in (None, sender) and now_s - self._came_s <= SILENT_S:
                self.counts["other host"] += 1
            else:
                self._take(found, sender, now_s)
        self.silent_s = now_s - self._came_s
        silent = self.silent_s > SILENT_S
        if silent and now_s - self._asked_s > ask_again_s:
            self._asked_s = now_s
            self._ask(self.vehicle.requests)
        if self.motion is None or (silent and self.vehicle.strict):
            return []
        self._note(silent)
        self._fade_on(silent)
        if isinstance(self.motion, RigSetpoint):
            holds = self.silent_s > hold_s
            return [self._command(self._of_rig(self.motion), now_s)] if self._is_new or holds else []
        return [self._command(self._of_vehicle(self.motion), now_s)]

    def _take(self, found: VehicleMotion | RigSetpoint, sender: Any, now_s: float) -> None:
        """The newest motion. A clock that stands still is a pause; one that runs backwards began anew, after a silence."""
        in_time = now_s - self._came_s <= SILENT_S
        time_s = found.time_s if isinstance(found, VehicleMotion) else None
        if time_s is not None and (time_s == self._time_s or (time_s < self._time_s and in_time)):
            self.counts["not newer"] += 1
            return
        self.motion, self._came_s, self.peer, self._is_new = found, now_s, sender, True
        self._time_s = -np.inf if time_s is None else time_s

    def _fade_on(self, silent: bool, fade_s: float = 1.0) -> None:
        """The share of this tick: a smooth step over a second.

        3 m/s2, as much as a washout scales a hard brake to, then changes by 4.5 m/s3 at most: as a foot on the pedal.
        """
        step = self.cueing.tick_s / fade_s
        self._fade = max(0.0, self._fade - step) if silent else min(1.0, self._fade + step)
        self.share = self._fade**2 * (3.0 - 2.0 * self._fade)

    def _of_vehicle(self, motion: VehicleMotion) -> tuple[float, ...]:
        """The pose that the washout gives."""
        self.pose = self.cueing.step(self.share * np.array(motion.acceleration), self.share * np.array(motion.rates))
        return tuple(float(x) for x in self.pose)

    def _of_rig(self, asked: RigSetpoint) -> tuple[float, ...]:
        """The setpoint as it came; unchanged once it has faded in."""
        self.pose = self.share * np.array(asked.values)
        return tuple(float(x) for x in self.pose)

    def _command(self, setpoints: tuple[float, ...], now_s: float) -> HostCommand:
        """The setpoint of this tick, which the buffer gets too."""
        self._sequence += 1
        command = HostCommand(
            sequence=self._sequence % 2**32,
            time_s=now_s,
            setpoints=setpoints,
            command="run_normal" if self.ready() else "none",
            mode=self.motion.mode if isinstance(self.motion, RigSetpoint) else 0,
        )
        self.buffer.add(command, now_s)
        return command

    def _note(self, silent: bool) -> None:
        """Say once that the simulator is silent, and that it is back."""
        if silent and not self._waits:
            self.say(f"no packets of {self.protocol} for {SILENT_S:g} s: to neutral, and wait for them")
        elif self._waits and not silent:
            self.say(f"packets of {self.protocol} again: the motion fades in")
        self._waits = silent

    def _ask(self, packets: tuple[bytes, ...]) -> None:
        """Send packets to the simulator's own address, if it has one."""
        if self.vehicle.address is None:
            return
        for data in packets:
            try:
                self._socket.sendto(data, self.vehicle.address)
            except OSError:
                self.counts["not sent"] += 1

    def send(self, reply: Reply) -> None:
        """A vehicle takes no reply."""

    def send_packet(self, data: bytes) -> None:
        """Nor telemetry."""
