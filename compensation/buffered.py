# pyright: reportPrivateImportUsage=false
# (numba does not list its own functions)
"""The report's second algorithm (5.5, appendix C): parameters computed from buffers; and its chapter 6 form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np

from .arithmetic import clip
from .compensator import Context, Parameters
from .compiled import compiled, in_its_caller
from .iterative import FITS
from .learned_parameters import beyond_volts
from .report_functions import MOST_RANGES, RANGE, check_function, compensation_V
from .rows import RowCompensator, RowState, V, all_are_finite, estimate_velocity, start_estimate


class B(IntEnum):
    """Places in a row."""

    FUNCTION = 0  # 1 or 2
    RANGE = 1  # b q of it
    REPORT = 2  # 1: the report's form
    CURVES = 3  # 1 or 2
    FILTER = 4  # share of the buffers' low pass, a tick
    SLOPE = 5  # s [m/s/V]; 0: estimated
    A_MAX = 6
    Q_START = 7
    SHARE = 8
    RATE = 9  # by which parameters follow, a tick
    LIMIT = 10  # [V]
    COUNT = 11  # of samples in the buffers; what is learned begins here
    BLEND = 12  # 0 curve of negative, 1 of positive acceleration
    LINE = 13  # 1: there is one; slope s and crossing q of the desired linear valve behind it
    FILTERS = 16  # valve's volts (report form: control volts), velocity, control volts, sign of the acceleration
    EXTREMES = 20  # max, min of velocity and control volts
    ZEROS = 24  # of each side: sum of volts while the velocity is near 0, and their number
    CURVE = 28  # of each: a [V], q [V], r [V] last computed, and those in use, which follow them smoothly
    ESTIMATE = 40
    BUFFER = 53  # UV, UC and the side of each sample (corrected form: total volts, velocity)


assert B.BUFFER == B.ESTIMATE + V.END


@dataclass(frozen=True, kw_only=True)
class Buffered(RowCompensator):
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

    def new_row(self, context: Context) -> np.ndarray:
        length, tick = round(self.buffer_s * context.rate_Hz), context.tick_s
        row = np.zeros(B.BUFFER + 3 * length)
        row[B.FUNCTION], row[B.RANGE], row[B.REPORT] = self.function, RANGE[self.function], self.form == "report"
        row[B.CURVES], row[B.SLOPE] = 2 if self.two_sided else 1, self.slope_m_s_V or 0.0
        row[B.FILTER] = 1.0 - math.exp(-2 * math.pi * self.filter_Hz * tick)
        row[B.A_MAX], row[B.Q_START], row[B.SHARE] = self.a_max_V, self.q_start_V, self.share
        row[B.RATE], row[B.LIMIT] = min(1.0, tick / self.fade_s), context.voltage_max_V
        start_estimate(row[B.ESTIMATE : B.BUFFER], context.rate_Hz, self.velocity_bandwidth_Hz)
        return row

    def functions(self) -> tuple[Any, Any]:
        return tick, is_sound

    def parameters(self, state: RowState) -> Parameters:
        curves = [curve_of(state.row, number)[:3].tolist() for number in range(2 if self.two_sided else 1)]
        return {"function": self.function, "curves": curves}

    def refused(self, context: Context, parameters: Parameters) -> str:
        curves = parameters["curves"]
        if len(curves) != (2 if self.two_sided else 1) or any(len(curve) != 3 for curve in curves):
            return f"curves must be {2 if self.two_sided else 1} of three numbers each, for '{self.name}'"
        every = {"curves": [x for curve in curves for x in curve]}
        return beyond_volts(every, ("curves",), MOST_RANGES * context.voltage_max_V)

    def restore(self, context: Context, parameters: Parameters) -> RowState:
        state = self.start(context)
        for number, curve in enumerate(parameters["curves"]):
            curve_of(state.row, number)[:3] = curve
        return state


@in_its_caller
def curve_of(row, number):
    """The numbers of a curve."""
    each = (B.ESTIMATE - B.CURVE) // 2
    return row[B.CURVE + each * number :][:each]


@compiled
def tick(row, control_V, valve_V, position_m, bottom_Pa):
    """Volts to add."""
    u = control_V
    if not (math.isfinite(u) and math.isfinite(valve_V)):
        return 0.0
    part = row[B.ESTIMATE : B.BUFFER]
    previous = part[V.CONTROL]
    if estimate_velocity(part, position_m, valve_V, u):
        collect(row, part[V.FOUND], part[V.FOUND + 1], part[V.FOUND + 2], u > previous)
    return output(row, u)


@compiled
def output(row, u):
    """The curves' volts at a control voltage."""
    value = 0.0
    for number in range(int(row[B.CURVES])):
        c = curve_of(row, number)
        for i in range(3):
            c[3 + i] += row[B.RATE] * (c[i] - c[3 + i])
        a, q, r = c[3], c[4], c[5]
        share = 1.0 if row[B.CURVES] == 1.0 else (row[B.BLEND] if number == 1 else 1.0 - row[B.BLEND])
        if a > 0.0 and q > 0.0:
            b = row[B.RANGE] / max(q, 1e-3)
            value += share * compensation_V(row[B.FUNCTION], clip(u, -2.0 * q, 2.0 * q), a, b, b * r)
    return clip(value, -row[B.LIMIT], row[B.LIMIT])


