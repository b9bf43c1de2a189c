"""How far the valve's edges are rounded, learned from the reversals of plain control before anything is added.

A reversal is watched in two passages: from where the spool leaves the straight part of its curve (t1) to its middle
(t2), and from there to the straight part of the other side. What a rounded edge lets through beyond a sharp one,

    z(t2) - z(t1) = k int f(x, 0) R dt + q phi,     phi = k int (f(x, s) - f(x, 0)) R dt / s^2,     q = s^2,

is as the square of the rounding s: int (f(x, s) - f(x, 0)) dx = pi^2 q / 6 over both sides of an edge. f(x, s) is what
is open, x the spool by the learned play and lag. Plain control passes slowly, so that 10 mV move some 10 to 30 um and
a few reversals tell, with 5 um of noise; once compensation jumps across the overlap little is left to be seen, and
knee.py trims what was found.

Least squares of q, with its standard error. It also tells of the whole valve: a reversal that moves much less oil than
sharp edges would (q well below zero), or another amount each time, is not explained by the gain, dead band, lag and play
that were learned, although their windows beyond the overlap are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .base import clip
from .flow_learning import FlowLearner
from .spool import round_lag, spool_model

SPREAD_V = 12e-3  # thinkable before anything is known
HIGHEST_V = 25e-3  # no more is believed
STRAIGHT_V = 0.05  # beyond the overlap, from where the curve is straight
PROBE_V = 5e-3  # phi is found with the rounding known, and no less than this
NOISE_M = 5e-6  # of a passage: two positions, and what the fit of the valve leaves
TRUST_M = 3e-5  # a passage that is further from what is thinkable is something else
LONGEST_S = 0.5  # so is one that takes longer
MEMORY, MEMORY_EARLY = 15.0, 2.0  # passages; the second while the valve itself is being learned
SURE = 3.0  # standard errors from which edges are taken as rounded
CAUTION = 2.0  # standard errors by which they may well be rounder
ODD = 7.0  # standard errors below zero at which the valve is not what was learned
MISFIT_SHARE, MISFIT_HIGH = 0.2, 3.0  # low-pass of the misfit, and what is too much


def opening(volts: float, dead_band_V: float, rounding_V: float) -> float:
    """Volts that are left of the spool's `volts` beyond an overlap with edges rounded so, both edges together."""
    size = abs(volts)
    if rounding_V == 0.0:
        left = max(size - dead_band_V, 0.0)
    else:
        near, far = (size - dead_band_V) / rounding_V, (-size - dead_band_V) / rounding_V
        left = rounding_V * ((near if near > 30.0 else math.log1p(math.exp(near))) - math.log1p(math.exp(far)))
    return left if volts > 0.0 else -left


@dataclass(slots=True)
class Rounding:
    """q [V2] with its variance, the misfit of the passages, and the one being watched."""

    square_V2: float = 0.0
    variance_V4: float = SPREAD_V**4
    misfit: float = 1.0  # mean square of what a passage moved too much, over what is expected of it
    follower_V: float = 0.0  # volts behind the play
    spool_V: float = 0.0
    rate_V: float = 0.0  # of the spool, a tick
    lag_s: float = -1.0  # for which `model` (spool.py) was made
    model: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    probe_V: float = PROBE_V  # rounding that phi is found with
    ticks: int = 0  # of the passage; 0 = none
    from_m: float = 0.0  # oil displacement at its start
    sharp_m: float = 0.0  # oil that sharp edges would have let through since
    more_m: float = 0.0  # and rounded ones beyond that

    @property
    def surely_V(self) -> float:
        """Rounding [V] that is beyond doubt; 0 where edges may as well be sharp."""
        return self._root(self.square_V2 * clip(self.square_V2 / self._error() - SURE, 0.0, 1.0))

    @property
    def likely_V(self) -> float:
        """Rounding [V] that there may well be."""
        return self._root(max(self.square_V2, 0.0) + CAUTION * self._error())

    @property
    def sound(self) -> bool:
        """Whether reversals move the oil that the valve as learned lets through."""
        return self.misfit < MISFIT_HIGH**2 and self.square_V2 > -ODD * self._error()

    def watch(self, z_m: float, valve_V: float, root: float, flow: FlowLearner) -> bool:
        """One tick: oil displacement now, volts of the tick past, mean sqrt(dp/dp_ref) in it of the edge they opened.
        True when a passage was taken in."""
        tick_s, before = flow.context.tick_s, self.spool_V
        if flow.lag_s != self.lag_s:
            self.lag_s, self.model = flow.lag_s, spool_model(round_lag(flow.lag_s), tick_s)
        x = self._advance(valve_V, flow.edges[valve_V > 0].play_V)
        edge = flow.edges[x > 0]
        straight = abs(x) > edge.dead_band_V + STRAIGHT_V
        if straight and self.ticks <= 1:
            self.ticks, self.from_m, self.sharp_m, self.more_m = 1, z_m, 0.0, 0.0
            return False
        if not self.ticks:
            return False
        self.ticks += 1
        mean, moved = 0.5 * (before + x), edge.gain_m_s_V * root * tick_s
        sharp = opening(mean, edge.dead_band_V, 0.0)
        self.sharp_m += moved * sharp
        self.more_m += moved * (opening(mean, edge.dead_band_V, self.probe_V) - sharp)
        if straight or before * x <= 0.0:
            self._finish(z_m, MEMORY if flow.ready else MEMORY_EARLY)
            self.ticks, self.from_m, self.sharp_m, self.more_m = 1 if straight else 2, z_m, 0.0, 0.0
            return True
        if self.ticks * tick_s > LONGEST_S:
            self.ticks = 0
        return False

    def restore(self, rounding_V: float) -> None:
        """Start with what was known before."""
        self.square_V2, self.variance_V4 = rounding_V**2, 0.01 * SPREAD_V**4

    def _root(self, square_V2: float) -> float:
        return min(math.sqrt(square_V2), HIGHEST_V) if square_V2 > 0.0 else 0.0

    def _error(self) -> float:
        return math.sqrt(self.variance_V4)

    def _advance(self, volts: float, play_V: float) -> float:
        """The spool at the end of a tick of these volts."""
        a, b, c, d = self.model
        self.follower_V = clip(self.follower_V, volts - play_V, volts + play_V)
        away = self.follower_V - self.spool_V
        self.spool_V += a * away + b * self.rate_V
        self.rate_V = c * away + d * self.rate_V
        return self.spool_V

    def _finish(self, z_m: float, memory: float) -> None:
        """A passage in: one step of least squares with forgetting."""
        phi = self.more_m / self.probe_V**2
        excess = z_m - self.from_m - self.sharp_m - phi * self.square_V2
        if abs(excess) > TRUST_M + abs(phi) * HIGHEST_V**2:
            return
        expected = NOISE_M**2 + phi * self.variance_V4 * phi
        self.misfit += MISFIT_SHARE * (excess * excess / expected - self.misfit)
        share = self.variance_V4 * phi / expected
        self.square_V2 += share * excess
        self.variance_V4 *= (1.0 - share * phi) * (1.0 + share * phi / memory)
        self.variance_V4 = min(self.variance_V4, SPREAD_V**4)
        self.probe_V = max(self._root(self.square_V2), PROBE_V)
