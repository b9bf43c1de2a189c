"""The motion computer: states, guidance between them, monitors, and the position loop underneath.

    manual / normal     setpoints come from outside (signal generator, or host through `limits`)
    all other states    setpoints come from a `Path` in leg coordinates
    fault               brake, lower every leg to its stop; a leg without transducer follows the loop's model

A tick takes the measured signals and returns the valve voltages; the only other output is `pump_on`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.controller import Control
from hexsim.motion_computer.errors import PUMP_STOPS, WARNINGS, Error, Finding
from hexsim.motion_computer.guidance import Guidance, GuidedSetpoints
from hexsim.motion_computer.load_monitor import LoadMonitor
from hexsim.motion_computer.monitors import LegMonitor, SupplyMonitor, Tolerances
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.motion_computer.states import MOVING, State, StateMachine

Array = NDArray[np.float64]

COMMANDS = ("start", "run_manual", "run_normal", "return_neutral", "settle", "reset")
PUMP_START_s = 0.5  # after the start command; then the starter's contact must show the motor running


class MotionComputer:
    """States and safety around a `PositionLoop`; used by simulations with faults and by `hexsim serve`.

    state: the first one; in every state but OFF the platform stands where the first readings say.
    on_message(time_s, leg, text): called at each change of state (leg 0) and at each error.
    """

    def __init__(
        self,
        machine: Machine,
        compensators: Sequence[Compensator] = (),
        period_s: float | None = None,
        on_message: Callable[[float, int, str], None] = lambda time_s, leg, text: None,
        *,
        state: State = State.NEUTRAL,
        guidance: Guidance | None = None,
        tolerances: Tolerances | None = None,
        n_kept: int = 10_000,  # events and findings, the last ones: a machine may run for months
    ) -> None:
        self.machine, self.on_message = machine, on_message
        self.guidance = guidance = guidance or Guidance()
        self.tolerances = tolerances = tolerances or Tolerances()
        self.loop = PositionLoop(machine, compensators, period_s, on_message)
        self.states = StateMachine(state, self._state_changed)
        self.legs = LegMonitor(machine, tolerances)
        self.supply = SupplyMonitor(machine, tolerances)
        self.load = LoadMonitor(machine, tolerances)
        self.tick_s = 1.0 / machine.controller.rate_Hz
        self.errors = Error.NONE
        self.events: deque[tuple[float, str, str, str]] = deque(maxlen=n_kept)  # (time_s, from, event, to)
        self.findings: deque[tuple[float, Finding]] = deque(maxlen=n_kept)
        self.pump_on = state != State.OFF
        self.pump_running = True  # contact of the motor's starter
        self.mains = True
        self.oil_temperature_degC: float | None = None
        self.last_packet_s: float | None = None  # when the host's last valid packet came
        down = state in (State.OFF, State.STARTING)
        self.guided = GuidedSetpoints(guidance, machine.mechanics, self.tick_s, at_neutral=not down)
        self.valve = np.zeros(machine.n_legs)
        self._pump_on_s = PUMP_START_s if self.pump_on else 0.0
        self._state_since_s = 0.0
        self._extend_share, self._extend_V = 1.0, np.zeros(machine.n_legs)

    # what a PositionLoop shows, so that either can drive a simulation
    @property
    def compensators(self) -> list[Compensator]:
        return self.loop.compensators

    @property
    def preview(self) -> int:
        return self.loop.preview

    @property
    def control(self) -> Control:
        return self.loop.control

    @property
    def memory(self) -> Array:
        return self.loop.memory

    @property
    def feels_load(self) -> bool:
        return self.loop.feels_load

    @property
    def limit(self) -> Array:
        return self.loop.limit

    @property
    def compensation(self) -> Array:
        return self.loop.compensation

    @property
    def setpoint(self) -> Array:
        return self.guided.setpoint

    def engagement(self) -> list[dict[str, Any]]:
        """Of each leg, as `PositionLoop.engagement`."""
        return self.loop.engagement()

    def learned(self) -> list[dict[str, Any]]:
        return self.loop.learned()

    @property
    def neutral(self) -> Array:
        """Where the pistons stand in the neutral pose (n_legs,) [m]."""
        return self.guided.neutral

    @property
    def state(self) -> State:
        return self.states.state

    @property
    def arrived(self) -> bool:
        """No path left: neutral is reached; in fault or settling, down and at rest."""
        return self.guided.path is None

    # commands of the operator
    def command(self, event: str, time_s: float) -> None:
        """Take one of COMMANDS. Raises HexsimError where it is not possible."""
        if event not in COMMANDS:
            raise HexsimError(f"motion computer: unknown command {event!r}; give one of {', '.join(COMMANDS)}")
        if self.state == State.NEUTRAL and event in ("run_manual", "run_normal") and not self.arrived:
            raise HexsimError(f"motion computer: {event} must wait until the platform has reached neutral")
        if self.state == State.FAULT and event == "reset" and not self.arrived:
            raise HexsimError("motion computer: reset must wait until the platform is at rest")
        self.states.event(event, time_s)
        if event == "start":
            self.pump_on, self._pump_on_s = True, 0.0
            self.errors = Error.NONE
        elif event == "return_neutral":
            self.guided.to_neutral(time_s)
        elif event == "settle":
            self.guided.lower(time_s)
        elif event == "run_normal":
            self.last_packet_s = time_s
        elif event == "reset":
            self.errors = Error.NONE

    def _state_changed(self, time_s: float, before: State, event: str, after: State) -> None:
        self.events.append((time_s, before.name.lower(), event, after.name.lower()))
        self._state_since_s = time_s
        self.on_message(time_s, 0, f"{before.name.lower()} -> {after.name.lower()} ({event.replace('_', ' ')})")

    # one tick
    def tick(
        self,
        time_s: float,
        external: Array | None,
        positions: Array,
        pressures: Array | None,
        supply_Pa: float,
        top_pressures: Array | None = None,
    ) -> Array:
        """Volts (n_legs,). external: (preview, n_legs) piston setpoints of manual or normal mode, this tick's first.

        None in normal mode: the host is silent; the last motion is braked, and the timeout runs.
        """
        guided = self.guided
        if self.state == State.OFF:
            guided.setpoint = np.where(np.isfinite(positions), positions, 0.0)
            self.legs.start(positions)
            return self._close_valves()
        if self.state == State.STARTING and guided.path is None:
            self._start_up(time_s, positions, supply_Pa)
        setpoints = self._setpoints(time_s, external)
        feedback = self._monitor(time_s, setpoints[0], positions, pressures, supply_Pa)
        if self.state == State.FAULT and guided.path is None and not self.pump_on:
            guided.store(setpoints[0])
            return self._close_valves()
        if self.state == State.FAULT:
            setpoints = self._setpoints(time_s, None)
            share = self.loop.compensation_share - self.tick_s / self.guidance.fade_compensation_s
            self.loop.compensation_share = max(0.0, share)
        guided.store(setpoints[0])
        self.valve = self.loop.tick(time_s, setpoints, feedback, pressures, supply_Pa, top_pressures)
        self._limit_extension()
        self._follow_path(time_s)
        return self.valve

    def _limit_extension(self) -> None:
        """In a fault with low pressure, fade out the volts that connect a chamber to the supply; lowering stays free."""
        if self.state == State.FAULT and self.errors & Error.PRESSURE_LOW:
            self._extend_share = max(0.0, self._extend_share - self.tick_s / self.guidance.lift_fade_s)
            self.valve = np.minimum(self.valve, self._extend_share * self._extend_V)
        else:
            self._extend_share, self._extend_V = 1.0, np.maximum(self.valve, 0.0)

    def _close_valves(self) -> Array:
        self.loop.restart()
        self.valve = np.zeros(len(self.setpoint))
        return self.valve

    def _setpoints(self, time_s: float, external: Array | None) -> Array:
        """Setpoints (preview, n_legs) of this tick and the preview."""
        if self.state in (State.MANUAL, State.NORMAL):
            if external is not None:
                self.guided.path = None
                return external
            if self.guided.path is None:
                self.guided.brake(time_s)
        return self.guided.preview(time_s, self.preview)

    def _start_up(self, time_s: float, positions: Array, supply_Pa: float) -> None:
        """Wait for pressure, then rise."""
        self.guided.store(np.where(np.isfinite(positions), positions, 0.0))
        if time_s - self._state_since_s > self.guidance.start_timeout_s:
            self._latch(time_s, [Finding(error=Error.PRESSURE_LOW, detail="the supply pressure does not come up")])
        elif supply_Pa > 0.9 * self.supply.nominal:
            self.guided.stand()
            self.legs.start(positions)
            self.guided.to_neutral(time_s)

    # monitors
    def _monitor(
        self, time_s: float, setpoint: Array, positions: Array, pressures: Array | None, supply_Pa: float
    ) -> Array:
        """Run the monitors; returns the positions (n_legs,) for the position loop."""
        feedback, findings = self.legs.tick(setpoint, self.loop.feed_forward, positions, pressures)
        if self.state in MOVING and not (self.state == State.STARTING and self.guided.path is None):
            findings = findings + self.supply.tick(supply_Pa)
            if self.state != State.STARTING and self.state != State.SETTLING:
                findings += self.load.tick(feedback, pressures, supply_Pa)
            findings += self._machine_findings(time_s)
            if findings:
                self._latch(time_s, findings)
        return feedback

    def _machine_findings(self, time_s: float) -> list[Finding]:
        """Pump, mains, oil and host."""
        findings = []
        self._pump_on_s = self._pump_on_s + self.tick_s if self.pump_on else 0.0
        if not self.pump_running and self.mains and self._pump_on_s > PUMP_START_s:
            findings.append(Finding(error=Error.PRESSURE_LOW, detail="the pump has stopped"))
        if not self.mains:
            findings.append(Finding(error=Error.POWER, detail="mains failed"))
        if self.oil_temperature_degC is not None and self.oil_temperature_degC > self.tolerances.oil_hot_degC:
            findings.append(Finding(error=Error.OIL_HOT, detail=f"{self.oil_temperature_degC:.0f} degC"))
        timeout_s = self.tolerances.host_timeout_s
        if self.state == State.NORMAL and time_s - (self.last_packet_s or 0.0) > timeout_s:
            findings.append(Finding(error=Error.HOST_TIMEOUT, detail=f"no valid packet for {timeout_s:g} s"))
        return findings

    def warn(self, time_s: float, finding: Finding, present: bool) -> None:
        """Set or clear a warning: shown, but no fault."""
        if present and not self.errors & finding.error:
            self._record(time_s, finding)
        elif not present:
            self.errors &= ~finding.error

    def _record(self, time_s: float, finding: Finding) -> None:
        self.errors |= finding.error
        self.findings.append((time_s, finding))
        self.on_message(time_s, finding.leg, finding.text)

    def _latch(self, time_s: float, findings: list[Finding]) -> None:
        """Latch errors and go to fault."""
        for finding in findings:
            self._record(time_s, finding)
        if self.errors & PUMP_STOPS:
            self.pump_on = False
        if self.errors & ~WARNINGS and self.states.allows("error"):
            self.states.event("error", time_s)
            self.guided.lower(time_s)

    def _follow_path(self, time_s: float) -> None:
        """At the end of a path: lower legs without position signal, stop the pump, change state."""
        path = self.guided.path
        if path is None or self.state in (State.MANUAL, State.NORMAL):
            return
        if self.state == State.FAULT and time_s > path.end_s and not self.legs.usable.all():
            ramp = max(-self.guidance.lowering_V_s * (time_s - path.end_s), self.guidance.lowering_V)
            self.valve = np.where(self.legs.usable, self.valve, ramp)
        lowered = self.state in (State.FAULT, State.SETTLING)
        if time_s < path.end_s + (self.guidance.rest_s if lowered else 0.0):
            return
        self.guided.path = None
        if self.state == State.STARTING:
            self.states.event("ready", time_s)
            self.load.restart()
        elif lowered:
            self.pump_on = False
            if self.state == State.SETTLING:
                self.states.event("at_rest", time_s)
            else:
                self.on_message(time_s, 0, "platform at rest")
