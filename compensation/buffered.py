"""The report's second algorithm (5.5, appendix C): parameters computed from buffers; and its chapter 6 form."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .compensator import Compensator, Context, Parameters, Sample, all_finite, clip
from .iterative import ZERO_VELOCITY_M_S
from .learned_parameters import beyond_volts
from .report_functions import FUNCTIONS, MOST_RANGES, RANGE, check_function
from .velocity_estimate import VelocityEstimate


@dataclass(slots=True)
class Curve:
    """Parameters of one compensation curve: those last computed, and those in use, which follow them smoothly."""

    target: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # a [V], q [V], r [V]
    active: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])


@dataclass(slots=True)
class BufferedState:
    context: Context
    estimate: VelocityEstimate
    curves: list[Curve]  # one, or two: for negative and for positive acceleration
    valve_V: list[float] = field(default_factory=list)  # UV of the report (corrected form: total volts)
    other: list[float] = field(default_factory=list)  # UC of the report (corrected form: velocity)
    side: list[int] = field(default_factory=list)  # which curve a sample belongs to
    zero_V: list[list[float]] = field(default_factory=lambda: [[], []])  # UY: volts while the velocity is near 0
    filters: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    extremes: list[float] = field(default_factory=lambda: [0.0] * 4)
    line: tuple[float, float] | None = None  # slope s and crossing q of the desired linear valve
    blend: float = 0.0  # 0 curve of negative, 1 of positive acceleration
    updates: int = 0


@dataclass(frozen=True, kw_only=True)
class Buffered(Compensator):
    """Function of Eq. 5.2 or 5.3, its parameters computed from buffers of 3 s, then faded in.

    Report form: a = max of the filtered, weighted u - v/s, b = 1/max|u|, c = b mean(u at v = 0). a and b may only
    grow. The weighting of Eq. 5.4 as coded in appendix C multiplies the values. u is the control voltage before the
    correction.

    Corrected form (default): the curve is fitted by weighted least squares against the total valve voltage. q may
    fall, r is the mean, all are bounded.

    two_sided: a curve each for positive and negative acceleration (report chapter 6), for valves with hysteresis.
    buffer_s: time between two computations. share: weight of a new buffer in the line (s, q) and in r; lower values
    average more, for few samples lie near zero velocity. filter_Hz: low-pass of the buffers. slope_m_s_V: as in
    Iterative. fade_s: time constant by which new parameters come in.
    """

    name: str = "buffered"
    place = 3
    variants: ClassVar[dict[str, dict[str, Any]]] = {
        "buffered_report": {"form": "report"},
        "buffered_two_sided": {"two_sided": True},
    }
    function: int = 2
    form: str = "corrected"
    two_sided: bool = False
    buffer_s: float = 3.0
    filter_Hz: float = 5.0
    slope_m_s_V: float | None = None
    a_max_V: float = 1.0
    q_start_V: float = 0.5
    share: float = 0.3
    fade_s: float = 0.5
    velocity_bandwidth_Hz: float | None = None

    def __post_init__(self) -> None:
        check_function(self.function)
        if self.form not in ("report", "corrected"):
            raise ValueError(f"form '{self.form}' does not exist; choose report or corrected")

    def start(self, context: Context) -> BufferedState:
        curves = [Curve() for _ in range(2 if self.two_sided else 1)]
        return BufferedState(context, VelocityEstimate(context.rate_Hz, self.velocity_bandwidth_Hz), curves)

    def step(self, state: BufferedState, sample: Sample) -> tuple[float, BufferedState]:
        u = sample.control_V
        if not (math.isfinite(u) and math.isfinite(sample.valve_V)):
            return 0.0, state
        previous = state.estimate.control_V
        measured = state.estimate.update(sample.position_m, sample.valve_V, u)
        if measured is not None:
            self._collect(state, *measured, rising=u > previous)
        return self._output(state, u), state

    def _output(self, state: BufferedState, u: float) -> float:
        rate = min(1.0, state.context.tick_s / self.fade_s)
        value = 0.0
        for number, curve in enumerate(state.curves):
            active, target = curve.active, curve.target
            for i in range(3):
                active[i] += rate * (target[i] - active[i])
            a, q, r = active
            share = 1.0 if len(state.curves) == 1 else (state.blend if number else 1.0 - state.blend)
            if a > 0.0 and q > 0.0:
                b = RANGE[self.function] / max(q, 1e-3)
                value += share * FUNCTIONS[self.function](clip(u, -2 * q, 2 * q), a, b, b * r)
        limit = state.context.voltage_max_V
        return clip(value, -limit, limit)

    def slope(self, state: BufferedState) -> float:
        """Slope s [m/s/V] of the desired linear valve; 0 while nothing has moved."""
        if self.slope_m_s_V is not None:
            return self.slope_m_s_V
        v_max, v_min, u_max, u_min = state.extremes
        return (v_max - v_min) / (u_max - u_min) if u_max - u_min > 0.2 * self.q_start_V else 0.0

    def _collect(self, state: BufferedState, v: float, valve: float, u: float, rising: bool) -> None:
        context, f, ex = state.context, state.filters, state.extremes
        k = 1.0 - math.exp(-2 * math.pi * self.filter_Hz * context.tick_s)
        f[0] += k * ((u if self.form == "report" else valve) - f[0])
        f[1] += k * (v - f[1])
        f[2] += k * (u - f[2])
        f[3] += k * ((1.0 if rising else -1.0) - f[3])
        ex[0], ex[1], ex[2], ex[3] = max(ex[0], f[1]), min(ex[1], f[1]), max(ex[2], f[2]), min(ex[3], f[2])
        side = 1 if f[3] > 0 else 0
        state.blend += k * (side - state.blend)
        state.valve_V.append(f[0])
        state.other.append(f[1])
        state.side.append(side)
        if abs(v) <= ZERO_VELOCITY_M_S:
            state.zero_V[side].append(u if self.form == "report" else valve)
        if len(state.valve_V) >= round(self.buffer_s * context.rate_Hz):
            s = self.slope(state)
            if s > 0.0:
                self._compute_report(state, s) if self.form == "report" else self._compute(state, s)
                state.updates += 1
            self._clear(state)

    def _clear(self, state: BufferedState) -> None:
        state.valve_V, state.other, state.side, state.zero_V = [], [], [], [[], []]
        if self.form == "corrected":
            state.extremes = [0.0] * 4

    def _compute_report(self, state: BufferedState, s: float) -> None:
        length = len(state.valve_V)
        weight = 1.0 / (1.0 + np.exp(-10.0 / length * np.arange(1, length + 1)))  # appendix C; Eq. 5.4 has 10 / (2 l)
        u = np.array(state.valve_V)
        a = float(np.max(weight * (u - np.array(state.other) / s)))
        b = 1.0 / float(np.max(np.abs(weight * u)))
        zero = state.zero_V[0] + state.zero_V[1]
        for curve in state.curves:
            old_a, old_q, _ = curve.target
            b = max(b, 1.0 / old_q if old_q > 0 else 0.0)
            curve.target = [max(a, old_a), 1.0 / b, float(np.mean(zero)) if zero else 0.0]

    def _compute(self, state: BufferedState, s: float) -> None:
        """a [V], q [V] and r [V] of each curve by least squares over the buffer, the newest samples weighing most."""
        u, v, side = np.array(state.valve_V), np.array(state.other), np.array(state.side)
        weight = 1.0 / (1.0 + np.exp(-10.0 * (np.linspace(0, 1, len(u)) - 0.5)))
        q = max(self.q_start_V, (state.extremes[2] - state.extremes[3]) / 2)
        if state.line is not None:  # averaged: the line must not follow its own compensation
            s = state.line[0] + self.share * (s - state.line[0])
            q = state.line[1] + self.share * (q - state.line[1])
        state.line = (s, q)
        b = RANGE[self.function] / q
        means = [float(np.mean(zero)) if zero else None for zero in state.zero_V]
        for number, curve in enumerate(state.curves):
            r = means[number] if self.two_sided else _middle(means)
            old = curve.target[2]
            r = old if r is None else old + self.share * (clip(r, -self.a_max_V, self.a_max_V) - old)
            inside = (np.abs(v) < s * q) & ((side == number) if self.two_sided else True)
            w = v[inside] / s + r
            shape = np.array([FUNCTIONS[self.function](x, 1.0, b, b * r) for x in w])
            power = float(np.sum(weight[inside] * shape * shape))
            if power < 1e-3 * len(u):
                continue
            a = float(np.sum(weight[inside] * shape * (u[inside] - w))) / power
            curve.target = [clip(a, 0.0, self.a_max_V), q, r]

    def finite(self, state: BufferedState) -> bool:
        """Of the buffers the newest: what came in before was looked at then. One flat list: its sum tells at once."""
        numbers = [state.blend, *state.estimate.numbers(), *state.filters, *state.extremes, *(state.line or ())]
        for curve in state.curves:
            numbers += curve.target
            numbers += curve.active
        for buffer in (state.valve_V, state.other, *state.zero_V):
            numbers += buffer[-1:]
        return all_finite(numbers)

    def parameters(self, state: BufferedState) -> Parameters:
        return {"function": self.function, "curves": [list(c.target) for c in state.curves]}

    def refused(self, context: Context, parameters: Parameters) -> str:
        curves = parameters["curves"]
        if len(curves) != (2 if self.two_sided else 1) or any(len(curve) != 3 for curve in curves):
            return f"curves must be {2 if self.two_sided else 1} of three numbers each, for '{self.name}'"
        every = {"curves": [x for curve in curves for x in curve]}
        return beyond_volts(every, ("curves",), MOST_RANGES * context.voltage_max_V)

    def restore(self, context: Context, parameters: Parameters) -> BufferedState:
        state = self.start(context)
        state.curves = [Curve(target=[float(x) for x in c]) for c in parameters["curves"]]
        return state


def _middle(means: list[float | None]) -> float | None:
    """Offset from the reversals of both directions, each weighing the same; None unless both occurred."""
    down, up = means
    return None if down is None or up is None else (down + up) / 2
