"""Repetitive control: learning from period to period, on top of `adaptive`.

Where the motion is periodic, the error that feed-forward leaves is periodic too. The position error e(t) of a period is
kept. Its harmonics, through the inverse of the closed loop's response to volts,

    G(s) = k S(s) / s,   S the spool with its lag and the hold,   W += gamma (1 + Kp G) / G  E      up to some 20 Hz,

are added to a table of volts over the period. The table is used with the phase it was made with, so that no filter
delays it. Noise is not periodic and averages out. Above 20 Hz the position is too noisy, and the hydraulic resonance
too near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .adaptive.adaptive import Adaptive, AdaptiveState
from .adaptive.leg import GAIN_DN, GAIN_UP, valve_lag_s
from .compensator import Context, Parameters, Sample


@dataclass(slots=True)
class RepetitiveState(AdaptiveState):
    """Also the correction, and the error of the period in progress."""

    ticks: int = 0  # in a period; 0 = there is none
    phase: int = 0
    settled_ticks: int = 0  # for which the feed-forward has been all in
    error_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    table_V: list[float] = field(default_factory=list)  # the correction, as it is read tick by tick
    correction_V: np.ndarray = field(default_factory=lambda: np.zeros(0))
    periods: int = 0


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
        base = super().start(context)
        state = RepetitiveState(context, base.states)
        period = context.period_s
        if period is not None and period <= most_period_s:
            ticks = round(period * context.rate_Hz)
            if ticks >= least_ticks and abs(ticks / context.rate_Hz - period) < 1e-3 * context.tick_s:
                state.ticks = ticks
                state.error_m, state.correction_V, state.table_V = np.zeros(ticks), np.zeros(ticks), [0.0] * ticks
        return state

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        volts, _ = super().step(state, sample)
        correction_V = self._correction_V(state, sample)
        state.states["asked_V"] += correction_V
        return volts + correction_V, state

    def _correction_V(self, state: AdaptiveState, sample: Sample) -> float:
        if not isinstance(state, RepetitiveState) or state.ticks == 0:
            return 0.0
        phase, s = state.phase, state.states
        state.error_m[phase] = s["reference"]["position_m"][0, 0] - sample.position_m
        settled = s["share"][0] == s["linear"][0] == 1.0
        state.settled_ticks = state.settled_ticks + 1 if settled else 0
        state.phase = phase + 1 if phase + 1 < state.ticks else 0
        if state.phase == 0 and state.settled_ticks >= 1.5 * state.ticks:
            self._learn_period(state)
        return float(s["share"][0]) * state.table_V[phase]

    def _learn_period(self, state: RepetitiveState) -> None:
        context, numbers = state.context, state.numbers.numbers
        gain = context.velocity_gain_m_s_V * 0.5 * (numbers[GAIN_DN] + numbers[GAIN_UP])
        count = state.ticks
        f = np.arange(count // 2 + 1) / (count * context.tick_s)
        s = 2j * math.pi * f
        lag = valve_lag_s(numbers)
        spool = np.exp(-0.5 * context.tick_s * s) / (1 + lag * s + (lag * s / (2 * context.spool_damping)) ** 2)
        inverse = s / (gain * spool) + context.position_gain_V_per_m
        taper = np.clip((self.band_Hz - f) / (self.band_Hz / 3), 0.0, 1.0)
        share = max(self.learning_low, self.learning * 0.8**state.periods)
        state.correction_V += share * np.fft.irfft(taper * inverse * np.fft.rfft(state.error_m), count)
        np.clip(state.correction_V, -self.table_max_V, self.table_max_V, out=state.correction_V)
        state.table_V = state.correction_V.tolist()
        state.periods += 1

    def parameters(self, state: AdaptiveState) -> Parameters:
        table = list(state.table_V) if isinstance(state, RepetitiveState) else []
        return {**super().parameters(state), "table_V": table}

    def finite(self, state: AdaptiveState) -> bool:
        sound = not isinstance(state, RepetitiveState) or state.ticks == 0 or math.isfinite(state.table_V[state.phase])
        return sound and super().finite(state)

    def restore(self, context: Context, parameters: Parameters) -> RepetitiveState:
        state = super().restore(context, parameters)
        assert isinstance(state, RepetitiveState)  # super().restore begins with our own start
        return state  # the table belongs to a phase of the motion that a new run need not share
