# pyright: reportPrivateImportUsage=false
# (numba does not list its own functions)
"""The report's iterative algorithm (5.3, 5.4): a function fitted to a buffer over the valve voltage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .arithmetic import clip
from .compensator import Context, Parameters
from .compiled import compiled
from .learned_parameters import beyond_volts
from .report_functions import MOST_RANGES, RANGE, check_function, compensation_V
from .rows import RowCompensator, RowState, V, all_are_finite, estimate_velocity, start_estimate


class Fits(NamedTuple):
    """Constants of the fit of the learned curve."""

    zero_velocity_m_s: float = 1e-3  # "k- <= v <= k+", report 5.3
    every_s: float = 0.1  # between two fits, and of the means at standstill
    fewest: int = 5  # elements that a fit needs


FITS = Fits()


class I(IntEnum):  # noqa: E742
    """Places in a row."""

    FUNCTION = 0  # 1 or 2
    RANGE = 1  # b q of it
    REPORT = 2  # 1: the report's form
    HALF_WIDTH = 3  # 1: r as 5.3 prints it
    UPDATE_GAIN = 4
    SLOPE = 5  # s [m/s/V]; 0: estimated
    Q_START = 6
    A_MAX = 7
    FORGET = 8  # of extremes, a tick
    FADE_S = 9
    TICK = 10  # [s]
    LIMIT = 11  # [V]
    HALF = 12  # elements on either side of the middle one
    ELEMENT = 13  # that was updated last; what is learned begins here
    A = 14
    Q = 15
    R = 16
    ACTIVE = 17  # a, q, r as they act, low-passed
    EXTREMES = 20  # max, min of v, u and of u at v = 0
    CONTROL = 26
    TIME = 27  # [s]
    UPDATES = 28  # since the last fit
    ESTIMATE = 29
    TABLE = 42  # computed compensation over -LIMIT .. LIMIT [V], and behind it how often each element was updated


assert I.TABLE == I.ESTIMATE + V.END


@dataclass(frozen=True, kw_only=True)
class Iterative(RowCompensator):
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

    def new_row(self, context: Context) -> np.ndarray:
        row, tick = np.zeros(I.TABLE + 2 * self.elements), context.tick_s
        row[I.FUNCTION], row[I.RANGE], row[I.REPORT] = self.function, RANGE[self.function], self.form == "report"
        row[I.HALF_WIDTH], row[I.SLOPE] = self.offset == "half width", self.slope_m_s_V or 0.0
        row[I.UPDATE_GAIN] = (0.05 if self.form == "report" else 0.1) if self.gain is None else self.gain
        row[I.Q_START] = row[I.Q] = row[I.ACTIVE + 1] = self.q_start_V
        row[I.A_MAX], row[I.FORGET], row[I.FADE_S] = self.a_max_V, 1.0 - tick / self.memory_s, self.fade_s
        row[I.TICK], row[I.LIMIT], row[I.HALF], row[I.ELEMENT] = tick, context.voltage_max_V, self.elements // 2, -1.0
        start_estimate(row[I.ESTIMATE : I.TABLE], context.rate_Hz, self.velocity_bandwidth_Hz)
        return row

    def functions(self) -> tuple[Any, Any]:
        return tick, is_sound

    def parameters(self, state: RowState) -> Parameters:
        row, n = state.row, self.elements
        return {
            "function": self.function,
            "a_V": float(row[I.A]),
            "q_V": float(row[I.Q]),
            "r_V": float(row[I.R]),
            "table_V": row[I.TABLE : I.TABLE + n].tolist(),
            "visits": row[I.TABLE + n :].astype(int).tolist(),
            "extremes": row[I.EXTREMES : I.CONTROL].tolist(),
        }

    def refused(self, context: Context, parameters: Parameters) -> str:
        for name in ("table_V", "visits"):
            if len(parameters[name]) != self.elements:
                return f"{name} has {len(parameters[name])} elements where this compensator has {self.elements}"
        if len(parameters["extremes"]) != 6 or min(parameters["visits"]) < 0:
            return "extremes must be six numbers, and visits not negative"
        names = ("a_V", "q_V", "r_V", "table_V", "extremes")
        return beyond_volts(parameters, names, MOST_RANGES * context.voltage_max_V)

    def restore(self, context: Context, parameters: Parameters) -> RowState:
        state = self.start(context)
        row, n = state.row, self.elements
        for place, name in ((I.A, "a_V"), (I.Q, "q_V"), (I.R, "r_V")):
            row[place] = parameters[name]
        row[I.TABLE : I.TABLE + n], row[I.TABLE + n :] = parameters["table_V"], parameters["visits"]
        row[I.EXTREMES : I.CONTROL] = parameters["extremes"]
        return state


@compiled
def tick(row, control_V, valve_V, position_m, bottom_Pa):
    """Volts to add."""
    u = control_V
    if not (math.isfinite(u) and math.isfinite(valve_V)):
        return 0.0
    row[I.TIME] += row[I.TICK]
    part = row[I.ESTIMATE : I.TABLE]
    if estimate_velocity(part, position_m, valve_V, u):
        v, valve, control = part[V.FOUND], part[V.FOUND + 1], part[V.FOUND + 2]
        if row[I.REPORT] == 1.0:
            learn_as_reported(row, v, control)
        else:
            learn(row, v, valve, control)
    rate = min(1.0, row[I.TICK] / row[I.FADE_S])
    for i in range(3):
        row[I.ACTIVE + i] += rate * (row[I.A + i] - row[I.ACTIVE + i])
    a, q, r = row[I.ACTIVE], row[I.ACTIVE + 1], row[I.ACTIVE + 2]
    b = row[I.RANGE] / max(q, row[I.Q_START])
    return clip(compensation_V(row[I.FUNCTION], clip(u, -2.0 * q, 2.0 * q), a, b, b * r), -row[I.LIMIT], row[I.LIMIT])


@compiled
def slope(row):
    """Slope s [m/s/V] of the desired linear valve; 0 while nothing has moved."""
    if row[I.SLOPE] != 0.0:
        return row[I.SLOPE]
    ex = row[I.EXTREMES : I.CONTROL]
    return (ex[0] - ex[1]) / (ex[2] - ex[3]) if ex[2] - ex[3] > 0.5 * row[I.Q_START] else 0.0


@compiled
def element_of(row, u):
    """The element of a voltage."""
    return int(row[I.HALF]) + int(np.rint(clip(u / row[I.LIMIT], -1.0, 1.0) * row[I.HALF]))


@compiled
def learn_as_reported(row, v, u):
    """One tick of 5.3 as it is printed."""
    ex, table = row[I.EXTREMES : I.CONTROL], row[I.TABLE :]
    ex[0], ex[1], ex[2], ex[3] = max(ex[0], v), min(ex[1], v), max(ex[2], u), min(ex[3], u)
    if abs(v) <= FITS.zero_velocity_m_s and row[I.TIME] > row[I.FADE_S]:
        ex[4], ex[5] = max(ex[4], u), min(ex[5], u)
    i = element_of(row, u)
    if i != row[I.ELEMENT]:
        table[i] += row[I.UPDATE_GAIN] * (slope(row) * u - v)
        row[I.ELEMENT] = i
        row[I.A] = max(row[I.A], table[i])
    row[I.Q] = max(row[I.Q], (ex[2] - ex[3]) / 2.0)
    row[I.R] = (ex[4] - ex[5]) / 2.0 if row[I.HALF_WIDTH] == 1.0 else (ex[4] + ex[5]) / 2.0


@compiled
def learn(row, v, valve, u):
    """One tick of the corrected form."""
    ex, tick_s = row[I.EXTREMES : I.CONTROL], row[I.TICK]
    ex[0], ex[1] = max(ex[0] * row[I.FORGET], v), min(ex[1] * row[I.FORGET], v)
    ex[2], ex[3] = max(ex[2] * row[I.FORGET], u), min(ex[3] * row[I.FORGET], u)
    s = slope(row)
    if s <= 0.0:
        return
    if abs(v) <= FITS.zero_velocity_m_s and ex[0] > 10 * FITS.zero_velocity_m_s:
        side = 4 if u > row[I.CONTROL] else 5  # either direction has its mean, so that both weigh the same
        ex[side] += tick_s / FITS.every_s * (clip(valve, -row[I.A_MAX], row[I.A_MAX]) - ex[side])
        row[I.R] = (ex[4] + ex[5]) / 2.0
    row[I.CONTROL] = u
    w = v / s + row[I.R]
    i = element_of(row, w)
    if i != row[I.ELEMENT] and abs(v) > 2 * FITS.zero_velocity_m_s:
        at, count = I.TABLE + i, I.TABLE + (len(row) - I.TABLE) // 2 + i
        row[at] += max(row[I.UPDATE_GAIN], 1.0 / (1.0 + row[count])) * (valve - w - row[at])
        row[count] += 1.0
        row[I.ELEMENT] = i
    row[I.UPDATES] += 1.0
    if row[I.UPDATES] >= FITS.every_s / tick_s:
        row[I.UPDATES] = 0.0
        fit(row)


@compiled
def fit(row):
    """a by least squares of the function through the elements visited within -q .. q."""
    n, half, ex = (len(row) - I.TABLE) // 2, int(row[I.HALF]), row[I.EXTREMES : I.CONTROL]
    row[I.Q] = max(row[I.Q_START], (ex[2] - ex[3]) / 2.0)
    b = row[I.RANGE] / row[I.Q]
    visited, power, product = 0, 0.0, 0.0
    for i in range(element_of(row, -row[I.Q]), element_of(row, row[I.Q]) + 1):
        if row[I.TABLE + n + i] > 0.0:
            w = (i - half) * row[I.LIMIT] / half
            shape = compensation_V(row[I.FUNCTION], w, 1.0, b, b * row[I.R])
            visited, power, product = visited + 1, power + shape * shape, product + shape * row[I.TABLE + i]
    if visited >= FITS.fewest:
        row[I.A] = clip(product / max(power, 1e-9), 0.0, row[I.A_MAX])


@compiled
def is_sound(row):
    """Of the table the element that changed last: the others were looked at when they did."""
    element = row[I.TABLE + int(max(row[I.ELEMENT], 0.0))]
    return element - element == 0.0 and all_are_finite(row, I.ELEMENT, I.TABLE)
