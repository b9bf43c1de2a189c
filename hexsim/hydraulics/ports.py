"""Ports of a leg's valve: flows through its edges and leaks with the numbers of the leg's row.

    port A: bottom chamber    q_A = q(P-A) - q(A-T),   P-A opens for x > 0, A-T for x < 0          Eq. 3.4
    port B: rod side          q_B = q(P-B) - q(B-T),   P-B opens for x < 0, B-T for x > 0          four-way valve

Each edge has its own overlap O, area gradient g and rounding; the discharge coefficient is the valve's, and so is the
Reynolds number below which an edge is laminar. (In series with a manifold's port the edge alone is: where it is laminar
it is nearly shut, and the port's drop is none.) Leakage across
the piston and along the rod joins the ports' balances: q_B += G_p (P1 - P2) - G_r (P2 - Pt), laminar.
"""

import math

from hexsim.compiled import compiled
from hexsim.hydraulics import manifold, valve
from hexsim.hydraulics.parameters import P


@compiled
def edge_PA(p):
    """(overlap [m], area gradient [m], rounding [m]) of the edge P-A."""
    return p[P.OVERLAP_SUPPLY], p[P.AREA_GRADIENT_SUPPLY], p[P.ROUNDING_SUPPLY]


@compiled
def edge_AT(p):
    """(overlap [m], area gradient [m], rounding [m]) of the edge A-T."""
    return p[P.OVERLAP_TANK], p[P.AREA_GRADIENT_TANK], p[P.ROUNDING_TANK]


@compiled
def edge_PB(p):
    """(overlap [m], area gradient [m], rounding [m]) of the edge P-B."""
    return p[P.OVERLAP_SUPPLY_TOP], p[P.AREA_GRADIENT_SUPPLY_TOP], p[P.ROUNDING_SUPPLY_TOP]


@compiled
def edge_BT(p):
    """(overlap [m], area gradient [m], rounding [m]) of the edge B-T."""
    return p[P.OVERLAP_TANK_TOP], p[P.AREA_GRADIENT_TANK_TOP], p[P.ROUNDING_TANK_TOP]


@compiled
def clearance(p, x, overlap):
    """Laminar conductance across a land [m3/s/Pa] for travel x towards its edge."""
    return valve.clearance_conductance(x, overlap, p[P.CLEARANCE_CONDUCTANCE], p[P.CLEARANCE_LENGTH])


@compiled
def open_area(p, x, edge):
    """Flow area of an edge (overlap, gradient, rounding) [m2] for travel x towards it, with what is in series with it.

    R of the port's line: K^2 = k^2/(1 + R k^2), k = C_d a sqrt(2/rho) of the edge alone.
    """
    area = valve.edge_area(x, edge[0], edge[2], edge[1], p[P.QUADRATIC_GAIN])
    if p[P.PORT_RESISTANCE] > 0.0:
        area /= math.sqrt(1.0 + p[P.PORT_RESISTANCE] * (p[P.DISCHARGE] * area) ** 2 * 2.0 / p[P.DENSITY])
    return area


@compiled
def width(p, x, edge):
    """Pressure drop [Pa] within which the flow through an edge is smooth, or laminar, for travel x towards it."""
    if p[P.LAMINAR] == 0.0:
        return p[P.PRESSURE_WIDTH]
    opening = max(x, 0.0) if p[P.QUADRATIC_GAIN] > 0.0 else valve.opening(x, edge[0], edge[2])
    return valve.transition_pressure(opening, p[P.LAMINAR], p[P.DISCHARGE], p[P.DENSITY], p[P.PRESSURE_WIDTH])


@compiled
def drop_before_line(p, gain, dp, width):
    """Pressure drop e [Pa] across an edge with a return line behind it, e + R q(e) = |dp|, q of `valve.smooth_root`.

    From the root law's closed form, whose flow is the larger and drop the smaller one: Newton's steps come from below
    and end at the root, as q is concave.
    """
    line = gain * p[P.RETURN_RESISTANCE]
    root = 0.5 * (math.sqrt(line * line + 4.0 * abs(dp)) - line)
    drop = root * root
    for _ in range(5):  # Newton's steps, from the root law to 1e-12 of the drop
        excess = drop + line * valve.smooth_root(drop, width) - abs(dp)
        drop = max(drop - excess / (1.0 + line * valve.smooth_root_slope(drop, width)), 0.0)
    return drop


