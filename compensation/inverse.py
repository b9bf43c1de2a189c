"""The learned valve turned round: volts that let a wanted oil displacement through, tick by tick.

What a tick's mean flow needs, and what it takes to get across the overlap where the flow turns, are handed out apart, for
the spool follows each by taps of its own (spool.py). While it crosses, the overlap keeps back oil; a share of it is given
in the two ticks before and made up in the two after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .flow_learning import Edge
from .knee import Knee
from .spool import MADE_UP, crossing_path, kept_back


@dataclass(slots=True)
class ValveInverse:
    """The flow of the last ticks, and the volts for them that are not handed out yet."""

    tick_s: float
    oil_m: float = math.nan  # wanted oil displacement at the last boundary looked at
    flows_m_s: tuple[float, float] = (0.0, 0.0)  # wanted oil velocity of the last two ticks
    flow_V: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # for the flow alone: the oldest goes out next
    later_V: tuple[float, float] = (0.0, 0.0)  # to be made up in the two ticks to come
    jumps_V: tuple[float, float] = (0.0, 0.0)  # across the overlap, of the two ticks before

    def advance(
        self, oil_m: float, roots: tuple[float, float], edges: list[Edge], knee: Knee, lag_s: float
    ) -> tuple[float, float]:
        """Volts for the flow, and across the overlap, that a spool without lag would need three ticks before the boundary
        that `oil_m` [m] is wanted at; roots: sqrt(dp/dp_ref) of the edges to tank and from the supply."""
        if self.oil_m != self.oil_m:
            self.oil_m = oil_m
        newest = (oil_m - self.oil_m) / self.tick_s
        self.oil_m = oil_m
        old, mean = self.flows_m_s
        self.flows_m_s = (mean, newest)
        first, last = 0.5 * (old + mean), 0.5 * (mean + newest)
        down, up = edges
        edge, root = (up, roots[1]) if mean > 0 else (down, roots[0])
        less = knee.value(abs(mean), edge.gain_m_s_V, edge.dead_band_V)
        sharp = 1.0 + less / max(edge.dead_band_V, -less) if less else 1.0
        flow = self.flow_V
        del flow[0]
        flow.append(mean / (edge.gain_m_s_V * root) + self.later_V[0])
        self.later_V = (self.later_V[1], 0.0)
        if first * last < 0.0:
            share = first / (first - last)
            half = 0.5 * sharp * (up.dead_band_V + down.dead_band_V)
            self._make_up(share, (last - first) / (edge.gain_m_s_V * root), half, lag_s)
            side = math.copysign(1.0, last) * (1.0 - 2.0 * share)
        else:
            side = 1.0 if mean > 0 else (-1.0 if mean < 0 else 0.0)
        jump = 0.5 * sharp * (up.dead_band_V * (1.0 + side) - down.dead_band_V * (1.0 - side))
        older, newer = self.jumps_V
        self.jumps_V = (newer, jump)
        return flow[0], older

    def _make_up(self, share: float, slope_V: float, half_V: float, lag_s: float) -> None:
        """The flow turns in the newest tick, `share` of it being over: give before and after what is kept back."""
        before, after = kept_back(crossing_path(lag_s, self.tick_s), share, abs(slope_V), half_V)
        sign = math.copysign(MADE_UP, slope_V)
        self.flow_V[0] += sign * before * (1.0 - share)
        self.flow_V[1] += sign * before * share
        self.later_V = (sign * after * (1.0 - share), sign * after * share)
