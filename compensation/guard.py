"""What stands between any algorithm and the valve: faults of sensors and valve, bounds, and a way back.

While the signals are sound the algorithm runs. When a signal is lost or frozen, or the valve stands at its end, the
volts that were last added fade to nothing within `FADE_TICKS` ticks and plain control goes on alone; the algorithm
sees none of it. When the signals were sound again for `CALM_S`, the algorithm starts afresh with what it had
learned, faded in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .base import Compensator, Context, Parameters, Sample, clip

FADE_TICKS = 12  # 24 ms at 500 Hz
FROZEN_TICKS = 10  # so often the very same reading, while the setpoint moved, is a dead sensor
FROZEN_TRAVEL_M = 1e-4  # how far the setpoint must have moved meanwhile
CLIPPED_TICKS = 5
CALM_S = 0.5
RETURN_S = 1.0


@dataclass(slots=True)
class GuardState:
    context: Context
    inner: Any
    position_m: float = 0.0
    pressure_Pa: float = 0.0
    position_since: int = 0  # ticks with the same reading
    pressure_since: int = 0
    position_from_m: float = 0.0  # setpoint when the reading last changed
    pressure_from_m: float = 0.0
    clipped: int = 0
    output_V: float = 0.0
    held_V: float = 0.0  # what fades
    fade: int = 0  # ticks of it left
    calm: int = 0  # ticks still to wait; 0 = the algorithm acts
    share: float = 1.0
    reason: str = ""


@dataclass(frozen=True)
class Guarded(Compensator):
    """An algorithm behind the guard. `registry.create` hands out every algorithm so."""

    inner: Compensator

    @property
    def name(self) -> str:  # type: ignore[override]
        """The algorithm's own name."""
        return self.inner.name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """The algorithm's own preview [s]."""
        return self.inner.preview_s

    def start(self, context: Context) -> GuardState:
        return GuardState(context, self.inner.start(context))

    def step(self, state: GuardState, sample: Sample) -> tuple[float, GuardState]:
        reason = _fault(state, sample)
        if reason:
            if state.calm == 0:
                state.held_V, state.fade = state.output_V, FADE_TICKS
            state.reason = reason
            state.calm = max(1, round(CALM_S * state.context.rate_Hz))
        if state.calm:
            return self._fall_back(state), state
        added, state.inner = self.inner.step(state.inner, sample)
        if added - added != 0.0:
            added = 0.0
        if state.share < 1.0:
            state.share = min(1.0, state.share + state.context.tick_s / RETURN_S)
            added *= state.share
        limit = state.context.voltage_max_V
        state.output_V = clip(added, -limit, limit)
        return state.output_V, state

    def _fall_back(self, state: GuardState) -> float:
        state.fade = max(0, state.fade - 1)
        x = state.fade / FADE_TICKS
        state.output_V = state.held_V * x * x * (3.0 - 2.0 * x)
        state.calm -= 1
        if state.calm == 0:
            state.inner = self.inner.restore(state.context, self.inner.parameters(state.inner))
            state.share, state.reason = 0.0, ""
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
    if position == state.position_m:
        state.position_since += 1
        if state.position_since >= FROZEN_TICKS and abs(sample.setpoint_m - state.position_from_m) > FROZEN_TRAVEL_M:
            return "the position signal is frozen: plain control until it moves again"
    else:
        state.position_m, state.position_since, state.position_from_m = position, 0, sample.setpoint_m
    if pressure == state.pressure_Pa:
        state.pressure_since += 1
        if state.pressure_since >= FROZEN_TICKS and abs(sample.setpoint_m - state.pressure_from_m) > FROZEN_TRAVEL_M:
            return "the pressure signal is frozen: plain control until it moves again"
    else:
        state.pressure_Pa, state.pressure_since, state.pressure_from_m = pressure, 0, sample.setpoint_m
    if abs(sample.valve_V) >= 0.999 * state.context.voltage_max_V:
        state.clipped += 1
        if state.clipped >= CLIPPED_TICKS:
            return "the valve is at its end: plain control until it is not"
    else:
        state.clipped = 0
    return ""
