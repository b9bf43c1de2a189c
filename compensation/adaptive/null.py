"""Where the null lies between the valve's edges, and whether both are open there: a four-way valve with underlap.

An edge pair alone lets k R (|x| - delta) through, its delta negative with underlap. Within the underlap both pairs are
open, and the gain is that of both:

    z' = k R1 (x - delta_1) - k R0 (-x - delta_0),     delta_1 < x < -delta_0

So the bump of such a valve has friction's step in it and a gain that doubles, and no dead band. A window within the
underlap follows neither edge; windows keep clear of it (valve.py). What leaks is in either edge as windows see it: where
both are open it counts twice, as across an overlap it does not count at all (leak.py).
"""

from __future__ import annotations

from ..arithmetic import clip
from ..compiled import compiled
from .valve import overlap_V, restart_window, valve_usable
from .valve_edge import MAX_DEAD_BAND_V, begin_edge, edge_V, shift_edge

NULL_TOLERANCE_V = 5e-3  # by which the null may be off the middle of the edges
UNDERLAP_V = 0.04  # of both edges together, from which on windows keep clear of it; half of it to stay


@compiled
def edges_moved(valve):
    """Moves the null into the middle of the edges and keeps clear of an underlap; whether earlier passages tell no leak."""
    moved = recentre(valve) and not valve.underlap  # an underlap is there wherever its middle is
    return _underlap_found(valve) or moved


@compiled
def recentre(valve):
    """Moves the null into the middle of the edges, where it is well off it; whether it was."""
    down, up = valve.edges[0], valve.edges[1]
    off = 0.5 * (edge_V(up) - edge_V(down))
    off = clip(valve.null_V + off, -MAX_DEAD_BAND_V, MAX_DEAD_BAND_V) - valve.null_V
    if not valve_usable(valve) or abs(off) < NULL_TOLERANCE_V:
        return False
    valve.null_V += off
    shift_edge(up, off, 0.0)
    shift_edge(down, -off, 0.0)
    restart_window(valve)
    return True


@compiled
def has_underlap(valve):
    """Whether the edges, as far as they are known, are both open between them."""
    return valve_usable(valve) and overlap_V(valve) < -UNDERLAP_V


@compiled
def _underlap_found(valve):
    """Whether from now on windows keep clear of an underlap, in which both edge pairs let oil through. Those so far did not.
    A backlash that is not known yet looks like one for a while."""
    if valve.underlap:
        valve.underlap = overlap_V(valve) < -0.5 * UNDERLAP_V
        return False
    if not has_underlap(valve):
        return False
    valve.underlap = True
    begin_edge(valve.edges[0])
    begin_edge(valve.edges[1])
    restart_window(valve)
    return True


@compiled
def both_open(valve, volts):
    """Whether the spool is within an underlap."""
    return valve.underlap and volts > valve.edges[1].dead_band_V and -volts > valve.edges[0].dead_band_V