@compiled
def supply_edge(p, x, dp, edge):
    """Flow from the supply across an edge [m3/s] for travel x towards it, dp = Ps - P of the port."""
    area = open_area(p, x, edge)
    flow = 0.0  # one of the two edges is shut
    if area != 0.0:
        flow = valve.orifice_flow(area, dp, p[P.DISCHARGE], p[P.DENSITY], width(p, x, edge))
    if p[P.CLEARANCE_CONDUCTANCE] != 0.0:
        flow += clearance(p, x, edge[0]) * dp
    return flow


@compiled
def tank_edge(p, x, dp, edge):
    """Flow to the tank across an edge [m3/s] for travel x towards it, dp = P of the port - Pt.

    A return line of resistance R [Pa s/m3] raises the pressure behind the edge by R q: q solves q = K sqrt(dp - R q).
    """
    area = open_area(p, x, edge)
    if area == 0.0:
        flow = 0.0
    elif p[P.RETURN_RESISTANCE] > 0.0:
        gain = p[P.DISCHARGE] * area * math.sqrt(2.0 / p[P.DENSITY])
        if p[P.LAMINAR] > 0.0:
            wide = width(p, x, edge)
            flow = math.copysign(gain * valve.smooth_root(drop_before_line(p, gain, dp, wide), wide), dp)
        else:
            line = gain * p[P.RETURN_RESISTANCE]
            flow = math.copysign(0.5 * gain * (math.sqrt(line * line + 4.0 * abs(dp)) - line), dp)
    else:
        flow = valve.orifice_flow(area, dp, p[P.DISCHARGE], p[P.DENSITY], width(p, x, edge))
    if p[P.CLEARANCE_CONDUCTANCE] != 0.0:
        flow += clearance(p, x, edge[0]) * dp
    return flow


@compiled
def port_slope(p, x, P_port, Ps, supply_side, tank_side):
    """d(net flow into a port)/d(its pressure) [m3/s/Pa], <= 0, of edges alone; x > 0 opens to the supply."""
    factor = p[P.DISCHARGE] * math.sqrt(2.0 / p[P.DENSITY])
    supply, tank = open_area(p, x, supply_side), open_area(p, -x, tank_side)
    dp = P_port - p[P.TANK_PRESSURE]
    slope = 0.0
    if supply > 0.0:
        slope -= factor * supply * valve.smooth_root_slope(Ps - P_port, width(p, x, supply_side))
    if tank > 0.0 and p[P.RETURN_RESISTANCE] <= 0.0:
        slope -= factor * tank * valve.smooth_root_slope(dp, width(p, -x, tank_side))
    elif tank > 0.0 and p[P.LAMINAR] > 0.0:
        wide = width(p, -x, tank_side)
        steep = factor * tank * valve.smooth_root_slope(drop_before_line(p, factor * tank, dp, wide), wide)
        slope -= steep / (1.0 + p[P.RETURN_RESISTANCE] * steep)
    elif tank > 0.0:
        slope -= factor * tank / math.sqrt((factor * tank * p[P.RETURN_RESISTANCE]) ** 2 + 4.0 * abs(dp))
    if p[P.CLEARANCE_CONDUCTANCE] != 0.0:
        slope -= clearance(p, x, supply_side[0]) + clearance(p, -x, tank_side[0])
    return slope


@compiled
def is_edge_below(p, x, dp, edge, h, limit):
    """Is h dq/d(dp) [m3/Pa] of an edge surely below the limit? Without a root, from two bounds of its factors:

    opening <= max(x - O, 0) + s log 2 and smooth_root_slope <= (dp^2 + w^2)^(-1/4), w no wider than a laminar edge's.
    """
    area = edge[1] * (max(x - edge[0], 0.0) + 0.7 * edge[2])
    if p[P.QUADRATIC_GAIN] > 0.0:
        area = valve.edge_area(x, edge[0], 0.0, edge[1], p[P.QUADRATIC_GAIN])
    gain = h * p[P.DISCHARGE] * math.sqrt(2.0 / p[P.DENSITY]) * area
    return (gain * gain) ** 2 <= (limit * limit) ** 2 * (dp * dp + p[P.PRESSURE_WIDTH] * p[P.PRESSURE_WIDTH])


