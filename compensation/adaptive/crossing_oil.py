"""Oil at a reversal of a four-way valve whose spool jumps across an overlap.

The motion, a leak and friction's step ask for oil within the few ms in which the spool crosses. Two things keep it right:

The spool does not jump across the overlap and back for little. While a leak still asks for the old direction, friction's step
asks for the new one, and the flow that is asked for reverses three times within some ms. The spool stays on its side while
the oil owed by that is less than such a jump lets through wrongly.

And the oil of a crossing of a wide overlap is reckoned by the path that the spool will take through both rounded edges,

    excess = int z'(x) dt - int z_m' dt,     x the responses to the steps of both signals that it follows (taps.py)

It is taken off the oil asked for after the crossing.
"""

from __future__ import annotations

import math

from ..arithmetic import clip
from ..compiled import compiled
from .chambers import pair_flow_m_s, pair_volts
from .inverse import LEAST_ROUNDING_V, SHARP
from .layout import CROSSING_TICKS, PATH_AFTER, PATH_BEFORE, PATH_FINE
from .valve import overlap_V

STAY_OIL_M = 8e-6  # owed at most: half of what a jump across an overlap and back lets through
NO_FLOW_M_S = 1e-9  # of a spool that stays within the overlap, with the sign of its side
MAX_EXCESS_M = 3e-5  # of a crossing; more is something else
WIDE_V = 0.6  # overlap from which a crossing is reckoned: 0.8 V gained by it, 0.4 V lost at 120 kg


@compiled
def stay_on_side(inverse, oil_m, leak_m_s, velocity_m_s, acceleration_m_s2, missing_m):
    """The oil to ask for, so that the spool does not jump across an overlap and back for little: while a leak still asks for
    the old direction, friction's step asks for the new one, and the flow would reverse three times within some ms.

    It stays where it is while the oil of the other direction, `missing_m` of friction's step and what the motion will
    ask for before it turns back, is less than such a jump lets through wrongly. That oil is owed, and taken off later.
    """
    before = inverse.flows_m_s[1]
    flow = (oil_m - inverse.oil_m) / inverse.tick_s - leak_m_s
    if not inverse.started or flow * before >= 0.0:
        return oil_m
    side, base = math.copysign(1.0, before), velocity_m_s - leak_m_s
    owed_m = abs(flow) * inverse.tick_s + max(-side * missing_m, 0.0)
    if base * side < 0.0:
        if acceleration_m_s2 * side <= 0.0:
            return oil_m
        owed_m += 0.5 * base * base / abs(acceleration_m_s2)
    if owed_m > STAY_OIL_M:
        return oil_m
    return inverse.oil_m + (leak_m_s + side * NO_FLOW_M_S) * inverse.tick_s


@compiled
def settle_crossing(state, older_V, roots, leak_m_s, velocity_m_s, acceleration_m_s2, missing_m):
    """After a tick of the inverse: where a crossing was decided in it, what its path lets through beyond what is asked for is
    taken off what comes after it. older_V: dead-band volts of two ticks before the crossing."""
    inverse, tick_s = state.inverse, state.inverse.tick_s
    if not inverse.crossed or overlap_V(state.valve) < WIDE_V:
        return
    newest = inverse.flows_m_s[1]
    side, next_m_s = math.copysign(1.0, newest), velocity_m_s + 0.5 * acceleration_m_s2 * tick_s - leak_m_s
    _expect(inverse, older_V, next_m_s, acceleration_m_s2 * tick_s, missing_m / tick_s)
    rounding_V = max(state.trim.rounding_V, state.trim.minimum_V, LEAST_ROUNDING_V)
    excess_m = clip(_excess_m(state, side, roots, rounding_V), -MAX_EXCESS_M, MAX_EXCESS_M)
    inverse.flows_m_s[1] = side * max(side * (newest - excess_m / tick_s), NO_FLOW_M_S)
    inverse.oil_m += excess_m + (inverse.flows_m_s[1] - newest) * tick_s


@compiled
def _expect(inverse, older_V, next_m_s, change_m_s, missing_m_s):
    """Flow asked for in each tick from the one before the crossing on; of those to come what the motion will ask for, and the
    rest of friction's step in the first of them. Volts so far."""
    asked, side = inverse.crossing_m_s, math.copysign(1.0, inverse.flows_m_s[1])
    asked[0], asked[1], asked[2] = inverse.old_m_s, inverse.flows_m_s[0], inverse.flows_m_s[1]
    for k in range(3, CROSSING_TICKS - 1):
        asked[k] = side * max(side * (next_m_s + (k - 3) * change_m_s + (missing_m_s if k == 3 else 0.0)), 0.0)
    for k in range(3):
        inverse.path_flow_V[k] = inverse.flow_V[k]
    inverse.path_dead_V[0] = older_V
    inverse.path_dead_V[1], inverse.path_dead_V[2] = inverse.dead_band_V


@compiled
def _excess_m(state, side, roots, rounding_V):
    """Oil that the spool's path lets through beyond what is asked for."""
    inverse, edges, last = state.inverse, state.valve.edges, PATH_FINE * (PATH_BEFORE + PATH_AFTER) - 1
    flow_V, dead_V = inverse.path_flow_V, inverse.path_dead_V
    edge_V = max(edges[1 if side > 0.0 else 0].dead_band_V - SHARP * rounding_V, 0.0)
    for k in range(3, CROSSING_TICKS):
        volts = side * pair_volts(inverse.crossing_m_s[k - 1], edges, roots, rounding_V)
        flow_V[k] = side * (max(volts - edge_V, 0.0) if edge_V > 0.0 else volts)
        flow_V[k] += inverse.crossing_V[k - 3] if k < 5 else 0.0
        dead_V[k] = side * edge_V
    passed = 0.0
    for i in range(PATH_FINE, CROSSING_TICKS * PATH_FINE):
        x = flow_V[0] + dead_V[0]
        for k in range(1, CROSSING_TICKS):
            j = min(i - (k - PATH_BEFORE) * PATH_FINE, last)
            if j >= 0:
                x += 0.5 * (flow_V[k] - flow_V[k - 1]) * (1.0 + state.lead_path[j])
                x += 0.5 * (dead_V[k] - dead_V[k - 1]) * (1.0 + state.crossing_path[j])
        passed += pair_flow_m_s(x, edges, roots, rounding_V) / PATH_FINE
    for k in range(CROSSING_TICKS - 1):
        passed -= inverse.crossing_m_s[k]
    return passed * inverse.tick_s
