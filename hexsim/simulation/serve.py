"""The machine in real time: plant, motion computer and host interface, one control tick after the other.

    serve(machine)      states by the host's commands, setpoints over UDP (packets: `motion_computer.host_packet`)

The plant is the tendon model. The link (`motion_computer.host_link`) binds to loopback unless told otherwise.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator
from hexsim.compiled import seconds_compiled
from hexsim.cueing.washout import Cueing, Washout
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import labels
from hexsim.motion_computer.host_link import HostLink
from hexsim.motion_computer.host_packet import HostCommand, Reply
from hexsim.motion_computer.host_setpoints import HostSetpoints
from hexsim.motion_computer.limits import Limits
from hexsim.motion_computer.states import State
from hexsim.packets import HOST_PORT
from hexsim.plant import Plant
from hexsim.plant.callbacks import without_timers
from hexsim.plant.plant import whole_ratio
from hexsim.scenarios import Scenario, load_scenario
from hexsim.simulation.cavitation_watch import CavitationWatch
from hexsim.simulation.emergency_supply import EmergencySupply
from hexsim.simulation.host_orders import HostOrders
from hexsim.simulation.live_sensors import LiveSensors, Readings
from hexsim.simulation.manual import SignalGenerator
from hexsim.simulation.rehearsal import rehearse
from hexsim.simulation.serve_latency import LatencyLog
from hexsim.simulation.serve_record import ServeRecord
from hexsim.simulation.serve_status import Status
from hexsim.simulation.simulation import make_compensators
from hexsim.simulation.stream import Stream, tick_row
from hexsim.simulation.telemetry import TelemetryRows
from hexsim.simulation.vehicle_link import Vehicle, VehicleLink

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HostInput:
    """How the host's packets become setpoints. limits, buffer_s: `motion_computer.host_setpoints`.

    vehicle: a simulator that knows no motion base, whose packets are washed out (`vehicle_link`).
    """

    limits: Limits | None = None
    buffer_s: float | None = None
    vehicle: Vehicle | None = None
    washout: Washout = field(default_factory=Washout)


class Server:
    """The machine with its host interface. `with server: server.run(...)`, or `server.tick()` by hand.

    telemetry: send what the sensors read at the log rate (`motion_computer.telemetry`).  lockstep: machine time follows the
    host's packets, as fast as both can. record_s: so much from the start on is kept in `record`, for a run folder.
    start: "neutral" (pressure up, mid stroke) or "off" (on its stops, waiting for the host's start).
    scenario: what manual mode plays. furnish: adds to the scene (`Plant`), for who shows it; the legs are bodies then.
    stream: takes the signals of every control tick.
    """

    def __init__(
        self,
        machine: Machine,
        host: str = "127.0.0.1",
        port: int = HOST_PORT,
        *,
        compensator: str | Compensator = "none",
        scenario: Scenario | None = None,
        start: str = "neutral",
        timestep: float | None = None,
        seed: int = 0,
        telemetry: bool = False,
        lockstep: bool = False,
        record_s: float = 0.0,
        host_input: HostInput | None = None,
        furnish: Callable[[Any], None] | None = None,
        stream: Stream | None = None,
        n_kept: int = 1000,  # messages, the last ones
    ) -> None:
        if start not in ("neutral", "off"):
            raise HexsimError(f"start is {start!r}; give 'neutral' or 'off'")
        self.machine = machine
        self.plant = (
            Plant(machine, model="tendon", timestep=timestep)
            if furnish is None
            else Plant(machine, model="full", timestep=timestep, furnish=furnish)
        )
        self.tick_s = 1.0 / machine.controller.rate_Hz
        name, made = make_compensators(compensator, machine)
        self.messages: deque[tuple[float, int, str]] = deque(maxlen=n_kept)
        self.computer = MotionComputer(machine, made, None, lambda *message: self.messages.append(message))
        generator = SignalGenerator(self.plant, scenario or load_scenario("heave"), self.tick_s, self.computer.preview)
        self.kinematics = machine.mechanics
        asked = host_input or HostInput()
        self.host = HostSetpoints(machine, self.computer.preview, asked.limits, asked.buffer_s)
        self.orders = HostOrders(machine, self.computer, generator, self.host, self.messages)
        self.lockstep = lockstep
        self._offset_s: float | None = None  # machine time less the host's
        self._session = 0
        log_rate = (
            max(machine.sensors.log_rate_Hz, machine.controller.rate_Hz) if telemetry else machine.controller.rate_Hz
        )
        self.samples = whole_ratio(log_rate, machine.controller.rate_Hz, "log rate and control rate")  # a control tick
        self.plant.prepare(log_rate)
        self.sensors = LiveSensors(self.plant, self.tick_s / self.samples, seed)
        self.telemetry = TelemetryRows(self.plant, self.sensors, log_rate) if telemetry else None
        self.stream = stream
        self.supply = EmergencySupply(self.plant)
        self.cavitation = CavitationWatch(self.plant)
        self.latency = LatencyLog(self.tick_s, machine.mechanics.dof_places)
        self.status = Status()
        self.ticks, self._busy_s = 0, 0.0
        self._pose = np.zeros(6)
        self._positions = self.computer.neutral.copy()
        self.orders.compensator = name
        self._compile(made)
        if asked.vehicle is None:
            self.link = HostLink(host, port, self.host.buffer)
        else:
            cueing = Cueing(asked.washout, machine.controller.rate_Hz)
            self.link = VehicleLink(
                host,
                port,
                self.host.buffer,
                asked.vehicle,
                cueing,
                self._ready,
                lambda text: self.messages.append((self.time_s, 0, text)),
            )
        self.address = self.link.address
        self.record = ServeRecord(self, record_s, log_rate, seed) if record_s else None
        if start == "off":
            self._settle()

    def _compile(self, compensators: list[Compensator]) -> None:
        """Compile what a drive calls before a host is listened to."""
        self.plant.tick(np.zeros(self.machine.n_legs))
        self.plant.check()
        self.plant.follow_oil_temperature()
        self.plant.reset()
        rehearse(self.machine, compensators, four_way=len(self.sensors.read(0)) > 3)
        self.sensors.restart()

    def _ready(self) -> bool:
        return self.computer.state == State.NEUTRAL and self.computer.arrived

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *exc: object) -> None:
        self.link.close()
        if self.stream:
            self.stream.close()

    @property
    def compensator(self) -> str:
        """The name of what acts in the legs."""
        return self.orders.compensator

    @property
    def time_s(self) -> float:
        return self.ticks * self.tick_s

    @property
    def margin(self) -> float:
        """Simulated seconds a second of processor time."""
        return self.ticks * self.tick_s / self._busy_s if self._busy_s else 0.0

    def _settle(self) -> None:
        """Lower the platform before the first packet."""
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
        """Take the host's packets, compute the volts, step the plant by one control period, answer."""
        commands = self._take()
        self.advance()
        if commands:
            self.link.send(self._reply(self.time_s - self.tick_s))

    def _take(self) -> list[HostCommand]:
        commands = self.link.receive(self.time_s)
        while self.link.asked:  # before the commands: who asks twice and then runs is not refused
            self.orders.compensate(self.link.asked.pop(0), self.time_s)
        for command in commands:
            self.orders.execute(command, self.time_s)
            if self.computer.state == State.NORMAL and self.host.mode == 0:
                self.latency.packet(self.time_s, command)
        return commands

    def advance(
        self,
        *,
        check_ticks: int = 50,  # between checks for divergence, and updates of the oil's temperature
    ) -> None:
        """Compute the volts and step the plant by one control period."""
        now, plant, computer, link = self.time_s, self.plant, self.computer, self.link
        readings = self.sensors.read(self.ticks * self.samples)
        self._positions = readings[0]
        computer.pump_running = self.supply.running
        computer.oil_temperature_degC = plant.oil_temperature_degC
        if link.heard:
            computer.last_packet_s = max(link.buffer.last_packet_s, computer.last_packet_s or 0.0)
        volts = computer.tick(now, self.orders.setpoints(now), *readings)
        self._step(volts, readings)
        if self.stream:
            row = tick_row(plant, computer, volts, readings, computer.state.name.lower())
            self.stream.row(self.time_s, row)
        self.supply.tick(computer.pump_on, self.tick_s)
        self.ticks += 1
        if computer.state == State.NORMAL:
            self.latency.tick(self.time_s, plant.data.qacc[: len(self.latency.places)].copy())
        if self.ticks % check_ticks == 0:
            plant.check()
            plant.follow_oil_temperature()

    def _step(self, volts: Array, readings: Readings) -> None:
        """The plant's ticks of a control period; with telemetry a row of readings before each."""
        for k in range(self.samples):
            sample = self.ticks * self.samples + k
            if self.telemetry:
                readings = readings if k == 0 else self.sensors.read(sample)
                now = sample * self.tick_s / self.samples
                self.telemetry.add(now, sample, self.computer.setpoint, readings, volts)
            if self.record:
                self.record.before_tick()
            self.plant.tick(volts)
            self.cavitation.note(self.tick_s / self.samples)
        if self.telemetry:  # without a host the rows go nowhere, and are not kept
            for packet in self.telemetry.packets():
                if self.link.peer:
                    self.link.send_packet(packet)

    def follow(
        self,
        timeout_s: float = 0.1,
        stop: Event | None = None,
        *,
        most_ticks: int = 500,  # that a packet may ask for in lockstep
    ) -> None:
        """In lockstep: wait for a packet and run to the host's time, then answer. A packet that came twice is answered again.

        After a new session, and where the host's clock began anew, its time is this machine's now.
        """
        self.link.wait(timeout_s)
        commands = self._take()
        if commands:
            host_s, counts = max(command.time_s for command in commands), self.link.buffer.counts
            session = counts["sessions"] + counts["resynchronised"]
            if self._offset_s is None or session != self._session:
                self._offset_s, self._session = self.time_s - host_s, session
            for _ in range(min(max(round((host_s + self._offset_s - self.time_s) / self.tick_s), 0), most_ticks)):
                if stop and stop.is_set():
                    return
                self.advance()
        if self.link.spoke:
            for packet in self.telemetry.packets(rest=True) if self.telemetry else ():
                self.link.send_packet(packet)
            self.link.send(self._reply(self.time_s))

    def _reply(self, now: float) -> Reply:
        with contextlib.suppress(HexsimError):  # readings that belong to no pose: the last pose is kept
            self._pose = self.kinematics.forward(self._positions, guess=self._pose)
        newest = self.link.buffer.newest
        return Reply(
            state=self.computer.state,
            errors=self.computer.errors,
            sequence=newest.sequence % 2**32 if newest else 0,
            arrived=self.computer.arrived,
            refused=self.orders.refused,
            time_s=now,
            behind_s=self.status.behind_s,
            age_s=now - self.link.buffer.last_packet_s,
            pose=tuple(self._pose),
            reference=tuple(self.host.reference),
            lockstep=self.lockstep,
            telemetry=self.telemetry is not None,
            compensated=bool(self.computer.compensators),
        )

    # real time
    @without_timers()
    def run(
        self, duration_s: float | None = None, stop: Event | None = None, report: Callable[[Status], None] | None = None
    ) -> Status:
        """Tick in real time until `duration_s` are over, `stop` is set or Ctrl-C. report: called once a second."""
        stop = stop or Event()
        first, begin = self.ticks, clock.perf_counter()
        last_report = begin
        with contextlib.suppress(KeyboardInterrupt):
            while not stop.is_set() and (duration_s is None or (self.ticks - first) * self.tick_s < duration_s):
                before, compiled_s = clock.thread_time(), seconds_compiled()
                if self.lockstep:
                    self.follow(stop=stop)
                else:
                    self.tick()
                self._busy_s += max(clock.thread_time() - before - (seconds_compiled() - compiled_s), 0.0)
                after = clock.perf_counter()
                if not self.lockstep:
                    begin += self._keep_time(begin + (self.ticks - first) * self.tick_s - after)
                if report and after - last_report >= 1.0:
                    report(self._present_status())
                    last_report = after
        self.status.latency_ms = self.latency.ms()
        self.cavitation.end()
        return self._present_status()

    def _keep_time(
        self,
        early_s: float,
        *,
        most_lag_s: float = 0.25,  # a longer lag behind real time is skipped
    ) -> float:
        """Wait where a tick is early; where it is late, note it. Gives the lag that is skipped."""
        if early_s > 0.0:
            clock.sleep(early_s)
        self.status.note_lag(-early_s)
        if -early_s <= most_lag_s:
            return 0.0
        self.status.skipped_s -= early_s
        return -early_s

    def _present_status(self) -> Status:
        status, computer = self.status, self.computer
        status.time_s, status.state, status.errors = self.time_s, computer.state.name.lower(), labels(computer.errors)
        status.margin = self.margin
        status.packets = {**self.link.counts, **self.link.buffer.counts}
        status.not_understood = dict(self.link.refusals)
        status.refused_orders = dict(self.orders.refusals)
        status.of_packets = self.link.refusals.line(self.link.counts["received"], self.link.protocol)
        status.silent_s = self.link.silent_s if isinstance(self.link, VehicleLink) else 0.0
        status.compensation = computer.engagement()
        status.messages = list(self.messages)
        status.cavitated, status.warnings = self.cavitation.count, list(self.cavitation.told)
        return status


def serve(
    machine: Machine,
    host: str = "127.0.0.1",
    port: int = HOST_PORT,
    *,
    compensator: str | Compensator = "none",
    scenario: Scenario | None = None,
    duration_s: float | None = None,
    start: str = "neutral",
    report: Callable[[Status], None] | None = None,
    stop: Event | None = None,
    timestep: float | None = None,
) -> Status:
    """Run the machine in real time with its host interface until stopped; returns the final status.

    Raises HexsimError where the address cannot be had or the machine diverges.
    """
    server = Server(machine, host, port, compensator=compensator, scenario=scenario, start=start, timestep=timestep)
    with server:
        return server.run(duration_s, stop, report)
