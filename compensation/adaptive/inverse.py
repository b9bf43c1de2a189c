"""Inverse of the identified valve: volts that let a demanded oil displacement through, tick by tick.

Two signals leave it apart, for the spool follows each through taps of its own (spool.py): the volts for the mean flow
of a tick, and the dead-band compensation, which crosses the overlap where the flow reverses. While the spool crosses,
the valve is shut and blocks flow. Crossing flow compensation gives a share of the blocked oil in the two ticks before
the crossing and in the two after it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .edge_rounding import RoundingTrim
from .spool import blocked_flow
from .valve_edge import ValveEdge

CROSSING_FLOW_SHARE = 0.6  # of the blocked oil that is compensated [1]; less than half or all leaves a larger bump


@dataclass(slots=True)
class ValveInverse:
    """The flow of the last ticks, and the volts for them that have not left yet."""

    tick_s: float
    oil_m: float = math.nan  # demanded oil displacement at the last boundary
    flows_m_s: tuple[float, float] = (0.0, 0.0)  # demanded oil velocity of the last two ticks
    flow_V: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # for the flow, the next to leave first
    crossing_V: tuple[float, float] = (0.0, 0.0)  # crossing flow compensation of the two ticks to come
    dead_band_V: tuple[float, float] = (0.0, 0.0)  # dead-band compensation of the two ticks before

    def advance(
        self,
        oil_m: float,
        roots: tuple[float, float],
        edges: list[ValveEdge],
        trim: RoundingTrim,
        path: tuple[float, ...],
        leak_m_s: float = 0.0,
    ) -> tuple[float, float]:
        """Volts for the flow and dead-band compensation that a spool without lag would need, three ticks before the
        boundary at which `oil_m` [m] is demanded; roots: sqrt(dp/dp_ref) of the edges to tank and from the supply."""
        if self.oil_m != self.oil_m:
            self.oil_m = oil_m
        newest = (oil_m - self.oil_m) / self.tick_s - leak_m_s
        self.oil_m = oil_m
        old, mean = self.flows_m_s
        self.flows_m_s = (mean, newest)
        first, last = 0.5 * (old + mean), 0.5 * (mean + newest)
        down, up = edges
        edge, root = (up, roots[1]) if mean > 0 else (down, roots[0])
        less = trim.correction_V(abs(mean), edge.gain_m_s_V, edge.dead_band_V)
        sharpness = 1.0 + less / max(edge.dead_band_V, -less) if less else 1.0
        flow = self.flow_V
        del flow[0]
        flow.append(mean / (edge.gain_m_s_V * root) + self.crossing_V[0])
        self.crossing_V = (self.crossing_V[1], 0.0)
        if first * last < 0.0:
            share = first / (first - last)
            half = 0.5 * sharpness * (up.dead_band_V + down.dead_band_V)
            self._compensate_crossing(share, (last - first) / (edge.gain_m_s_V * root), half, path)
            side = math.copysign(1.0, last) * (1.0 - 2.0 * share)
        else:
            side = 1.0 if mean > 0 else (-1.0 if mean < 0 else 0.0)
        dead_band = 0.5 * sharpness * (up.dead_band_V * (1.0 + side) - down.dead_band_V * (1.0 - side))
        older, newer = self.dead_band_V
        self.dead_band_V = (newer, dead_band)
        return flow[0], older

    def _compensate_crossing(self, share: float, slope_V: float, half_V: float, path: tuple[float, ...]) -> None:
        """Crossing flow compensation: the flow reverses in the newest tick, when `share` of the tick is over."""
        before, after = blocked_flow(path, share, abs(slope_V), half_V)
        sign = math.copysign(CROSSING_FLOW_SHARE, slope_V)
        self.flow_V[0] += sign * before * (1.0 - share)
        self.flow_V[1] += sign * before * share
        self.crossing_V = (sign * after * (1.0 - share), sign * after * share)
