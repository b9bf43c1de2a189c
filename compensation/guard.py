"""What stands between any algorithm and the valve: detection of sensor and valve faults, bounds, and a way back.

| condition | volts added |
|---|---|
| signals sound | those of the algorithm, within the valve's range |
| a signal lost or frozen, the valve saturated | the last ones, faded to nothing within `FADE_TICKS` |
| until the signals have been sound for `HOLD_OFF_S` | none: plain control; the algorithm is not stepped |
| after that | those of the algorithm, restarted with its parameters, faded in over `RETURN_S` |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import compensator
from .compensator import Context, Parameters, Sample, Wrapped
from .compiled import compiled

FADE_TICKS = 12  # 24 ms at 500 Hz
FROZEN_TICKS = 10  # a reading repeated so often, while the setpoint moved, is a dead sensor
FROZEN_TRAVEL_M = 1e-4  # by which the setpoint must have moved meanwhile
SATURATED_TICKS = 5  # after which a saturated valve is a fault
SATURATED_SHARE = 0.999  # of the voltage range
HOLD_OFF_S = 0.5
RETURN_S = 1.0

SOUND, LOST, POSITION_FROZEN, PRESSURE_FROZEN, VALVE_AT_END = 0, 8, 16, 32, 64
SENTENCES = {
    SOUND: "",
    LOST: "a signal is lost (not a number): plain control until it is sound again",
    POSITION_FROZEN: "the position signal is frozen: plain control until it moves again",
    PRESSURE_FROZEN: "the pressure signal is frozen: plain control until it moves again",
    VALVE_AT_END: "the valve is at its end: plain control until it is not",
}
ACTS, FALLS_BACK, RESTARTS = 0, 1, 2  # the algorithm is stepped; is not; is to be started with its parameters

# The last reading of a transducer, for how many ticks it has repeated, and the setpoint when it came.
READING = np.dtype((np.record, [("value", "f8"), ("repeated", "i8"), ("setpoint_m", "f8")]))
GUARD = np.dtype(
    (
        np.record,
        [
            ("tick_s", "f8"), ("voltage_max_V", "f8"), ("position", READING), ("pressure", READING),
            ("top_pressure", READING),
            ("saturated_ticks", "i8"), ("output_V", "f8"), ("fade_from_V", "f8"), ("fade_ticks", "i8"),  # left
            ("hold_off_ticks", "i8"),  # left; 0 = the algorithm acts
            ("fade_in", "f8"), ("reason", "i8"),
        ],
    )
)  # fmt: skip
clip = compiled(compensator.clip)


@compiled
def start_guard(guard, tick_s, voltage_max_V):
    """guard: a record GUARD, zero."""
    guard.tick_s, guard.voltage_max_V, guard.fade_in = tick_s, voltage_max_V, 1.0


@compiled
def check(guard, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """One tick: ACTS, or else `guard.output_V` is what is added. RESTARTS: from the next tick on the algorithm acts."""
    reason = _fault(guard, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)
    if reason != SOUND:
        if guard.hold_off_ticks == 0:
            guard.fade_from_V, guard.fade_ticks = guard.output_V, FADE_TICKS
        guard.reason = reason
        guard.hold_off_ticks = max(1, round(HOLD_OFF_S / guard.tick_s))
    if guard.hold_off_ticks == 0:
        return ACTS
    guard.fade_ticks = max(0, guard.fade_ticks - 1)
    x = guard.fade_ticks / FADE_TICKS
    guard.output_V = guard.fade_from_V * x * x * (3.0 - 2.0 * x)
    guard.hold_off_ticks -= 1
    if guard.hold_off_ticks > 0:
        return FALLS_BACK
    guard.fade_in, guard.reason = 0.0, SOUND
    return RESTARTS


@compiled
def accept(guard, added_V):
    """The algorithm's volts as they are added: finite, bounded, faded in after a fault."""
    if added_V - added_V != 0.0:
        added_V = 0.0
    if guard.fade_in < 1.0:
        guard.fade_in = min(1.0, guard.fade_in + guard.tick_s / RETURN_S)
        added_V *= guard.fade_in
    guard.output_V = clip(added_V, -guard.voltage_max_V, guard.voltage_max_V)
    return guard.output_V


