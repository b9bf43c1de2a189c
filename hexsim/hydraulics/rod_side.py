"""Rod side that is a chamber of its own: behind a port of the supply line, or on the valve's port B.

dP2/dt = (q + A2 v)/C2,   q = K sqrt(Ps - P2) through the port, or what port B gives
"""

from hexsim.compiled import compiled
from hexsim.hydraulics import chamber, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.ports import top_inflow, top_slope, worn_conductance


@compiled
def port_flow(p, P2, Ps):
    """Flow from the supply line into a rod side that is a chamber of its own [m3/s]."""
    return p[P.ROD_SIDE_CONDUCTANCE] * valve.smooth_root(Ps - P2, p[P.PRESSURE_WIDTH])


@compiled
def capacity(p, y, P2):
    """Hydraulic capacity of the rod side [m3/Pa]; it shrinks as the piston extends."""
    oil = chamber.volume(p[P.STROKE] - y, p[P.AREA_TOP], p[P.ROD_SIDE_VOLUME])
    air = max(p[P.AIR_FRACTION] + p[P.AIR_FRACTION_TOP], 0.0)
    return chamber.capacity(oil, P2, p[P.BULK_MODULUS], air, 0.0)


@compiled
def intake(p, y, v, P2, Ps, h=0.0):
    """What a rod side of its own takes from the supply line within a time step h [s] (0 = exact) [m3/s].

    A wide port fills the annulus in microseconds, faster than the step. There the net flow is divided by
    1 + max(h slope/C - 1, 0): P2 follows Ps within the step, towards the same balance, oil conserved.
    """
    port, moved = port_flow(p, P2, Ps), p[P.AREA_TOP] * v
    slope = p[P.ROD_SIDE_CONDUCTANCE] * valve.smooth_root_slope(Ps - P2, p[P.PRESSURE_WIDTH])
    excess = h * slope / capacity(p, y, P2) - 1.0
    if excess <= 0.0:
        return port
    return (port + moved) / (1.0 + excess) - moved


@compiled
def port_rate(p, y, v, P2, Ps, h=0.0):
    """dP2/dt [Pa/s] of a rod side that is a chamber of its own behind a port."""
    return chamber.pressure_rate(intake(p, y, v, P2, Ps, h) + p[P.AREA_TOP] * v, capacity(p, y, P2), P2)


@compiled
def valve_inflow(p, y, x, P1, P2, Ps):
    """Net flow into a rod side on the valve [m3/s]: port B, leaks, and what a worn bore lets through."""
    return top_inflow(p, x, P1, P2, Ps) + worn_conductance(p, y) * (P1 - P2)


@compiled
def valve_rate(p, y, v, x, P1, P2, Ps, h):
    """dP2/dt [Pa/s] of a rod side on the valve's port B, slowed to the time step h [s] as P1 is."""
    room = capacity(p, y, P2)
    rate = chamber.pressure_rate(valve_inflow(p, y, x, P1, P2, Ps) + p[P.AREA_TOP] * v, room, P2)
    return rate / chamber.slowdown(h * (worn_conductance(p, y) - top_slope(p, x, P2, Ps)), room)