@compiled
def slope(row):
    """Slope s [m/s/V] of the desired linear valve; 0 while nothing has moved."""
    if row[B.SLOPE] != 0.0:
        return row[B.SLOPE]
    ex = row[B.EXTREMES : B.ZEROS]
    return (ex[0] - ex[1]) / (ex[2] - ex[3]) if ex[2] - ex[3] > 0.2 * row[B.Q_START] else 0.0


@compiled
def collect(row, v, valve, u, rising):
    """One sample into the buffers; at their end parameters from them."""
    k, f, ex, length = row[B.FILTER], row[B.FILTERS :], row[B.EXTREMES :], (len(row) - B.BUFFER) // 3
    as_reported = row[B.REPORT] == 1.0
    volts = u if as_reported else valve
    f[0] += k * (volts - f[0])
    f[1] += k * (v - f[1])
    f[2] += k * (u - f[2])
    f[3] += k * ((1.0 if rising else -1.0) - f[3])
    ex[0], ex[1], ex[2], ex[3] = max(ex[0], f[1]), min(ex[1], f[1]), max(ex[2], f[2]), min(ex[3], f[2])
    side = 1 if f[3] > 0.0 else 0
    row[B.BLEND] += k * (side - row[B.BLEND])
    at = B.BUFFER + int(row[B.COUNT])
    row[at], row[at + length], row[at + 2 * length] = f[0], f[1], side
    row[B.COUNT] += 1.0
    if abs(v) <= FITS.zero_velocity_m_s:
        row[B.ZEROS + 2 * side] += volts
        row[B.ZEROS + 2 * side + 1] += 1.0
    if row[B.COUNT] < length:
        return
    s = slope(row)
    if s > 0.0:
        if as_reported:
            compute_as_reported(row, s, length)
        else:
            compute(row, s, length)
    row[B.COUNT] = 0.0
    for i in range(4):
        row[B.ZEROS + i] = 0.0
        if not as_reported:
            row[B.EXTREMES + i] = 0.0


@compiled
def compute_as_reported(row, s, n):
    """a, q and r from the buffers; a and 1/q may only grow."""
    volts, velocity = row[B.BUFFER :], row[B.BUFFER + n :]
    a, largest = -math.inf, 0.0
    for i in range(n):
        weight = 1.0 / (1.0 + math.exp(-10.0 / n * (i + 1)))  # appendix C; Eq. 5.4 has 10 / (2 l)
        a = max(a, weight * (volts[i] - velocity[i] / s))
        largest = max(largest, abs(weight * volts[i]))
    zeros = row[B.ZEROS + 1] + row[B.ZEROS + 3]
    middle = (row[B.ZEROS] + row[B.ZEROS + 2]) / zeros if zeros > 0.0 else 0.0
    b = 1.0 / largest
    for number in range(int(row[B.CURVES])):
        c = curve_of(row, number)
        b = max(b, 1.0 / c[1] if c[1] > 0.0 else 0.0)
        c[0], c[1], c[2] = max(a, c[0]), 1.0 / b, middle


@compiled
def compute(row, s, n):
    """a [V], q [V] and r [V] of each curve by least squares over the buffer, the newest samples weighing most."""
    volts, velocity, sides = row[B.BUFFER :], row[B.BUFFER + n :], row[B.BUFFER + 2 * n :]
    q = max(row[B.Q_START], (row[B.EXTREMES + 2] - row[B.EXTREMES + 3]) / 2.0)
    if row[B.LINE] == 1.0:  # averaged: the line must not follow its own compensation
        s = row[B.LINE + 1] + row[B.SHARE] * (s - row[B.LINE + 1])
        q = row[B.LINE + 2] + row[B.SHARE] * (q - row[B.LINE + 2])
    row[B.LINE], row[B.LINE + 1], row[B.LINE + 2] = 1.0, s, q
    b, two_sided, limit = row[B.RANGE] / q, row[B.CURVES] == 2.0, row[B.A_MAX]
    for number in range(int(row[B.CURVES])):
        c = curve_of(row, number)
        r = c[2]
        middle = mean_at_zero(row, number) if two_sided else (mean_at_zero(row, 0) + mean_at_zero(row, 1)) / 2.0
        if math.isfinite(middle):
            r += row[B.SHARE] * (clip(middle, -limit, limit) - r)
        power = product = 0.0
        for i in range(n):
            if abs(velocity[i]) < s * q and (not two_sided or sides[i] == number):
                w = velocity[i] / s + r
                shape = compensation_V(row[B.FUNCTION], w, 1.0, b, b * r)
                weight = 1.0 / (1.0 + math.exp(-10.0 * (i / (n - 1) - 0.5)))
                power += weight * shape * shape
                product += weight * shape * (volts[i] - w)
        if power >= 1e-3 * n:
            c[0], c[1], c[2] = clip(product / power, 0.0, limit), q, r


@compiled
def mean_at_zero(row, side):
    """Volts while the velocity was near 0 on one side; NaN where it never was."""
    return row[B.ZEROS + 2 * side] / row[B.ZEROS + 2 * side + 1]


@compiled
def is_sound(row):
    """Of the buffers the newest: what came in before was looked at then."""
    length, newest = (len(row) - B.BUFFER) // 3, B.BUFFER + max(int(row[B.COUNT]) - 1, 0)
    total = row[newest] + row[newest + length]
    return total - total == 0.0 and all_are_finite(row, B.COUNT, B.BUFFER)
