"""Safety manifold between valve and chamber: check valves and settling orifices, with the numbers of the leg's row.

    check valves        q = K_c sqrt(P - Ps)   from a chamber above supply pressure back to the supply
                        q = K_c sqrt(Pt - P)   from the tank into a chamber below tank pressure
    settling orifice    q = K_s s(y) sqrt(P - Pt)   from a chamber to the tank while its leg is lowered without its valve
                        s(y) = sqrt(y/l) within l of the stop, 1 above:   v^2 = v_s^2 y/l, a braking of v_s^2/(2 l)

The blocking valve and its orifice stand in series with the edges: `ports.open_area`.
"""

import math

from hexsim.compiled import compiled
from hexsim.hydraulics import valve
from hexsim.hydraulics.parameters import P


@compiled
def check_flow(gain, dp, width):
    """Flow [m3/s] through a check valve that opens towards falling pressure, dp > 0."""
    return gain * valve.smooth_root(dp, width) if dp > 0.0 else 0.0


@compiled
def taper(p, y):
    """Share of the settling orifice that is open at piston position y [m]: it never shuts."""
    if y >= p[P.SETTLING_TAPER]:
        return 1.0
    return max(math.sqrt(max(y, 0.0) / p[P.SETTLING_TAPER]), 0.02)


@compiled
def returned_flow(p, P_chamber, Ps):
    """Flow from a chamber back to the supply [m3/s]."""
    return check_flow(p[P.CHECK_GAIN], P_chamber - Ps, p[P.PRESSURE_WIDTH])


@compiled
def inflow(p, P_chamber, Ps, share):
    """Net flow [m3/s] into a chamber through check valves and the settling orifice, of which `share` is open."""
    flow = check_flow(p[P.CHECK_GAIN], p[P.TANK_PRESSURE] - P_chamber, p[P.PRESSURE_WIDTH])
    flow -= returned_flow(p, P_chamber, Ps)
    return flow - share * p[P.SETTLING_GAIN] * valve.smooth_root(P_chamber - p[P.TANK_PRESSURE], p[P.PRESSURE_WIDTH])


@compiled
def slope(p, P_chamber, Ps):
    """d inflow/d P_chamber [m3/s/Pa], <= 0, of a settling orifice that is whole."""
    above, below = P_chamber - Ps, p[P.TANK_PRESSURE] - P_chamber
    gain = p[P.CHECK_GAIN] if above > 0.0 or below > 0.0 else 0.0
    settling = p[P.SETTLING_GAIN] * valve.smooth_root_slope(P_chamber - p[P.TANK_PRESSURE], p[P.PRESSURE_WIDTH])
    return -gain * valve.smooth_root_slope(max(above, below), p[P.PRESSURE_WIDTH]) - settling
