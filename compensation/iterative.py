"""The report's iterative algorithm (5.3, 5.4): a function fitted to a buffer over the valve voltage."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .compensator import Compensator, Context, Parameters, Sample, all_finite, clip
from .learned_parameters import beyond_volts
from .report_functions import FUNCTIONS, MOST_RANGES, RANGE, check_function
from .velocity_estimate import VelocityEstimate

ZERO_VELOCITY_M_S = 1e-3  # "k- <= v <= k+", report 5.3


@dataclass(slots=True)
class IterativeState:
    context: Context
    estimate: VelocityEstimate
    table_V: list[float]  # (elements,) computed compensation over -voltage_max .. voltage_max
    visits: list[int]  # (elements,) (elements,) updates of each element
    element: int = -1
    a_V: float = 0.0
    q_V: float = 0.0
    r_V: float = 0.0
    active: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # a, q, r as they act, low-passed
    extremes: list[float] = field(default_factory=lambda: [0.0] * 6)  # max, min of v, u and of u at v = 0
    control_V: float = 0.0
    time_s: float = 0.0
    update: int = 0


@dataclass(frozen=True, kw_only=True)
class Iterative(Compensator):
    """Function of Eq. 5.2 or 5.3, its parameters read from an iteratively updated buffer of 1001 elements.

    Report form: each time the control voltage enters another element, the element grows by gain (s u - v). a is the
    largest value ever found, q the largest control voltage. Nothing is bounded.

    Corrected form (default): w = v/s + r is the control voltage that should have given v. Its element is updated
    towards the compensation it needs, u_valve - w. a is fitted to the elements visited, q and r forget, all are
    bounded.

    function: 1 (Eq. 5.2) or 2 (Eq. 5.3). offset: r from the control voltage while v is near 0, as "mean" (appendix C)
    or "half width" (as 5.3 prints it; report form). slope_m_s_V: slope s of the desired linear valve; None estimates it
    as (max v - min v)/(max u - min u). gain: V per m/s a visit (report) or fraction a visit (corrected); higher learns
    faster and takes up more noise. q_start_V: lower bound of q. velocity_bandwidth_Hz: low-pass of v and u alike; None
    for none.
    """

    name: str = "iterative"
    place = 2
    variants: ClassVar[dict[str, dict[str, Any]]] = {
        "iterative_report_1": {"function": 1, "form": "report"},
        "iterative_report_2": {"function": 2, "form": "report"},
    }
    function: int = 2
    form: str = "corrected"
    elements: int = 1001
    gain: float | None = None
    slope_m_s_V: float | None = None
    q_start_V: float = 0.5
    offset: str = "mean"
    a_max_V: float = 1.0
    memory_s: float = 10.0
    fade_s: float = 1.0
    velocity_bandwidth_Hz: float | None = 20.0

    def __post_init__(self) -> None:
        check_function(self.function)
        if self.form not in ("report", "corrected"):
            raise ValueError(f"form '{self.form}' does not exist; choose report or corrected")
        if self.offset not in ("mean", "half width"):
            raise ValueError(f"offset '{self.offset}' does not exist; choose mean or half width")

    def start(self, context: Context) -> IterativeState:
        estimate = VelocityEstimate(context.rate_Hz, self.velocity_bandwidth_Hz)
        state = IterativeState(context, estimate, [0.0] * self.elements, [0] * self.elements, q_V=self.q_start_V)
        state.active[1] = self.q_start_V
        return state

    def step(self, state: IterativeState, sample: Sample) -> tuple[float, IterativeState]:
        u = sample.control_V
        if not (math.isfinite(u) and math.isfinite(sample.valve_V)):
            return 0.0, state
        state.time_s += state.context.tick_s
        measured = state.estimate.update(sample.position_m, sample.valve_V, u)
        if measured is not None:
            if self.form == "report":
                self._learn_report(state, *measured)
            else:
                self._learn_corrected(state, *measured)
        active, rate = state.active, min(1.0, state.context.tick_s / self.fade_s)
        for i, target in enumerate((state.a_V, state.q_V, state.r_V)):
            active[i] += rate * (target - active[i])
        a, q, r = active
        b = RANGE[self.function] / max(q, self.q_start_V)
        value = FUNCTIONS[self.function](clip(u, -2 * q, 2 * q), a, b, b * r)
        limit = state.context.voltage_max_V
        return clip(value, -limit, limit), state

    def slope(self, state: IterativeState) -> float:
        """Slope s [m/s/V] of the desired linear valve; 0 while nothing has moved."""
        if self.slope_m_s_V is not None:
            return self.slope_m_s_V
        v_max, v_min, u_max, u_min = state.extremes[:4]
        return (v_max - v_min) / (u_max - u_min) if u_max - u_min > 0.5 * self.q_start_V else 0.0

    def _index(self, state: IterativeState, u: float) -> int:
        half = self.elements // 2
        return half + round(clip(u / state.context.voltage_max_V, -1.0, 1.0) * half)

    def _learn_report(self, state: IterativeState, v: float, valve: float, u: float) -> None:
        ex = state.extremes
        ex[0], ex[1], ex[2], ex[3] = max(ex[0], v), min(ex[1], v), max(ex[2], u), min(ex[3], u)
        if abs(v) <= ZERO_VELOCITY_M_S and state.time_s > self.fade_s:
            ex[4], ex[5] = max(ex[4], u), min(ex[5], u)
        i = self._index(state, u)
        if i != state.element:
            gain = 0.05 if self.gain is None else self.gain
            state.table_V[i] += gain * (self.slope(state) * u - v)
            state.element = i
            state.a_V = max(state.a_V, state.table_V[i])
        state.q_V = max(state.q_V, (ex[2] - ex[3]) / 2)
        state.r_V = (ex[4] - ex[5]) / 2 if self.offset == "half width" else (ex[4] + ex[5]) / 2

    def _learn_corrected(self, state: IterativeState, v: float, valve: float, u: float) -> None:
        ex, tick = state.extremes, state.context.tick_s
        forget = 1.0 - tick / self.memory_s
        for i, x in ((0, v), (2, u)):
            ex[i], ex[i + 1] = max(ex[i] * forget, x), min(ex[i + 1] * forget, x)
        s = self.slope(state)
        if s <= 0.0:
            return
        if abs(v) <= ZERO_VELOCITY_M_S and ex[0] > 10 * ZERO_VELOCITY_M_S:
            side = 4 if u > state.control_V else 5  # either direction has its mean, so that both weigh the same
            ex[side] += tick / 0.1 * (clip(valve, -self.a_max_V, self.a_max_V) - ex[side])  # mean over 0.1 s at v = 0
            state.r_V = (ex[4] + ex[5]) / 2
        state.control_V = u
        w = v / s + state.r_V
        i = self._index(state, w)
        if i != state.element and abs(v) > 2 * ZERO_VELOCITY_M_S:
            gain = 0.1 if self.gain is None else self.gain
            state.table_V[i] += max(gain, 1 / (1 + state.visits[i])) * (valve - w - state.table_V[i])
            state.visits[i] += 1
            state.element = i
        state.update += 1
        if state.update >= 0.1 / tick:
            state.update = 0
            self._fit(state)

    def _fit(self, state: IterativeState) -> None:
        """a by least squares of the function through the elements visited within -q .. q."""
        state.q_V = max(self.q_start_V, (state.extremes[2] - state.extremes[3]) / 2)
        low, high = self._index(state, -state.q_V), self._index(state, state.q_V) + 1
        visited = np.array(state.visits[low:high]) > 0
        if visited.sum() < 5:
            return
        w = (np.arange(low, high)[visited] - self.elements // 2) * state.context.voltage_max_V / (self.elements // 2)
        b = RANGE[self.function] / state.q_V
        shape = np.array([FUNCTIONS[self.function](x, 1.0, b, b * state.r_V) for x in w])
        table = np.array(state.table_V[low:high])[visited]
        state.a_V = clip(float(shape @ table) / max(float(shape @ shape), 1e-9), 0.0, self.a_max_V)

    def finite(self, state: IterativeState) -> bool:
        """Of the table the element that changed last: the others were looked at when they did. One flat list: its sum tells at once."""
        last = state.table_V[state.element]
        own = (last, state.a_V, state.q_V, state.r_V, state.control_V)
        return all_finite([*own, *state.estimate.numbers(), *state.active, *state.extremes])

    def parameters(self, state: IterativeState) -> Parameters:
        return {
            "function": self.function,
            "a_V": state.a_V,
            "q_V": state.q_V,
            "r_V": state.r_V,
            "table_V": list(state.table_V),
            "visits": list(state.visits),
            "extremes": list(state.extremes),
        }

    def refused(self, context: Context, parameters: Parameters) -> str:
        for name in ("table_V", "visits"):
            if len(parameters[name]) != self.elements:
                return f"{name} has {len(parameters[name])} elements where this compensator has {self.elements}"
        if len(parameters["extremes"]) != 6 or min(parameters["visits"]) < 0:
            return "extremes must be six numbers, and visits not negative"
        names = ("a_V", "q_V", "r_V", "table_V", "extremes")
        return beyond_volts(parameters, names, MOST_RANGES * context.voltage_max_V)

    def restore(self, context: Context, parameters: Parameters) -> IterativeState:
        state = self.start(context)
        state.a_V, state.q_V = float(parameters["a_V"]), float(parameters["q_V"])
        state.r_V = float(parameters["r_V"])
        state.table_V, state.visits = [float(x) for x in parameters["table_V"]], [int(x) for x in parameters["visits"]]
        state.extremes = [float(x) for x in parameters["extremes"]]
        return state
