"""Rod side that is a chamber of its own: behind a port of the supply line, or on the valve's port B.

dP2/dt = (q + A2 v)/C2,   q = K sqrt(Ps - P2) through the port and G (P1 - P2) past the piston, or what port B gives

s2 is the state of the chamber, P2 its pressure (`chamber`).
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
def state_rate(p, y, v, s2, net):
    """ds2/dt [Pa/s] for a net flow [m3/s] that is already known."""
    room, growth = capacity(p, y, chamber.pressure(s2)), 0.0
    if s2 < chamber.VAPOUR:
        oil = chamber.volume(p[P.STROKE] - y, p[P.AREA_TOP], p[P.ROD_SIDE_VOLUME])
        growth = -room * p[P.AREA_TOP] * v / oil if oil > chamber.VOLUME_FLOOR else 0.0
    return chamber.state_rate(s2, net, room, growth)


@compiled
def leak(p, y, P1, P2):
    """Flow past the piston from the bottom chamber into the rod side [m3/s]; more where the bore is worn."""
    return (p[P.LEAK_PISTON] + worn_conductance(p, y)) * (P1 - P2)


@compiled
def intake(p, y, v, P1, s2, Ps, h=0.0):
    """What a rod side of its own takes from the supply line within a time step h [s] (0 = exact) [m3/s].

    A wide port fills the annulus in microseconds, faster than the step. There the net flow is divided by
    max(h slope/C, 1): P2 follows Ps within the step, towards the same balance, oil conserved.
    """
    P2 = chamber.pressure(s2)
    port = port_flow(p, P2, Ps)
    slope = p[P.ROD_SIDE_CONDUCTANCE] * valve.smooth_root_slope(Ps - P2, p[P.PRESSURE_WIDTH])
    room = capacity(p, y, P2)
    if h * slope <= room:
        return port
    moved = p[P.AREA_TOP] * v + leak(p, y, P1, P2)
    return chamber.slowed(port + moved, s2, room, h * slope / room, h) - moved


@compiled
def port_rate(p, y, v, P1, s2, Ps, h=0.0):
    """ds2/dt [Pa/s] of a rod side that is a chamber of its own behind a port."""
    net = intake(p, y, v, P1, s2, Ps, h) + p[P.AREA_TOP] * v + leak(p, y, P1, chamber.pressure(s2))
    return state_rate(p, y, v, s2, net)


@compiled
def valve_inflow(p, y, x, P1, P2, Ps):
    """Net flow into a rod side on the valve [m3/s]: port B, leaks, and what a worn bore lets through."""
    return top_inflow(p, x, P1, P2, Ps) + worn_conductance(p, y) * (P1 - P2)


@compiled
def valve_rate(p, y, v, x, P1, s2, Ps, h):
    """ds2/dt [Pa/s] of a rod side on the valve's port B, slowed to the time step h [s] as P1 is."""
    P2 = chamber.pressure(s2)
    room = capacity(p, y, P2)
    net = valve_inflow(p, y, x, P1, P2, Ps) + p[P.AREA_TOP] * v
    slower = chamber.slowdown(h * (worn_conductance(p, y) - top_slope(p, x, P2, Ps)), room)
    return state_rate(p, y, v, s2, chamber.slowed(net, s2, room, slower, h))