@compiled
def _frozen(reading, value, setpoint_m):
    """Takes the reading of this tick; whether it stands still although the setpoint moves."""
    if value != reading.value:
        reading.value, reading.repeated, reading.setpoint_m = value, 0, setpoint_m
        return False
    reading.repeated += 1
    return reading.repeated >= FROZEN_TICKS and abs(setpoint_m - reading.setpoint_m) > FROZEN_TRAVEL_M


@compiled
def _fault(guard, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """What is wrong with this tick's signals."""
    total = position_m + bottom_Pa + top_Pa + supply_Pa + control_V + valve_V + setpoint_m
    if total - total != 0.0:
        return LOST
    if _frozen(guard.position, position_m, setpoint_m):
        return POSITION_FROZEN
    if _frozen(guard.pressure, bottom_Pa, setpoint_m):
        return PRESSURE_FROZEN
    if top_Pa != 0.0 and _frozen(guard.top_pressure, top_Pa, setpoint_m):
        return PRESSURE_FROZEN
    if abs(valve_V) < SATURATED_SHARE * guard.voltage_max_V:
        guard.saturated_ticks = 0
        return SOUND
    guard.saturated_ticks += 1
    return VALVE_AT_END if guard.saturated_ticks >= SATURATED_TICKS else SOUND


@compiled
def check_first(guards, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """`check` of guards (1,): Python hands an array over four times as fast as a record."""
    return check(guards[0], setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)


@compiled
def accept_first(guards, added_V):
    """`accept` of guards (1,)."""
    return accept(guards[0], added_V)


@dataclass(slots=True)
class GuardState:
    context: Context
    inner: Any
    guards: np.ndarray  # (1,) of GUARD
    reason: int = SOUND
    acted: bool = False  # the algorithm, at the last step


@dataclass(frozen=True)
class Guarded(Wrapped):
    """An algorithm behind the guard. `registry.create` returns every algorithm so."""

    def start(self, context: Context) -> GuardState:
        return self._around(context, self.inner.start(context))

    def _around(self, context: Context, inner: Any) -> GuardState:
        guards = np.zeros(1, GUARD)
        start_guard(guards[0], context.tick_s, context.voltage_max_V)
        return GuardState(context, inner, guards)

    def step(self, state: GuardState, sample: Sample) -> tuple[float, GuardState]:
        todo = check_first(
            state.guards, sample.setpoint_m, sample.position_m, sample.control_V, sample.valve_V, sample.pressure_bottom_Pa,
            sample.pressure_top_Pa, sample.pressure_supply_Pa,
        )  # fmt: skip
        state.acted = todo == ACTS
        if state.acted:
            added, state.inner = self.inner.step(state.inner, sample)
            return accept_first(state.guards, float(added)), state
        guard = state.guards[0]
        state.reason = int(guard.reason)
        if todo == RESTARTS:
            state.inner = self.inner.resume(state.context, self.inner.parameters(state.inner))
        return float(guard.output_V), state

    def parameters(self, state: GuardState) -> Parameters:
        return self.inner.parameters(state.inner)

    def restore(self, context: Context, parameters: Parameters) -> GuardState:
        return self._around(context, self.inner.restore(context, parameters))

    def resume(self, context: Context, parameters: Parameters) -> GuardState:
        return self._around(context, self.inner.resume(context, parameters))

    def preview_of(self, state: GuardState) -> float:
        return self.inner.preview_of(state.inner)

    def tells(self, state: GuardState) -> bool:
        return state.acted and self.inner.tells(state.inner)

    def hear(self, state: GuardState, other: GuardState) -> None:
        self.inner.hear(state.inner, other.inner)

    def status(self, state: GuardState) -> str:
        return SENTENCES[state.reason] or self.inner.status(state.inner)
