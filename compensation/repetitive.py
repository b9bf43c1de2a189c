# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""Repetitive control: learning from period to period, on top of `adaptive`.

Where the motion is periodic, the error that feed-forward leaves is periodic too. The position error e(t) of a period is
kept. Its harmonics, through the inverse of the closed loop's response to volts,

    G(s) = k S(s) / s,   S the spool with its lag and the hold,   W += gamma (1 + Kp G) / G  E      up to some 20 Hz,

are added to a table of volts over the period. The table is used with the phase it was made with, so that no filter
delays it. Noise is not periodic and averages out. Above 20 Hz the position is too noisy, and the hydraulic resonance
too near.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np
from numba import carray

from .adaptive.adaptive import Adaptive, AdaptiveState
from .adaptive.layout import STATE
from .adaptive.leg import GAIN_DN, GAIN_UP, valve_lag_s
from .adaptive.legs import AdaptiveLegs
from .arithmetic import clip
from .compensator import Context, Parameters, Sample
from .compiled import compiled, compiled_callback, in_its_caller
from .desk import LEGS, STEP, TICK, call_tick, doubles, pointer, rows, truths
from .legs import Legs


class R(IntEnum):
    """Places in the row of a correction."""

    PERIOD = 0  # [ticks]; 0: there is none
    PHASE = 1
    SETTLED = 2  # ticks for which the feed-forward has been all in
    PERIODS = 3  # that were learned from
    LEARNING = 4
    LEARNING_LOW = 5
    BAND_Hz = 6
    MAX_V = 7
    TICK_S = 8
    VALVE_GAIN = 9  # [m/s/V]
    DAMPING = 10
    KP = 11  # [V/m]
    ERROR = 12  # of the period in progress [m]; behind it the correction [V], cosine and sine of each phase


@dataclass(slots=True)
class RepetitiveState(AdaptiveState):
    """Also the row of the correction."""

    row: np.ndarray = field(default_factory=lambda: np.zeros(R.ERROR))


@dataclass(frozen=True, kw_only=True)
class Repetitive(Adaptive):
    """`adaptive`, and a correction learned over the period of the built-in signal generator.

    learning: share of the correction taken up after a period; it falls over the first periods to `learning_low`:
    quick first, then averaging. Higher values learn faster and take up more noise. band_Hz: harmonics up to here are
    learned, tapering off over the last third. table_max_V: bound of the correction. Without `Context.period_s` it is
    `adaptive`.
    """

    name: str = "repetitive"
    place = 5
    learning: float = 0.5
    learning_low: float = 0.1
    band_Hz: float = 20.0
    table_max_V: float = 0.3

    def start(
        self,
        context: Context,
        *,
        most_period_s: float = 20.0,  # of a motion that repeats
        least_ticks: int = 20,  # in a period
    ) -> RepetitiveState:
        state, period, ticks = RepetitiveState(context, super().start(context).states), context.period_s, 0
        if period is not None and period <= most_period_s:
            whole = round(period * context.rate_Hz)
            if whole >= least_ticks and abs(whole / context.rate_Hz - period) < 1e-3 * context.tick_s:
                ticks = whole
        state.row = row = np.zeros(R.ERROR + 4 * ticks)
        row[R.PERIOD], row[R.LEARNING], row[R.LEARNING_LOW] = ticks, self.learning, self.learning_low
        row[R.BAND_Hz], row[R.MAX_V], row[R.TICK_S] = self.band_Hz, self.table_max_V, context.tick_s
        row[R.VALVE_GAIN], row[R.DAMPING] = context.velocity_gain_m_s_V, context.spool_damping
        row[R.KP] = context.position_gain_V_per_m
        turns = 2.0 * np.pi * np.arange(ticks) / max(ticks, 1)
        row[R.ERROR + 2 * ticks :] = np.concatenate([np.cos(turns), np.sin(turns)])
        return state

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        volts, _ = super().step(state, sample)
        if isinstance(state, RepetitiveState):
            volts += correct_first(state.row, state.states, sample.position_m)
        return volts, state

    def together(self, states: Sequence[AdaptiveState]) -> RepetitiveLegs:
        """What steps these legs in one call."""
        return RepetitiveLegs(states)

    def parameters(self, state: AdaptiveState) -> Parameters:
        table = table_of(state.row).tolist() if isinstance(state, RepetitiveState) else []
        return {**super().parameters(state), "table_V": table}

    def finite(self, state: AdaptiveState) -> bool:
        return (not isinstance(state, RepetitiveState) or is_sound(state.row)) and super().finite(state)

    def restore(self, context: Context, parameters: Parameters) -> RepetitiveState:
        state = super().restore(context, parameters)
        assert isinstance(state, RepetitiveState)  # super().restore begins with our own start
        return state  # the table belongs to a phase of the motion that a new run need not share


