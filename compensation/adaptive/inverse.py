"""Inverse of the identified valve: volts that let a demanded oil displacement through, tick by tick.

Two signals leave it apart, for the spool follows each through taps of its own (taps.py): the volts for the mean flow
of a tick, and the dead-band compensation, which crosses the overlap where the flow reverses. While the spool crosses,
the valve is shut and blocks flow. Crossing flow compensation gives a share of the blocked oil in the two ticks before
the crossing and in the two after it. Where edges are known to be rounded the first signal is the inverse of both edges
together, and the second the step across what of the overlap lies within.
"""

from __future__ import annotations

import math

from ..compiled import compiled
from .chambers import pair_volts
from .edge_rounding import MIN_ROUNDING_V, rounding_correction_V
from .spool import blocked_flow

LEAST_ROUNDING_V, SHARP = 1e-3, 4.0  # of a four-way valve; roundings by which the step across an overlap is less
CROSSING_FLOW_SHARE = 0.6  # of the blocked oil that is compensated [1]; less than half or all leaves a larger bump


@compiled
def advance_inverse(inverse, oil_m, roots, valve, trim, path, leak_m_s):
    """Volts for the flow and dead-band compensation that a spool without lag would need, three ticks before the
    boundary at which `oil_m` [m] is demanded; roots: sqrt(dp/dp_ref) of the edges to tank and from the supply."""
    if not inverse.started:
        inverse.started, inverse.oil_m = True, oil_m
    newest = (oil_m - inverse.oil_m) / inverse.tick_s - leak_m_s
    inverse.oil_m = oil_m
    old, mean = inverse.flows_m_s[0], inverse.flows_m_s[1]
    inverse.old_m_s, inverse.flows_m_s[0], inverse.flows_m_s[1] = old, mean, newest
    first, last = 0.5 * (old + mean), 0.5 * (mean + newest)
    down, up = valve.edges[0], valve.edges[1]
    edge, root = valve.edges[1 if mean > 0 else 0], roots[1 if mean > 0 else 0]
    rounded = valve.four_way or (trim.known != 0 and trim.rounding_V > MIN_ROUNDING_V)
    less = 0.0 if rounded else rounding_correction_V(trim, abs(mean), edge.gain_m_s_V, edge.dead_band_V)
    sharpness = 1.0 + less / max(edge.dead_band_V, -less) if less != 0.0 else 1.0
    up_V, down_V = up.dead_band_V, down.dead_band_V
    flow = inverse.flow_V
    flow[0], flow[1] = flow[1], flow[2]
    flow[2] = mean / (edge.gain_m_s_V * root)
    if rounded:
        rounding_V = max(trim.rounding_V, trim.minimum_V, LEAST_ROUNDING_V)
        up_V, down_V = max(up_V - SHARP * rounding_V, 0.0), max(down_V - SHARP * rounding_V, 0.0)
        volts = pair_volts(mean, valve.edges, roots, rounding_V)
        flow[2] = _beyond(volts, up_V) if mean > 0 else -_beyond(-volts, down_V)
    flow[2] += inverse.crossing_V[0]
    inverse.crossing_V[0], inverse.crossing_V[1] = inverse.crossing_V[1], 0.0
    inverse.crossed = first * last < 0.0
    if inverse.crossed:
        share = first / (first - last)
        half = 0.5 * sharpness * (up_V + down_V)
        _compensate_crossing(inverse, share, (last - first) / (edge.gain_m_s_V * root), half, path)
        side = math.copysign(1.0, last) * (1.0 - 2.0 * share)
    else:
        side = 1.0 if mean > 0 else (-1.0 if mean < 0 else 0.0)
    older = inverse.dead_band_V[0]
    inverse.dead_band_V[0] = inverse.dead_band_V[1]
    inverse.dead_band_V[1] = 0.5 * sharpness * (up_V * (1.0 + side) - down_V * (1.0 - side))
    return flow[0], older


@compiled
def _beyond(volts, edge_V):
    """Volts beyond an edge; in the tick that crosses a wide overlap they end before it, which the dead-band volts do."""
    return max(volts - edge_V, 0.0) if edge_V > 0.0 else volts


@compiled
def _compensate_crossing(inverse, share, slope_V, half_V, path):
    """Crossing flow compensation: the flow reverses in the newest tick, when `share` of the tick is over."""
    before, after = blocked_flow(path, share, abs(slope_V), half_V)
    sign = math.copysign(CROSSING_FLOW_SHARE, slope_V)
    inverse.flow_V[0] += sign * before * (1.0 - share)
    inverse.flow_V[1] += sign * before * share
    inverse.crossing_V[0] = sign * after * (1.0 - share)
    inverse.crossing_V[1] = sign * after * share
