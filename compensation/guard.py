"""What stands between any algorithm and the valve: detection of sensor and valve faults, bounds, and a way back.

| condition | volts added |
|---|---|
| signals sound | those of the algorithm, within the valve's range |
| a signal lost or frozen, the valve saturated | the last ones, faded to nothing within `FADE_TICKS` |
| until the signals have been sound for `HOLD_OFF_S` | none: plain control; the algorithm is not stepped |
| after that | those of the algorithm, restarted with its parameters, faded in over `RETURN_S` |
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .compensator import Compensator, Context, Parameters, Sample, clip

FADE_TICKS = 12  # 24 ms at 500 Hz
FROZEN_TICKS = 10  # a reading repeated so often, while the setpoint moved, is a dead sensor
FROZEN_TRAVEL_M = 1e-4  # by which the setpoint must have moved meanwhile
SATURATED_TICKS = 5  # after which a saturated valve is a fault
SATURATED_SHARE = 0.999  # of the voltage range
HOLD_OFF_S = 0.5
RETURN_S = 1.0


@dataclass(slots=True)
class Reading:
    """The last reading of a transducer, for how many ticks it has repeated, and the setpoint when it came."""

    value: float = 0.0
    repeated: int = 0
    setpoint_m: float = 0.0

    def frozen(self, value: float, setpoint_m: float) -> bool:
        """Takes the reading of this tick; whether it stands still although the setpoint moves."""
        if value != self.value:
            self.value, self.repeated, self.setpoint_m = value, 0, setpoint_m
            return False
        self.repeated += 1
        return self.repeated >= FROZEN_TICKS and abs(setpoint_m - self.setpoint_m) > FROZEN_TRAVEL_M


@dataclass(slots=True)
class GuardState:
    context: Context
    inner: Any
    position: Reading = field(default_factory=Reading)
    pressure: Reading = field(default_factory=Reading)
    saturated_ticks: int = 0
    output_V: float = 0.0
    fade_from_V: float = 0.0
    fade_ticks: int = 0  # left
    hold_off_ticks: int = 0  # left; 0 = the algorithm acts
    fade_in: float = 1.0
    reason: str = ""


@dataclass(frozen=True)
class Guarded(Compensator):
    """An algorithm behind the guard. `registry.create` returns every algorithm so."""

    inner: Compensator

    @property
    def name(self) -> str:  # type: ignore[override]
        """The algorithm's own name."""
        return self.inner.name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """The algorithm's own preview [s]."""
        return self.inner.preview_s

    @property
    def description(self) -> str:
        """The algorithm's own description."""
        return self.inner.description

    def start(self, context: Context) -> GuardState:
        return GuardState(context, self.inner.start(context))

    def step(self, state: GuardState, sample: Sample) -> tuple[float, GuardState]:
        reason = _fault(state, sample)
        if reason:
            if state.hold_off_ticks == 0:
                state.fade_from_V, state.fade_ticks = state.output_V, FADE_TICKS
            state.reason = reason
            state.hold_off_ticks = max(1, round(HOLD_OFF_S * state.context.rate_Hz))
        if state.hold_off_ticks:
            return self._fall_back(state), state
        added, state.inner = self.inner.step(state.inner, sample)
        if added - added != 0.0:  # not finite
            added = 0.0
        if state.fade_in < 1.0:
            state.fade_in = min(1.0, state.fade_in + state.context.tick_s / RETURN_S)
            added *= state.fade_in
        limit = state.context.voltage_max_V
        state.output_V = clip(added, -limit, limit)
        return state.output_V, state

    def _fall_back(self, state: GuardState) -> float:
        state.fade_ticks = max(0, state.fade_ticks - 1)
        x = state.fade_ticks / FADE_TICKS
        state.output_V = state.fade_from_V * x * x * (3.0 - 2.0 * x)
        state.hold_off_ticks -= 1
        if state.hold_off_ticks == 0:
            state.inner = self.inner.restore(state.context, self.inner.parameters(state.inner))
            state.fade_in, state.reason = 0.0, ""
        return state.output_V

    def parameters(self, state: GuardState) -> Parameters:
        return self.inner.parameters(state.inner)

    def restore(self, context: Context, parameters: Parameters) -> GuardState:
        return GuardState(context, self.inner.restore(context, parameters))

    def status(self, state: GuardState) -> str:
        return state.reason or self.inner.status(state.inner)


def _fault(state: GuardState, sample: Sample) -> str:
    """A sentence about what is wrong with this sample, or nothing."""
    position, pressure = sample.position_m, sample.pressure_bottom_Pa
    total = position + pressure + sample.pressure_supply_Pa + sample.control_V + sample.valve_V + sample.setpoint_m
    if total - total != 0.0:
        return "a signal is lost (not a number): plain control until it is sound again"
    if state.position.frozen(position, sample.setpoint_m):
        return "the position signal is frozen: plain control until it moves again"
    if state.pressure.frozen(pressure, sample.setpoint_m):
        return "the pressure signal is frozen: plain control until it moves again"
    if abs(sample.valve_V) >= SATURATED_SHARE * state.context.voltage_max_V:
        state.saturated_ticks += 1
        if state.saturated_ticks >= SATURATED_TICKS:
            return "the valve is at its end: plain control until it is not"
    else:
        state.saturated_ticks = 0
    return ""
