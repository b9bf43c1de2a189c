# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The machine in real time: plant, motion computer and host interface, one control tick after the other.

    serve(machine)      states by the host's commands, setpoints over UDP (packets: `motion_computer.host_packet`)

The plant is the tendon model with RK4. Whoever sends nonsense, or far too much, is counted and otherwise ignored; one
host at a time is heard, until it has been silent for a second. Binds to loopback unless told otherwise.
"""

from __future__ import annotations

import contextlib
import socket
import time as clock
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import Error, Finding, labels
from hexsim.motion_computer.host_buffer import NEW_SESSION_S, HostBuffer
from hexsim.motion_computer.host_packet import COMMAND, HostCommand, Reply, unpack_command
from hexsim.motion_computer.limits import CommandLimiter, Limits, dof_limits, leg_limits, soft_legs
from hexsim.motion_computer.states import State
from hexsim.plant import Plant
from hexsim.scenarios import Scenario, load_scenario
from hexsim.sensors.bank import SensorBank
from hexsim.simulation.emergency_supply import EmergencySupply
from hexsim.simulation.manual import SignalGenerator
from hexsim.simulation.simulation import make_compensators

Array = NDArray[np.float64]
PORT = 47110
PACKETS_A_TICK = 64  # more than this stay in the socket until the next tick, or are dropped by it
NOISE_S = 10.0  # sensor noise is drawn for this long and then repeats
WAIT_AT_MOST_S = 0.25  # further behind real time than this is not made up for


class LiveSensors:
    """A sensor bank at the control rate, for as long as it lasts: noise repeats, delays in whole control ticks."""

    def __init__(self, plant: Plant, tick_s: float, seed: int) -> None:
        self.ticks = round(NOISE_S / tick_s)
        self.bank = SensorBank(plant.resolved, self.ticks, tick_s, seed)
        delays = np.concatenate([self.bank["position"].delay, self.bank["pressure_bottom"].delay])
        self._late = np.rint(delays / tick_s).astype(int)
        self._past: deque[Array] = deque(maxlen=int(self._late.max()) + 1)

    def read(self, tick: int, positions: Array, pressures: Array, supply_Pa: float) -> tuple[Array, Array, float]:
        bank, k, n = self.bank, tick % self.ticks, len(positions)
        seen = np.concatenate([positions, pressures])
        self._past.appendleft(seen)
        if self._late.any():
            seen = np.array([self._past[min(late, len(self._past) - 1)][i] for i, late in enumerate(self._late)])
        y, P = bank["position"].read(seen[:n], k), bank["pressure_bottom"].read(seen[n:], k)
        return y, P, bank.supply(k, supply_Pa)


@dataclass(kw_only=True)
class Status:
    """What `serve` tells about once a second, and at its end."""

    time_s: float = 0.0
    state: str = ""
    errors: list[str] = field(default_factory=list)
    margin: float = 0.0  # simulated seconds a second of processor time: how much faster than real time it could go
    behind_s: float = 0.0  # now
    worst_behind_s: float = 0.0
    given_up_s: float = 0.0  # real time that was not made up for
    packets: dict[str, int] = field(default_factory=dict)
    messages: list[tuple[float, int, str]] = field(default_factory=list)


class Server:
    """The machine with its host interface. `with server: server.run(...)`, or `server.tick()` by hand.

    start: "neutral" (pressure up, mid stroke) or "off" (on its stops, waiting for the host's start).
    scenario: what manual mode plays. limits: of the host's degrees of freedom, default `dof_limits`.
    """

    def __init__(
        self, machine: Machine, host: str = "127.0.0.1", port: int = PORT, *, compensator: str | Compensator = "none",
        scenario: Scenario | None = None, limits: Limits | None = None, start: str = "neutral", timestep: float | None = None,
        seed: int = 0,
    ) -> None:  # fmt: skip
        if start not in ("neutral", "off"):
            raise HexsimError(f"start is {start!r}; give 'neutral' or 'off'")
        self.machine = machine
        self.plant = Plant(machine, model="tendon" if machine.is_hexapod else "full", timestep=timestep)
        self.tick_s = 1.0 / machine.controller.rate_Hz
        self.compensator, made = make_compensators(compensator, machine)
        self.messages: list[tuple[float, int, str]] = []
        self.computer = MotionComputer(machine, made, None, lambda *message: self.messages.append(message))
        self.generator = SignalGenerator(
            self.plant, scenario or load_scenario("heave"), self.tick_s, self.computer.preview
        )
        kinematics = self.plant.kinematics
        self._dof_limiter = CommandLimiter(limits or (dof_limits(kinematics) if kinematics else leg_limits(machine)))
        self._leg_limiter = CommandLimiter(leg_limits(machine))
        self.limiter, self.mode = self._dof_limiter, 0
        self.sensors = LiveSensors(self.plant, self.tick_s, seed)
        self.supply = EmergencySupply(self.plant)
        self.buffer = HostBuffer()
        self.counts = {"received": 0, "malformed": 0, "stranger": 0, "not sent": 0}
        self.status = Status()
        self.ticks, self._busy_s = 0, 0.0
        self._peer: Any = None
        self._sequence, self._refused, self._taken = 0, False, -1
        self._pose, self._asked = np.zeros(6), np.zeros(6)
        self._positions = self.computer.neutral.copy()
        self.socket = _bind(host, port)
        self.address = self.socket.getsockname()
        if start == "off":
            self._settle()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *exc: object) -> None:
        self.socket.close()

    @property
    def time_s(self) -> float:
        return self.ticks * self.tick_s

    def _settle(self) -> None:
        """Bring the platform down before anyone looks."""
        self.computer.command("settle", 0.0)
        while self.computer.state == State.SETTLING:
            self.tick()
        if self.computer.state != State.OFF:
            raise HexsimError(
                f"machine {self.machine.name} does not settle: {'; '.join(text for _, _, text in self.messages)}"
            )
        self.messages.clear()
        self.computer.events.clear()

    # one control tick
    def tick(self) -> None:
        """Hear the host, compute the volts, step the plant by one control period."""
        now = self.time_s
        answer = self._listen(now)
        plant, computer = self.plant, self.computer
        y, P, Ps = self.sensors.read(
            self.ticks, plant.piston_positions(), plant.bottom_pressures(), plant.supply_pressure()
        )
        self._positions = y
        computer.pump_running = self.supply.running
        computer.oil_temperature_degC = plant.oil_temperature_degC
        computer.heard_s = max(self.buffer.heard_s, computer.heard_s or 0.0) if self._peer else computer.heard_s
        plant.tick(computer.tick(now, self._wanted(now), y, P, Ps))
        self.supply.tick(computer.pump_on, self.tick_s)
        self.ticks += 1
        if self.ticks % 50 == 0:
            plant.check()
            plant.follow_oil_temperature()
        if answer:
            self._reply(now)

    def _wanted(self, now: float) -> Array | None:
        state, computer = self.computer.state, self.computer
        if state == State.MANUAL:
            return self.generator.rows()
        if state != State.NORMAL:
            return None
        target, velocity, acceleration = self.buffer.target(now)
        if self.mode == 0 and not self.machine.is_hexapod:
            target, velocity, acceleration = target[2:3], velocity[2:3], acceleration[2:3]
        n = len(self.limiter.position)
        asked = self.limiter.step(target[:n], velocity[:n], acceleration[:n], self.tick_s)
        legs, held = self._legs(asked)
        rising, _ = self._legs(asked + self.limiter.velocity * self.tick_s)
        finding = Finding(error=Error.WORKSPACE, leg=0, detail="the host asks for more than the limits allow")
        computer.warn(now, finding, self.limiter.limited or held)
        return legs + np.arange(computer.preview)[:, None] * (rising - legs)

    def _legs(self, asked: Array) -> tuple[Array, bool]:
        """Piston setpoints of a limited pose or of limited actuators."""
        cylinder, kinematics = self.machine.cylinder, self.plant.kinematics
        if self.mode == 0 and kinematics is not None:
            self._asked = asked
            return soft_legs(kinematics.piston_positions(asked), cylinder.stroke_m, cylinder.cushion_length_m)
        return soft_legs(0.5 * cylinder.stroke_m + asked, cylinder.stroke_m, cylinder.cushion_length_m)

    # the host
    def _listen(self, now: float) -> bool:
        """Take what has come; True when there is someone to answer."""
        heard = False
        for _ in range(PACKETS_A_TICK):
            try:
                data, sender = self.socket.recvfrom(COMMAND.size + 1)
            except BlockingIOError:
                break
            except OSError:  # an earlier answer could not be delivered
                continue
            self.counts["received"] += 1
            command = unpack_command(data)
            if command is None:
                self.counts["malformed"] += 1
            elif self._peer not in (None, sender) and now - self.buffer.heard_s <= NEW_SESSION_S:
                self.counts["stranger"] += 1
            elif self.buffer.add(command, now):
                self._peer, heard = sender, True
                self._take(command, now)
        return heard

    def _take(self, command: HostCommand, now: float) -> None:
        """Do what the host commands, once for each sequence number."""
        self._sequence = self.buffer.newest.sequence if self.buffer.newest else command.sequence
        if command.command == "none":
            return
        try:
            self.computer.command(command.command, now)
        except HexsimError as error:
            self._refused = True
            self.messages.append((now, 0, f"refused: {error}"))
            del self.messages[:-1000]
            return
        self._refused = False
        if command.command == "run_normal":
            self.mode = command.mode
            self.limiter = self._leg_limiter if self.mode else self._dof_limiter
            self.limiter.position[:] = 0.0
            self.limiter.velocity[:] = 0.0
        elif command.command == "run_manual":
            self.generator.restart()

    def _reply(self, now: float) -> None:
        if self.plant.kinematics is not None:
            with contextlib.suppress(HexsimError):  # readings that belong to no pose: the last one stands
                self._pose = self.plant.kinematics.forward(self._positions, guess=self._pose)
        else:
            self._pose = np.array([0, 0, self._positions[0] - 0.5 * self.machine.cylinder.stroke_m, 0, 0, 0])
        reply = Reply(
            state=self.computer.state, errors=self.computer.errors, sequence=self._sequence % 2**32,
            arrived=self.computer.arrived, refused=self._refused, time_s=now, behind_s=self.status.behind_s,
            age_s=now - self.buffer.heard_s, pose=tuple(self._pose), asked=tuple(self._asked),
        )  # fmt: skip
        try:
            self.socket.sendto(reply.pack(), self._peer)
        except OSError:
            self.counts["not sent"] += 1

    # real time
    def run(
        self, duration_s: float | None = None, stop: Event | None = None, report: Callable[[Status], None] | None = None
    ) -> Status:
        """Tick in real time until `duration_s` are over, `stop` is set or Ctrl-C. report: hears a Status a second."""
        first, begin = self.ticks, clock.perf_counter()
        last_report = begin
        with contextlib.suppress(KeyboardInterrupt):
            while not (stop and stop.is_set()) and (
                duration_s is None or (self.ticks - first) * self.tick_s < duration_s
            ):
                before = clock.thread_time()
                self.tick()
                self._busy_s += clock.thread_time() - before
                after = clock.perf_counter()
                due = begin + (self.ticks - first) * self.tick_s
                if after < due:
                    clock.sleep(due - after)
                self._note(after - due)
                if after - due > WAIT_AT_MOST_S:
                    self.status.given_up_s += after - due
                    begin += after - due
                if report and after - last_report >= 1.0:
                    report(self._summary())
                    last_report = after
        return self._summary()

    def _note(self, behind: float) -> None:
        self.status.behind_s = max(behind, 0.0)
        self.status.worst_behind_s = max(self.status.worst_behind_s, behind)

    def _summary(self) -> Status:
        status, computer = self.status, self.computer

        status.time_s, status.state, status.errors = self.time_s, computer.state.name.lower(), labels(computer.errors)
        status.margin = self.ticks * self.tick_s / self._busy_s if self._busy_s else 0.0
        status.packets = {**self.counts, **self.buffer.counts}
        status.messages = list(self.messages)
        return status


def _bind(host: str, port: int) -> socket.socket:
    """A UDP socket that never waits. Raises HexsimError where it cannot be had."""
    found = None
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][0]
        found = socket.socket(family, socket.SOCK_DGRAM)
        found.bind((host, port))
    except (OSError, OverflowError) as error:
        if found is not None:
            found.close()
        raise HexsimError(
            f"cannot listen on {host}:{port}: {error}; give a free port or an address of this computer"
        ) from None
    found.setblocking(False)
    return found


def serve(
    machine: Machine, host: str = "127.0.0.1", port: int = PORT, *, compensator: str | Compensator = "none",
    scenario: Scenario | None = None, duration_s: float | None = None, start: str = "neutral",
    report: Callable[[Status], None] | None = None, stop: Event | None = None, timestep: float | None = None,
) -> Status:  # fmt: skip
    """Run the machine in real time with its host interface until stopped; returns the final status.

    Raises HexsimError where the address cannot be had or the machine diverges.
    """
    server = Server(machine, host, port, compensator=compensator, scenario=scenario, start=start, timestep=timestep)
    with server:
        return server.run(duration_s, stop, report)