class RepetitiveLegs(AdaptiveLegs):
    """`AdaptiveLegs`, and the rows of their corrections in one array."""

    def __init__(self, states: Sequence[Any]) -> None:
        self.rows = np.array([state.row for state in states])
        super().__init__(states)

    @property
    def native(self) -> Any:
        """The tick of all legs."""
        return native_tick

    def renew(self, leg: int, state: Any) -> None:
        """A leg goes on with another state."""
        super().renew(leg, state)
        self.rows[leg] = state.row
        state.row = self.rows[leg]

    def step(self, legs: Legs, acts: np.ndarray, added: np.ndarray, finite: np.ndarray) -> None:
        super().step(legs, acts, added, finite)
        correct_legs(self.rows, self.joined, acts, legs.position_m, added, finite)


@in_its_caller
def table_of(row):
    """The correction over the period [V]."""
    n = int(row[R.PERIOD])
    return row[R.ERROR + n : R.ERROR + 2 * n]


@compiled
def correct(row, s, position_m):
    """Volts of the correction at this tick. s: the state of `adaptive` after its own."""
    n, phase = int(row[R.PERIOD]), int(row[R.PHASE])
    if n == 0:
        return 0.0
    row[R.ERROR + phase] = s.reference.position_m[0] - position_m
    settled = s.share == 1.0 and s.linear == 1.0
    row[R.SETTLED] = row[R.SETTLED] + 1.0 if settled else 0.0
    row[R.PHASE] = phase + 1 if phase + 1 < n else 0
    if row[R.PHASE] == 0.0 and row[R.SETTLED] >= 1.5 * n:
        learn_period(row, s.numbers)
    volts = s.share * table_of(row)[phase]
    s.asked_V += volts
    return volts


@compiled
def correct_first(row, states, position_m):
    """`correct` of states (1,)."""
    return correct(row, states[0], position_m)


@compiled
def correct_legs(rows, states, acts, position_m, added_V, finite):
    """`correct` of those legs (n,) that act."""
    for i in range(len(states)):
        if acts[i]:
            added_V[i] += correct(rows[i], states[i], position_m[i])
            finite[i] = finite[i] and is_sound(rows[i])


@compiled
def is_sound(row):
    """Whether the next number of the correction is finite."""
    return row[R.PERIOD] == 0.0 or math.isfinite(table_of(row)[int(row[R.PHASE])])


@compiled
def learn_period(row, numbers):
    """Add a share of W to the correction, harmonic by harmonic of the period's error."""
    n, table = int(row[R.PERIOD]), table_of(row)
    cosine, sine = row[R.ERROR + 2 * n : R.ERROR + 3 * n], row[R.ERROR + 3 * n :]
    gain = row[R.VALVE_GAIN] * 0.5 * (numbers[GAIN_DN] + numbers[GAIN_UP])
    lag, tick_s, band_Hz = valve_lag_s(numbers), row[R.TICK_S], row[R.BAND_Hz]
    share = max(row[R.LEARNING_LOW], row[R.LEARNING] * 0.8 ** row[R.PERIODS])
    for k in range(n // 2 + 1):
        f = k / (n * tick_s)
        taper = clip((band_Hz - f) / (band_Hz / 3.0), 0.0, 1.0)
        if taper == 0.0:
            break
        real = imaginary = 0.0
        for i in range(n):
            turn = k * i % n
            real += row[R.ERROR + i] * cosine[turn]
            imaginary -= row[R.ERROR + i] * sine[turn]
        s = 2j * math.pi * f
        spool = cmath.exp(-0.5 * tick_s * s) / (1.0 + lag * s + (lag * s / (2.0 * row[R.DAMPING])) ** 2)
        added = taper * (s / (gain * spool) + row[R.KP]) * complex(real, imaginary)
        weight = share * (1.0 if k == 0 or 2 * k == n else 2.0) / n
        for i in range(n):
            turn = k * i % n
            table[i] += weight * (added.real * cosine[turn] - added.imag * sine[turn])
    for i in range(n):
        table[i] = clip(table[i], -row[R.MAX_V], row[R.MAX_V])
    row[R.PERIODS] += 1.0


@cache
def native_tick() -> Any:
    """The tick of `adaptive`, and `correct_legs`."""

    @compiled_callback(TICK)
    def step_legs(desk, what):
        d = carray(desk, (1,), LEGS)[0]
        call_tick(d.inner, desk, what)
        if what == STEP:
            states, acts, finite = carray(pointer(d.states), (d.n,), STATE), truths(d.acts, d.n), truths(d.finite, d.n)
            correct_legs(
                rows(d.rows, d.n, d.width), states, acts, doubles(d.position_m, d.n), doubles(d.added_V, d.n), finite
            )

    return step_legs
