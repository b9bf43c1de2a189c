"""Rounding of the valve's edges: how a metering edge that is not sharp leaves the straight line beyond the overlap.

A rounded edge opens as s log(1 + exp((x - delta)/s)), s the rounding in volts, delta the half dead band. Two parts:

`RoundingEstimator` identifies s from the reversals of plain control, before compensation engages. A reversal is two
passages: from where the spool leaves the straight part of its curve (t1) to its middle (t2), and from there to the
straight part of the other side. What a rounded edge lets through beyond a sharp one,

    z(t2) - z(t1) = k int f(x, 0) R dt + q phi,     phi = k int (f(x, s) - f(x, 0)) R dt / s^2,     q = s^2,

goes with the square of s: int (f(x, s) - f(x, 0)) dx = pi^2 q / 6 over both sides of an edge. f(x, s) is the opening, x
the spool by the identified backlash and lag. Plain control passes slowly, so that 10 mV move some 10 to 30 um: a few
reversals suffice, with 5 um of noise. Least squares of q, with its standard error. It also tests the whole valve: a
reversal that moves much less oil than sharp edges would (q well below zero), or another amount each time, is not
explained by the identified gain, dead band, lag and backlash.

`RoundingTrim` corrects s while compensation acts. Its inverse at a speed v needs less than the straight line by

    c(v) = s log(1 - exp(-v / (k s))),     never below -delta

Too large a dead-band compensation moves too much oil on both sides of the reversal, too small a one too little.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from ..compensator import clip
from .leak import LeakEstimator
from .spool import round_lag, spool_model
from .valve import ValveEstimator

PRIOR_V = 12e-3  # standard deviation of s before anything is known
MAX_ROUNDING_V = 25e-3
STRAIGHT_V = 0.05  # beyond the overlap, from where the curve is straight
MIN_PROBE_V = 5e-3  # phi is computed with the identified rounding, and no less than this
NOISE_M = 5e-6  # of a passage: two positions, and the residual of the identified valve
MAX_EXCESS_M = 3e-5  # a passage, or a compensated reversal, with more than this is something else
MAX_PASSAGE_S = 0.5  # so is a passage that takes longer
MEMORY, MEMORY_EARLY = 15.0, 2.0  # passages; the second while the valve itself is being identified
LOWER_ERRORS = 3.0  # standard errors of q from which edges are taken as rounded
UPPER_ERRORS = 2.0  # standard errors of q added for the upper confidence bound
REJECT_ERRORS = 7.0  # standard errors of q below zero at which the identified valve is rejected
MISFIT_SHARE, MAX_MISFIT = 0.2, 3.0  # low-pass of the misfit, and its bound

TRIM_TICKS = 8  # on either side of a compensated reversal
TRIM_V_M = 200.0  # volts of rounding per metre of excess oil displacement at one reversal: 1 mV for 5 um
TRIM_BIAS_M = 1e-6  # taken off each excess, so that noise does not add up to a rounding
MIN_ROUNDING_V = 4e-3  # below it edges are taken as sharp


def opening(volts: float, dead_band_V: float, rounding_V: float) -> float:
    """Opening [V] of the spool at `volts` beyond an overlap with edges rounded so, both edges together: f(x, s)."""
    size = abs(volts)
    if rounding_V == 0.0:
        left = max(size - dead_band_V, 0.0)
    else:
        near, far = (size - dead_band_V) / rounding_V, (-size - dead_band_V) / rounding_V
        left = rounding_V * ((near if near > 30.0 else math.log1p(math.exp(near))) - math.log1p(math.exp(far)))
    return left if volts > 0.0 else -left


@dataclass(slots=True)
class RoundingEstimator:
    """q [V2] with its variance, the misfit of the passages, and the passage in progress."""

    square_V2: float = 0.0
    variance_V4: float = PRIOR_V**4
    misfit: float = 1.0  # mean square of a passage's excess, over its expected variance
    backlash_V: float = 0.0  # volts behind the backlash
    spool_V: float = 0.0
    rate_V: float = 0.0  # of the spool, a tick
    lag_s: float = -1.0  # that `model` (spool.py) was made for
    model: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    probe_V: float = MIN_PROBE_V  # rounding that phi is computed with
    ticks: int = 0  # of the passage; 0 = none
    start_m: float = 0.0  # oil displacement at its start
    sharp_m: float = 0.0  # oil that sharp edges would have let through since
    rounded_m: float = 0.0  # and rounded ones beyond that
    closed_ticks: int = 0  # for which the overlap closed the valve
    leak: LeakEstimator = field(default_factory=LeakEstimator)

    @property
    def lower_bound_V(self) -> float:
        """Lower confidence bound of the rounding [V]; 0 where edges may be sharp."""
        return self._root(self.square_V2 * clip(self.square_V2 / self._error() - LOWER_ERRORS, 0.0, 1.0))

    @property
    def upper_bound_V(self) -> float:
        """Upper confidence bound of the rounding [V]."""
        return self._root(max(self.square_V2, 0.0) + UPPER_ERRORS * self._error())

    @property
    def explains_reversals(self) -> bool:
        """Whether reversals move the oil that the identified valve lets through."""
        return self.misfit < MAX_MISFIT**2 and self.square_V2 > -REJECT_ERRORS * self._error()

    def add(self, z_m: float, valve_V: float, root: float, valve: ValveEstimator) -> bool:
        """One tick: oil displacement now, volts of the tick past, mean sqrt(dp/dp_ref) in it of the edge they opened.

        True when a passage was completed.
        """
        tick_s, before = valve.context.tick_s, self.spool_V
        if valve.lag_s != self.lag_s:
            self.lag_s, self.model = valve.lag_s, spool_model(round_lag(valve.lag_s), tick_s)
        x = self._advance(valve_V, valve.edge(valve_V).backlash_V)
        edge = valve.edge(x)
        straight = abs(x) > edge.dead_band_V + STRAIGHT_V
        if straight and self.ticks <= 1:
            self.leak.start(x > 0.0)
            self.ticks, self.start_m, self.sharp_m, self.rounded_m = 1, z_m, 0.0, 0.0
            return False
        if not self.ticks:
            return False
        self.ticks += 1
        mean, moved = 0.5 * (before + x), edge.gain_m_s_V * root * tick_s
        sharp = opening(mean, edge.dead_band_V, 0.0)
        self.sharp_m += moved * sharp
        self.closed_ticks += sharp == 0.0
        self.rounded_m += moved * (opening(mean, edge.dead_band_V, self.probe_V) - sharp)
        if straight or before * x <= 0.0:
            self.leak.add(z_m - self.start_m - self.sharp_m, self.closed_ticks * tick_s)
            if straight and valve.usable and self.leak.finish(x > 0.0, valve.leak_m_s):
                self.ticks = self.closed_ticks = 0
                return True
            if self.leak.known:
                self._update(z_m, MEMORY if valve.ready else MEMORY_EARLY)
            self.closed_ticks = 0
            self.ticks, self.start_m, self.sharp_m, self.rounded_m = 1 if straight else 2, z_m, 0.0, 0.0
            return True
        if self.ticks * tick_s > MAX_PASSAGE_S:
            self.ticks = 0
        return False

    def restore(self, rounding_V: float) -> None:
        """Start with what was identified before."""
        self.square_V2, self.variance_V4 = rounding_V**2, 0.01 * PRIOR_V**4

    def _root(self, square_V2: float) -> float:
        return min(math.sqrt(square_V2), MAX_ROUNDING_V) if square_V2 > 0.0 else 0.0

    def _error(self) -> float:
        return math.sqrt(self.variance_V4)

    def _advance(self, volts: float, backlash_V: float) -> float:
        """The spool at the end of a tick of these volts."""
        a, b, c, d = self.model
        self.backlash_V = clip(self.backlash_V, volts - backlash_V, volts + backlash_V)
        away = self.backlash_V - self.spool_V
        self.spool_V += a * away + b * self.rate_V
        self.rate_V = c * away + d * self.rate_V
        return self.spool_V

    def _update(self, z_m: float, memory: float) -> None:
        """A passage in: one step of least squares with forgetting."""
        phi = self.rounded_m / self.probe_V**2
        excess = z_m - self.start_m - self.sharp_m - phi * self.square_V2
        if abs(excess) > MAX_EXCESS_M + abs(phi) * MAX_ROUNDING_V**2:
            return
        expected = NOISE_M**2 + phi * self.variance_V4 * phi
        self.misfit += MISFIT_SHARE * (excess * excess / expected - self.misfit)
        share = self.variance_V4 * phi / expected
        self.square_V2 += share * excess
        self.variance_V4 *= (1.0 - share * phi) * (1.0 + share * phi / memory)
        self.variance_V4 = min(self.variance_V4, PRIOR_V**4)
        self.probe_V = max(self._root(self.square_V2), MIN_PROBE_V)


@dataclass(slots=True)
class RoundingTrim:
    """Rounding s of both edges [V] as compensation uses it, and the compensated reversal in progress."""

    rounding_V: float = 0.0
    minimum_V: float = 0.0  # no less is used while compensation engages
    direction: float = 0.0
    ticks: int = 0
    reversal_m: float = 0.0  # oil displacement less the demanded one, at the reversal
    before_m: float = 0.0  # by how much it had grown before, against the new direction

    def correction_V(self, speed_m_s: float, gain_m_s_V: float, dead_band_V: float) -> float:
        """c [V] at a speed."""
        s = max(self.rounding_V, self.minimum_V)
        if s < MIN_ROUNDING_V or speed_m_s > 6.0 * s * gain_m_s_V:
            return 0.0
        share = 1.0 - math.exp(-speed_m_s / (s * gain_m_s_V))
        return max(s * math.log(share), -dead_band_V) if share > 0.0 else -dead_band_V

    def add(self, oil_error_m: deque[float], flow_m_s: float, highest_V: float) -> None:
        """One tick: oil displacement less the demanded one, of the last ticks, newest last; the flow demanded now."""
        direction = 1.0 if flow_m_s > 0 else -1.0
        if direction != self.direction:
            self.direction, self.ticks = direction, 0
            self.reversal_m = oil_error_m[-1]
            self.before_m = -direction * (self.reversal_m - oil_error_m[0])
        self.ticks += 1
        if self.ticks == TRIM_TICKS:
            excess = 0.5 * (direction * (oil_error_m[-1] - self.reversal_m) + self.before_m)
            if abs(excess) < MAX_EXCESS_M:
                self.rounding_V = clip(self.rounding_V + TRIM_V_M * (excess - TRIM_BIAS_M), 0.0, highest_V)