@compiled
def is_slope_below(p, x, P1, Ps, h, limit):
    """Is -h `flow_slope` surely below the limit [m3/Pa]? A quick answer; False leaves it open."""
    if p[P.CLEARANCE_CONDUCTANCE] != 0.0 or p[P.RETURN_RESISTANCE] > 0.0 or p[P.CHECK_GAIN] > 0.0:
        return False
    leaks = p[P.LEAK_SUPPLY_CHAMBER] + p[P.LEAK_CHAMBER_TANK] + p[P.LEAK_PISTON] + p[P.RELIEF_CONDUCTANCE]
    half = 0.5 * (limit - h * (leaks + p[P.WEAR_CONDUCTANCE]))
    if half <= 0.0:
        return False
    supply = is_edge_below(p, x, Ps - P1, edge_PA(p), h, half)
    tank = P1 - p[P.TANK_PRESSURE]
    return supply and is_edge_below(p, -x, tank, edge_AT(p), h, half)


@compiled
def worn_conductance(p, y):
    """Laminar conductance [m3/s/Pa] past the piston's seal at y [m] for the wear of the bore: G exp(-((y - y0)/w)^2)."""
    if p[P.WEAR_CONDUCTANCE] == 0.0:
        return 0.0
    off = (y - p[P.WEAR_PLACE]) / p[P.WEAR_WIDTH]
    return p[P.WEAR_CONDUCTANCE] * math.exp(-off * off)


@compiled
def supply_edge_flow(p, x, P1, Ps):
    """Flow from the supply into the bottom chamber [m3/s], first term of Eq. 3.4."""
    return supply_edge(p, x, Ps - P1, edge_PA(p))


@compiled
def tank_edge_flow(p, x, P1):
    """Flow from the bottom chamber to the tank [m3/s], second term of Eq. 3.4."""
    return tank_edge(p, -x, P1 - p[P.TANK_PRESSURE], edge_AT(p))


@compiled
def flow_slope(p, x, P1, Ps):
    """d(net flow into the bottom chamber)/dP1 [m3/s/Pa], <= 0."""
    slope = port_slope(p, x, P1, Ps, edge_PA(p), edge_AT(p))
    if p[P.CHECK_GAIN] > 0.0:
        slope += manifold.slope(p, P1, Ps)
    if p[P.RELIEF_OPENS] < P1:
        slope -= p[P.RELIEF_CONDUCTANCE]
    return slope - p[P.LEAK_SUPPLY_CHAMBER] - p[P.LEAK_CHAMBER_TANK] - p[P.LEAK_PISTON]


@compiled
def top_supply_flow(p, x, P2, Ps):
    """Flow from the supply into a rod side on the valve, edge P-B [m3/s]."""
    return supply_edge(p, -x, Ps - P2, edge_PB(p))


@compiled
def top_tank_flow(p, x, P2):
    """Flow from a rod side on the valve to the tank, edge B-T [m3/s]."""
    return tank_edge(p, x, P2 - p[P.TANK_PRESSURE], edge_BT(p))


@compiled
def top_inflow(p, x, P1, P2, Ps):
    """Net flow into a rod side on the valve through edges and leaks [m3/s]."""
    flow = top_supply_flow(p, x, P2, Ps) - top_tank_flow(p, x, P2)
    if p[P.CHECK_GAIN] > 0.0:
        flow += manifold.inflow(p, P2, Ps, 1.0)
    return flow + p[P.LEAK_PISTON] * (P1 - P2) - p[P.LEAK_TOP_TANK] * (P2 - p[P.TANK_PRESSURE])


@compiled
def top_slope(p, x, P2, Ps):
    """d(net flow into the rod side)/dP2 [m3/s/Pa], <= 0."""
    slope = port_slope(p, -x, P2, Ps, edge_PB(p), edge_BT(p))
    if p[P.CHECK_GAIN] > 0.0:
        slope += manifold.slope(p, P2, Ps)
    return slope - p[P.LEAK_PISTON] - p[P.LEAK_TOP_TANK]
