"""The position loop of the motion computer: the declared controllers and a compensator slot each.

    u = sat(controller + u_c)          `controller.py`; by default Kp (setpoint - position), report 2.2.4

A controller's setpoint filter smooths what it feeds forward. A compensator feeds forward itself: its preview is of before
the filter, whose delay is not felt (sqrt(2)/omega: 15 ms of a tuned machine).

Runs at the controller's rate; the volts are held in between (zero-order hold).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import NO_LOAD, Compensator, Knowledge, preview_count
from compensation.compensator import MEASURED_TICKS
from compensation.guard import step_together
from compensation.legs import Legs, tell
from hexsim.declaration import Machine
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer import controller
from hexsim.motion_computer.controller import C
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.declared_control import control_of
from hexsim.motion_computer.leg_load import SLOPE, SPAN, ExpectedLoad, PoseLoad

Array = NDArray[np.float64]


class PositionLoop:
    """Controllers and compensators of all actuators.

    compensators: one a leg, or empty for plain control. `preview` is how many setpoints ahead `tick` must be given.
    on_message(time_s, leg, sentence): called at each change of a compensator's status (leg counts from 1).
    """

    def __init__(
        self,
        machine: Machine,
        compensators: Sequence[Compensator],
        period_s: float | None,
        on_message: Callable[[float, int, str], None] = lambda time_s, leg, text: None,
    ) -> None:
        n = machine.n_legs
        self.control, self.memory = control_of(machine), controller.new_memory(n)
        self.limit = machine.of_legs("valve", "voltage_max_V")
        self.on_message = on_message
        self.machine, self._tick_s = machine, 1.0 / machine.controller.rate_Hz
        self.load: ExpectedLoad | None = None  # of a platform's legs, for compensators
        self.pose_load: PoseLoad | None = None  # where a compensator feels all legs
        self._period_s = period_s
        self.compensate(compensators)
        self.valve = np.zeros(n)  # volts that leave the motion computer
        self.setpoint = np.zeros(n)
        self.feed_forward = np.zeros(n)
        self.compensation_share = 1.0  # that reaches the valve; a fault fades it to 0
        self._commanded = np.zeros(n)  # volts before the computing delay
        self._running = False

    def compensate(self, compensators: Sequence[Compensator]) -> None:
        """Begin with these compensators, one a leg, or with plain control where there is none."""
        self.compensators = list(compensators)
        if self.compensators and self.load is None:
            self.load = ExpectedLoad.of(resolve(self.machine))
        legs = range(1, self.machine.n_legs + 1)
        self._contexts = [compensator_context(self.machine, self._period_s, leg, self.load) for leg in legs]
        if self.load is not None and self.pose_load is None and any(one.feels_legs for one in self.compensators):
            self.pose_load = PoseLoad.of(resolve(self.machine), self.load)
        self._seen = np.zeros((0, 2, len(legs)))  # positions and forces of the last SPAN ticks
        self.areas = np.array([[context.area_bottom_m2, context.area_top_m2] for context in self._contexts]).T
        made = list(zip(self.compensators, self._contexts, strict=False))
        self.states: list[Any] = [c.start(context) for c, context in made]
        self.previews = [preview_count(*both, state) for both, state in zip(made, self.states, strict=True)]
        self.preview = max(self.previews, default=1)
        self.compensation = np.zeros(len(self._contexts))
        self._status = [""] * len(self.compensators)
        self.ticks, self.added_ticks = (
            np.zeros(1, np.int64),
            np.zeros(len(legs), np.int64),
        )  # so far; of each leg with volts added
        self.counts = np.array([min(count, self.preview) for count in self.previews], np.int64)
        declared = [(one.name, context) for one, context in made]
        self.alike = np.array([[own == other for other in declared] for own in declared])
        self.together = step_together(self.compensators, self.states)
        self.first_s = np.full(len(legs), np.nan)  # when each leg first engaged

    @property
    def feels_load(self) -> bool:
        """Whether pressures are fed back."""
        return bool(np.any(self.control.rows[:, C.PRESSURE_GAIN]))

    def restart(self) -> None:
        """Begin anew at the next tick: the valves were shut in between."""
        self._running = False

    def load_pressures(self, bottom: Array | None, top: Array | None) -> Array:
        """p = P1 - P2 A2/A1 (n_legs,) [Pa] that the pressure feedback takes; NaN where a reading is missing."""
        if bottom is None:
            return np.full(len(self.valve), np.nan)
        return bottom if top is None else bottom - self.control.rows[:, C.AREA_RATIO] * top

    def tick(
        self,
        time_s: float,
        setpoints: Array,
        positions: Array,
        pressures: Array | None,
        supply_Pa: float,
        top_pressures: Array | None = None,
    ) -> Array:
        """Volts (n_legs,) for this tick. setpoints: (preview, n_legs), this tick's first; the rest SI, measured.

        top_pressures: of rod sides on a four-way valve.
        """
        control, memory = self.control, self.memory
        self.setpoint, load = setpoints[0], self.load_pressures(pressures, top_pressures)
        if not self._running:
            controller.begin(control, memory, setpoints[0], positions, load)
            self._running = True
        asked, path = np.empty(len(positions)), np.empty_like(setpoints)
        # behind the setpoint filter, what the controller works with; what of its volts is of the setpoint alone
        followed, own = np.empty_like(asked), np.empty_like(asked)
        controller.ask(control, memory, setpoints, positions, load, path, followed, self.feed_forward, own, asked)
        if self.compensators and pressures is not None:
            ahead = np.ascontiguousarray(path.T)  # in rows: one memory layout, compiled once, for one leg and for six
            loads = np.zeros((len(positions), 0))
            if self.load is not None:
                loads = np.ascontiguousarray(self.load.accelerations(path, self._tick_s).T)
            mobility, pose, forces, speeds = self._watch_legs(positions, pressures, supply_Pa, top_pressures)
            tops = np.zeros(len(positions)) if top_pressures is None else top_pressures
            legs = Legs(
                time_s,
                followed,
                ahead,
                self.counts,
                positions,
                asked,
                self._commanded,
                pressures,
                supply_Pa,
                own,
                tops,
                loads,
                forces,
                speeds,
                pose,
                mobility,
            )
            self._compensate(legs, asked)
        # without position signal: 0, the valve shut
        self.valve, self._commanded = np.empty_like(asked), np.empty_like(asked)
        controller.send(control, memory, asked, self._commanded, self.valve)
        return self.valve

    def _compensate(self, legs: Legs, asked: Array) -> None:
        """Add the compensators' volts to what the legs ask for."""
        may_speak = True
        if self.together is None:
            added = np.zeros(len(asked))
            for i, (compensator, sample) in enumerate(zip(self.compensators, legs.samples(), strict=True)):
                added[i], self.states[i] = compensator.step(self.states[i], sample)
        else:
            added, may_speak = self.together.step(legs), self.together.may_speak
        added *= self.compensation_share
        self.compensation[:] = added
        asked += added
        self.ticks += 1
        self.added_ticks += added != 0.0
        self._note_first(legs.time_s)
        if may_speak:
            self._note_status(legs.time_s)
        if self.together is None:
            tell(self.compensators, self.states, np.ones(len(asked), bool), self.alike)
        else:
            self.together.share(self.alike)

    def follow(self, time_s: float) -> None:
        """What Python does beside a control tick in compiled code, at ticks that changed something."""
        if self.together is not None:
            self.together.follow()
        self._note_first(time_s)
        self._note_status(time_s)

    def _note_first(self, time_s: float) -> None:
        """When each leg has first engaged: what a probe adds is not it."""
        for i in np.flatnonzero((self.compensation != 0.0) & np.isnan(self.first_s)):
            if not self.compensators[i].not_engaged(self.states[i]):
                self.first_s[i] = time_s

    def _note_status(self, time_s: float) -> None:
        """Say what has changed of the compensators' status."""
        for i, compensator in enumerate(self.compensators):
            status = compensator.status(self.states[i])
            if status != self._status[i]:
                self._status[i] = status
                self.on_message(time_s, i + 1, f"{compensator.name}: {status or 'normal again'}")

    @property
    def known(self) -> tuple[Knowledge | None, ...]:
        """What each leg's compensator knows of it."""
        return tuple(one.knows(state) for one, state in zip(self.compensators, self.states, strict=True))

    def _watch_legs(
        self, positions: Array, pressures: Array, supply_Pa: float, top_pressures: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """Of a platform MEASURED_TICKS ago: mobility over each leg's own (n_legs, n_legs), and (n_legs,) each: load by pose and speeds
        [m/s2], forces [N], speeds [m/s]. A reading that is missing stands for the one before. None where no compensator feels them."""
        if self.pose_load is None:
            return np.zeros((len(positions), 0)), np.zeros(len(positions)), NO_LOAD, NO_LOAD
        forces = pressures * self.areas[0] - (supply_Pa if top_pressures is None else top_pressures) * self.areas[1]
        now = np.array((positions, forces))
        if not len(self._seen):
            self._seen = np.tile(now, (SPAN, 1, 1))
        now = np.where(np.isfinite(now), now, self._seen[-1])
        self._seen = np.concatenate((self._seen[1:], now[None]))
        then = self._seen[MEASURED_TICKS]
        speeds = SLOPE @ self._seen[:, 0] / self._tick_s
        return *self.pose_load.at(then[0], speeds), then[1], speeds

    def engagement(self) -> list[dict[str, Any]]:
        """Of each leg that has a compensator: whether it is engaged, since when first [s], for which share of the ticks it has added
        volts (those of a probe too), and if it is not, which criterion keeps it out."""
        found = []
        for i, (made, state) in enumerate(zip(self.compensators, self.states, strict=True)):
            reason, first = made.not_engaged(state), None if np.isnan(self.first_s[i]) else float(self.first_s[i])
            if not reason and first is None:
                reason = "no tick with a pressure reading" if self.ticks[0] == 0 else "it has added no volts"
            share = float(self.added_ticks[i] / max(self.ticks[0], 1))
            found.append(
                {"leg": i + 1, "engaged": not reason, "engaged_at_s": first, "engaged_share": share, "reason": reason}
            )
        return found

    def learned(self) -> list[dict[str, Any]]:
        """What each compensator has learned."""
        return [c.parameters(s) for c, s in zip(self.compensators, self.states, strict=True)]
