"""The motion computer: states, smooth guidance between them, monitors, and the position loop underneath.

    manual / normal     setpoints come from outside (signal generator, or host through `limits`)
    all other states    setpoints come from a `Path` in leg coordinates
    fault               brake, lower every leg to its stop; a leg without transducer follows the loop's model

A tick takes what the electronics measure and returns six valve voltages; the only other output is `pump_on`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.machine.geometry import machine_kinematics
from hexsim.motion_computer.errors import PUMP_STOPS, WARNINGS, Error, Finding
from hexsim.motion_computer.monitors import LegMonitor, LoadMonitor, SupplyMonitor, Tolerances
from hexsim.motion_computer.paths import Path, stop_and_move
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.motion_computer.states import MOVING, State, StateMachine

Array = NDArray[np.float64]


COMMANDS = ("start", "run_manual", "run_normal", "return_neutral", "settle", "reset")

PUMP_STARTS_s = 0.5  # after the command the starter's contact must show the motor running


@dataclass(frozen=True, kw_only=True)
class Guidance:
    """How fast the motion computer moves the legs on its own. Assumed values, for people on board."""

    neutral_velocity_m_s: float = 0.05  # to neutral
    neutral_acceleration_m_s2: float = 0.2
    settle_velocity_m_s: float = 0.04  # down to the stops
    settle_acceleration_m_s2: float = 0.1
    stop_acceleration_m_s2: float = 1.0  # braking of a leg that was moving
    fade_compensation_s: float = 0.3  # compensation goes out this slowly at a fault
    lowering_V: float = -0.2  # to a leg whose position is not known, once the others are down,
    lowering_V_s: float = 0.2  # reached at this rate
    lift_fade_s: float = 0.3  # without pressure no valve may open towards the supply: it would let the leg sink
    rest_s: float = 2.0  # after the path's end, then the pump stops
    start_timeout_s: float = 10.0  # for the supply pressure to come up


class MotionComputer:
    """States and safety around a `PositionLoop`; used by simulations with faults and by `hexsim serve`.

    state: where it begins; in every state but OFF the platform is taken to stand where the first readings say.
    say(time_s, leg, text): hears each change of state (leg 0) and each error.
    """

    def __init__(
        self,
        machine: Machine,
        compensators: Sequence[Compensator] = (),
        period_s: float | None = None,
        say: Callable[[float, int, str], None] = lambda time_s, leg, text: None,
        *,
        state: State = State.NEUTRAL,
        guidance: Guidance | None = None,
        tolerances: Tolerances | None = None,
    ) -> None:
        self.machine, self.say = machine, say
        self.guidance = guidance = guidance or Guidance()
        self.tolerances = tolerances = tolerances or Tolerances()
        self.loop = PositionLoop(machine, compensators, period_s, say)
        self.kinematics = machine_kinematics(machine) if machine.is_hexapod else None
        self.states = StateMachine(state, self._state_changed)
        self.legs = LegMonitor(machine, tolerances)
        self.supply = SupplyMonitor(machine, tolerances)
        self.load = LoadMonitor(machine, self.kinematics, tolerances)
        self.tick_s = 1.0 / machine.controller.rate_Hz
        self.errors = Error.NONE
        self.events: list[tuple[float, str, str, str]] = []  # (time_s, from, event, to)
        self.findings: list[tuple[float, Finding]] = []
        self.pump_on = state != State.OFF
        self.mains = True
        self._pump_on_s = PUMP_STARTS_s if self.pump_on else 0.0
        self.pump_running = True  # contact of the motor's starter
        self.oil_temperature_degC: float | None = None
        self.heard_s: float | None = None  # when the host was last heard
        n = machine.n_legs
        self.neutral = np.full(n, 0.5 * machine.cylinder.stroke_m)
        self.setpoint = self.neutral.copy() if state not in (State.OFF, State.STARTING) else np.zeros(n)
        self._before = self.setpoint.copy()
        self._older = self.setpoint.copy()
        self._path: Path | None = None
        self._since_s = 0.0
        self._lift, self._lift_V = 1.0, np.zeros(n)
        self.valve = np.zeros(n)

    # what a PositionLoop shows, so that either can drive a simulation
    @property
    def compensators(self) -> list[Compensator]:
        return self.loop.compensators

    @property
    def preview(self) -> int:
        return self.loop.preview

    @property
    def gain(self) -> float:
        return self.loop.gain

    @property
    def limit(self) -> float:
        return self.loop.limit

    @property
    def compensation(self) -> Array:
        return self.loop.compensation

    def learned(self) -> list[dict[str, Any]]:
        return self.loop.learned()

    @property
    def state(self) -> State:
        return self.states.state

    @property
    def arrived(self) -> bool:
        """In neutral, and the way there is done; in fault or settling, down and at rest."""
        return self._path is None

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
            self._guide(
                time_s, self.neutral, self.guidance.neutral_velocity_m_s, self.guidance.neutral_acceleration_m_s2
            )
        elif event == "settle":
            self._lower(time_s)
        elif event == "run_normal":
            self.heard_s = time_s
        elif event == "reset":
            self.errors = Error.NONE

    def _state_changed(self, time_s: float, before: State, event: str, after: State) -> None:
        self.events.append((time_s, before.name.lower(), event, after.name.lower()))
        self._since_s = time_s
        self.say(time_s, 0, f"{before.name.lower()} -> {after.name.lower()} ({event.replace('_', ' ')})")

    # one tick
    def tick(
        self, time_s: float, wanted: Array | None, positions: Array, pressures: Array | None, supply_Pa: float
    ) -> Array:
        """Volts (n_legs,). wanted: (preview, n_legs) piston setpoints of manual or normal mode, this tick's first.

        None in normal mode: the host is silent; the last motion is braked, and the timeout runs.
        """
        if self.state == State.OFF:
            self.setpoint = np.where(np.isfinite(positions), positions, 0.0)
            self.legs.start(positions)
            return self._shut()
        if self.state == State.STARTING and self._path is None:
            self._start_up(time_s, positions, supply_Pa)
        rows = self._rows(time_s, wanted)
        believed = self._watch(time_s, rows[0], positions, pressures, supply_Pa)
        if self.state == State.FAULT and self._path is None and not self.pump_on:
            self._keep(rows[0])
            return self._shut()
        if self.state == State.FAULT:
            rows = self._rows(time_s, None)
            self.loop.fade = max(0.0, self.loop.fade - self.tick_s / self.guidance.fade_compensation_s)
        self._keep(rows[0])
        self.valve = self.loop.tick(time_s, rows, believed, pressures, supply_Pa)
        self._hold_without_pressure()
        self._follow_path(time_s)
        return self.valve

    def _hold_without_pressure(self) -> None:
        """A fault with low pressure closes the way from chamber to supply, smoothly; lowering stays free."""
        if self.state == State.FAULT and self.errors & Error.PRESSURE_LOW:
            self._lift = max(0.0, self._lift - self.tick_s / self.guidance.lift_fade_s)
            self.valve = np.minimum(self.valve, self._lift * self._lift_V)
        else:
            self._lift, self._lift_V = 1.0, np.maximum(self.valve, 0.0)

    def _shut(self) -> Array:
        self.valve = np.zeros(len(self.setpoint))
        return self.valve

    def _keep(self, setpoint: Array) -> None:
        self._older, self._before, self.setpoint = self._before, self.setpoint, setpoint.copy()

    def _rows(self, time_s: float, wanted: Array | None) -> Array:
        """Setpoints of this tick and the preview."""
        if self.state in (State.MANUAL, State.NORMAL):
            if wanted is not None:
                self._path = None
                return wanted
            if self._path is None:
                self._brake(time_s)
        if self._path is None:
            return np.tile(self.setpoint, (self.preview, 1))
        return np.stack([self._path.value(time_s + k * self.tick_s) for k in range(self.preview)])

    def _start_up(self, time_s: float, positions: Array, supply_Pa: float) -> None:
        """Wait for pressure, then rise."""
        self._keep(np.where(np.isfinite(positions), positions, 0.0))
        if time_s - self._since_s > self.guidance.start_timeout_s:
            self._found(
                time_s, [Finding(error=Error.PRESSURE_LOW, leg=0, detail="the supply pressure does not come up")]
            )
        elif supply_Pa > 0.9 * self.supply.nominal:
            self._before = self._older = self.setpoint
            self.legs.start(positions)
            self._guide(
                time_s, self.neutral, self.guidance.neutral_velocity_m_s, self.guidance.neutral_acceleration_m_s2
            )

    def _watch(
        self, time_s: float, setpoint: Array, positions: Array, pressures: Array | None, supply_Pa: float
    ) -> Array:
        """Run the monitors; returns the positions to control with."""
        believed, findings = self.legs.tick(setpoint, positions, pressures)
        if self.state in MOVING and not (self.state == State.STARTING and self._path is None):
            findings = findings + self.supply.tick(supply_Pa)
            if self.state != State.STARTING and self.state != State.SETTLING:
                findings += self.load.tick(believed, pressures, supply_Pa)
            self._pump_on_s = self._pump_on_s + self.tick_s if self.pump_on else 0.0
            if not self.pump_running and self.mains and self._pump_on_s > PUMP_STARTS_s:
                findings.append(Finding(error=Error.PRESSURE_LOW, leg=0, detail="the pump has stopped"))
            if not self.mains:
                findings.append(Finding(error=Error.POWER, leg=0, detail="mains failed"))
            if self.oil_temperature_degC is not None and self.oil_temperature_degC > self.tolerances.oil_hot_degC:
                findings.append(Finding(error=Error.OIL_HOT, leg=0, detail=f"{self.oil_temperature_degC:.0f} degC"))
            if self.state == State.NORMAL and time_s - (self.heard_s or 0.0) > self.tolerances.host_timeout_s:
                findings.append(
                    Finding(
                        error=Error.HOST_TIMEOUT,
                        leg=0,
                        detail=f"nothing heard for {self.tolerances.host_timeout_s:g} s",
                    )
                )
            if findings:
                self._found(time_s, findings)
        return believed

    def warn(self, time_s: float, finding: Finding, present: bool) -> None:
        """Set or clear a warning: shown, but no fault."""
        if present and not self.errors & finding.error:
            self.errors |= finding.error
            self.findings.append((time_s, finding))
            self.say(time_s, finding.leg, finding.text)
        elif not present:
            self.errors &= ~finding.error

    def _found(self, time_s: float, findings: list[Finding]) -> None:
        """Latch errors and go to fault."""
        for finding in findings:
            self.errors |= finding.error
            self.findings.append((time_s, finding))
            self.say(time_s, finding.leg, finding.text)
        if self.errors & PUMP_STOPS:
            self.pump_on = False
        if self.errors & ~WARNINGS and self.states.allows("error"):
            self.states.event("error", time_s)
            self._lower(time_s)

    # guidance
    def _motion(self) -> tuple[Array, Array]:
        """Velocity and acceleration of the setpoints, from the last three."""
        velocity = (self.setpoint - self._before) / self.tick_s
        return velocity, (velocity - (self._before - self._older) / self.tick_s) / self.tick_s

    def _guide(self, time_s: float, target: Array | None, velocity: float, acceleration: float) -> None:
        """A path that continues the present motion: the path begins one tick ago, where the last setpoint was."""
        now, change = self._motion()
        self._path = stop_and_move(
            time_s - self.tick_s, self.setpoint, now, change, target,
            velocity_max=velocity, acceleration_max=acceleration,
            stop_acceleration_max=self.guidance.stop_acceleration_m_s2,
            bounds=(0.0, self.machine.cylinder.stroke_m),
        )  # fmt: skip

    def _brake(self, time_s: float) -> None:
        self._guide(time_s, None, 1.0, 1.0)

    def _lower(self, time_s: float) -> None:
        guidance = self.guidance
        self._guide(
            time_s, np.zeros(len(self.neutral)), guidance.settle_velocity_m_s, guidance.settle_acceleration_m_s2
        )

    def _follow_path(self, time_s: float) -> None:
        """What happens at the end of a path."""
        path = self._path
        if path is None or self.state in (State.MANUAL, State.NORMAL):
            return
        if self.state == State.FAULT and time_s > path.end_s and not self.legs.usable.all():
            ramp = max(-self.guidance.lowering_V_s * (time_s - path.end_s), self.guidance.lowering_V)
            self.valve = np.where(self.legs.usable, self.valve, ramp)
        lowered = self.state in (State.FAULT, State.SETTLING)
        if time_s < path.end_s + (self.guidance.rest_s if lowered else 0.0):
            return
        self._path = None
        if self.state == State.STARTING:
            self.states.event("ready", time_s)
            self.load.restart()
        elif lowered:
            self.pump_on = False
            if self.state == State.SETTLING:
                self.states.event("at_rest", time_s)
            else:
                self.say(time_s, 0, "platform at rest")
