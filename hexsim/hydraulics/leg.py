"""The balances of one leg, summed from the terms of `valve`, `ports`, `chamber`, `rod_side`, `friction` and `learned`.

A leg's instant is (y, v, volts, x, P1, P2, Ps, t): piston position [m] from full retraction, velocity [m/s], valve
volts, spool position [m], pressures of bottom chamber, rod side and supply [Pa], time [s]. `p` is its row of parameters.
s1, s2 [Pa] are the states of the chambers, from which their pressures follow (`chamber`).
An effect joins by one line in the balance that it extends. Whoever integrates a leg asks `leg_derivatives` and
`leg_force`: MuJoCo's callbacks and the simulation of fits.
"""

import math

import numpy as np

from hexsim.compiled import allocating, compiled
from hexsim.hydraulics import chamber, friction, learned, manifold, rod_side, valve
from hexsim.hydraulics.parameters import FLOW_POINTS, FLOW_TABLE, ROD_SIDE_PORT, ROD_SIDE_SUPPLY, ROD_SIDE_VALVE, P
from hexsim.hydraulics.ports import (
    flow_slope,
    is_slope_below,
    supply_edge_flow,
    tank_edge_flow,
    top_supply_flow,
    worn_conductance,
)


@compiled
def commanded_spool(p, volts, t):
    """Spool position that the volts ask for [m], with null offset and drift."""
    null = p[P.NULL_OFFSET] + p[P.NULL_DRIFT] * t
    if p[P.NULL_WARM_UP] != 0.0:
        null += p[P.NULL_WARM_UP] * -math.expm1(-t / p[P.NULL_WARM_UP_TIME])
    return valve.spool_command(volts, null, p[P.SPOOL_GAIN], p[P.SPOOL_TRAVEL])


@compiled
def metering_spool(p, volts, t, x):
    """Spool position that opens the edges [m]: the state x within its travel, or the command of a spool without lag.

    Of a valve with a flow curve: the equivalent opening.
    """
    if p[P.SPOOL_OMEGA] > 0.0:
        place = min(max(x, -p[P.SPOOL_TRAVEL]), p[P.SPOOL_TRAVEL])
    else:
        place = commanded_spool(p, volts, t)
    return flow_curve(p, place) if p[P.FLOW_POINTS] > 0.0 else place


@compiled
def flow_curve(p, x):
    """Opening [m] that gives the flow of the declared curve at spool position x [m]: linear, beyond its ends too."""
    last = int(p[P.FLOW_POINTS]) - 1
    k = 1
    while k < last and x > p[FLOW_TABLE + k]:
        k += 1
    start, end = p[FLOW_TABLE + k - 1], p[FLOW_TABLE + k]
    low, high = p[FLOW_TABLE + FLOW_POINTS + k - 1], p[FLOW_TABLE + FLOW_POINTS + k]
    return low + (high - low) * (x - start) / (end - start)


@compiled
def inflow(p, y, v, volts, x, P1, Ps, t, memory=0.0):
    """Net flow into the bottom chamber through valve and leaks [m3/s]: phi_1 of Eq. 3.4 and what extends it."""
    flow = supply_edge_flow(p, x, P1, Ps) - tank_edge_flow(p, x, P1)
    flow += p[P.LEAK_SUPPLY_CHAMBER] * (Ps - P1) - p[P.LEAK_CHAMBER_TANK] * (P1 - p[P.TANK_PRESSURE])
    if p[P.RELIEF_CONDUCTANCE] != 0.0:
        flow -= p[P.RELIEF_CONDUCTANCE] * max(P1 - p[P.RELIEF_OPENS], 0.0)
    if p[P.WEAR_CONDUCTANCE] != 0.0 and p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_SUPPLY:
        flow += worn_conductance(p, y) * (Ps - P1)
    if p[P.CHECK_GAIN] > 0.0:
        flow += manifold.inflow(p, P1, Ps, manifold.taper(p, y))
    if p[P.LEARNED_BALANCE] == learned.CONTINUITY:
        flow += learned.term(p, y, v, volts, P1, Ps, t, memory)
    return flow


@compiled
def inflow_bottom(p, y, v, volts, x, P1, P2, Ps, t, memory=0.0):
    """`inflow` less what leaks across the piston of a leg whose rod side is a chamber [m3/s]."""
    flow = inflow(p, y, v, volts, x, P1, Ps, t, memory)
    if p[P.ROD_SIDE_CHAMBER] > 0.0:
        flow -= rod_side.leak(p, y, P1, P2)
    return flow


@compiled
def chamber_capacity(p, y, P1):
    """Hydraulic capacity of the bottom chamber [m3/Pa]."""
    oil = chamber.volume(y, p[P.AREA_BOTTOM], p[P.PIPELINE_VOLUME])
    return chamber.capacity(oil, P1, p[P.BULK_MODULUS], p[P.AIR_FRACTION], p[P.HOSE_COMPLIANCE])


@compiled
def bottom_rate(p, y, v, s1, net, room):
    """ds1/dt [Pa/s] for what flows into the bottom chamber less what the piston sweeps [m3/s], Eq. 3.7. room: its capacity."""
    growth = 0.0
    if s1 < chamber.VAPOUR:
        oil = chamber.volume(y, p[P.AREA_BOTTOM], p[P.PIPELINE_VOLUME])
        growth = (room - p[P.HOSE_COMPLIANCE]) * p[P.AREA_BOTTOM] * v / oil if oil > chamber.VOLUME_FLOOR else 0.0
    return chamber.state_rate(s1, net, room, growth)


@compiled
def pressure_slowdown(p, y, x, P1, Ps, h):
    """By what the net flow is divided in a step h [s]; h lambda = -h (dq/dP1)/C, the step over the edge's time constant.

    Flow through an edge falls as the root of its pressure drop: one step of h lambda = 1, its tangent, goes twice as far as
    to where it vanishes, and RK4 settles there; beyond, its stages overshoot into a flow the other way and the pressure
    stays bars beside its balance. So an open valve at little pressure drop is slowed to h lambda = 1, towards the same
    balance; 1 elsewhere.
    """
    capacity = chamber_capacity(p, y, P1)
    if is_slope_below(p, x, P1, Ps, h, capacity):
        return 1.0
    return chamber.slowdown(h * (worn_conductance(p, y) - flow_slope(p, x, P1, Ps)), capacity)


@compiled
def supply_demand(p, v, x, P1, P2, Ps):
    """Flow that the leg takes from the supply [m3/s]: valve, leak, and rod side (on the supply: given back on extension)."""
    flow = supply_edge_flow(p, x, P1, Ps) + p[P.LEAK_SUPPLY_CHAMBER] * (Ps - P1)
    if p[P.CHECK_GAIN] > 0.0:
        flow -= manifold.returned_flow(p, P1, Ps)
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        returned = manifold.returned_flow(p, P2, Ps) if p[P.CHECK_GAIN] > 0.0 else 0.0
        return flow + top_supply_flow(p, x, P2, Ps) - returned
    if p[P.ROD_SIDE_CHAMBER] > 0.0:
        return flow + rod_side.port_flow(p, P2, Ps)
    return flow - p[P.AREA_TOP] * v


@compiled
def supply_demand_in_step(p, y, v, x, P1, s2, Ps, h=0.0):
    """`supply_demand` with what a worn bore takes, and a rod side of its own within a time step h (0 = exact)."""
    P2 = chamber.pressure(s2)
    demand = supply_demand(p, v, x, P1, P2, Ps)
    if p[P.WEAR_CONDUCTANCE] != 0.0 and p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_SUPPLY:
        demand += worn_conductance(p, y) * (Ps - P1)
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_PORT:
        demand += rod_side.intake(p, y, v, P1, s2, Ps, h) - rod_side.port_flow(p, P2, Ps)
    return demand


@compiled
def cold_factor(p, t):
    """By what all friction is larger t [s] after the start than declared: 1 + s + a exp(-t/tau); 1 where nothing warms up."""
    if p[P.FRICTION_WARM_UP] == 0.0:
        return 1.0
    return 1.0 + p[P.FRICTION_SETTLED] + p[P.FRICTION_WARM_UP] * math.exp(-t / p[P.FRICTION_WARM_UP_TIME])


@compiled
def viscous_friction(p, v, t=math.inf):
    """Viscous part of friction [N] against the motion, t [s] after the start; without it warm, and nothing has faded."""
    viscous = cold_factor(p, t) * (p[P.VISCOUS_RETRACT] if v < 0.0 else p[P.VISCOUS_EXTEND])
    if p[P.VISCOUS_FADING] != 0.0 and t < math.inf:
        viscous *= math.exp(-p[P.VISCOUS_FADING] * t)
    return viscous * v


@compiled
def friction_level(p, y, v, P1, P2=0.0, t=math.inf):
    """g(v) = F_c + F_s exp(-|v|/c_s) [N] of the direction of motion, with seal and position-dependent parts.

    P2: asked for by seals of a rod side on the valve alone.  t [s]: after the start; without it, warm.
    """
    coulomb, static = p[P.COULOMB_EXTEND], p[P.STATIC_EXTEND]
    if v < 0.0:
        coulomb, static = p[P.COULOMB_RETRACT], p[P.STATIC_RETRACT]
    if p[P.SEAL_FRICTION] != 0.0:
        coulomb += p[P.SEAL_FRICTION] * max(P1, 0.0)
    if p[P.SEAL_FRICTION_TOP] != 0.0 or p[P.SEAL_FRICTION_ACROSS] != 0.0:
        coulomb += p[P.SEAL_FRICTION_TOP] * max(P2, 0.0) + p[P.SEAL_FRICTION_ACROSS] * abs(P1 - P2)
    if p[P.RIPPLE_FORCE] != 0.0:
        coulomb += p[P.RIPPLE_FORCE] * math.sin(2.0 * math.pi * y / p[P.RIPPLE_LENGTH] + p[P.RIPPLE_PHASE])
    level = cold_factor(p, t) * friction.stribeck_level(v, max(coulomb, 0.0), static, p[P.STRIBECK_VELOCITY])
    # a bristle divides by the level; 1 mN is far below any seal
    return max(level, 1.0e-3) if p[P.BRISTLE_STIFFNESS] > 0.0 else level


@compiled
def bristle_rate(p, y, v, P1, z, P2=0.0, t=math.inf):
    """dz/dt of the presliding bristle [m/s]."""
    return friction.bristle_rate(v, z, friction_level(p, y, v, P1, P2, t), p[P.BRISTLE_STIFFNESS])


@compiled
def friction_force(p, y, v, P1, z, P2=0.0, t=math.inf):
    """Friction [N] against the motion, Eq. 2.4 / 3.9, or LuGre when the leg has a bristle z [m]."""
    viscous = viscous_friction(p, v, t)
    if p[P.BRISTLE_STIFFNESS] > 0.0:
        rate = bristle_rate(p, y, v, P1, z, P2, t)
        return viscous + p[P.BRISTLE_STIFFNESS] * z + p[P.BRISTLE_DAMPING] * rate
    level = friction_level(p, y, v, P1, P2, t)
    return viscous + friction.direction(v, p[P.SHARPNESS], p[P.ARCTAN_SLOPE]) * level


@compiled
def heat(p, y, v, x, P1, s2, Ps, z, flow, demand, h=0.0, t=math.inf):
    """Heat [W] that the leg puts into the oil: throttling in valve, leaks and rod side port, and friction.

    What the supply gives (Ps q) less what the chambers take (P1 phi_1 of `flow`, and P2 q_2 or -Ps A2 v).
    """
    P2 = chamber.pressure(s2)
    throttled = Ps * demand - P1 * flow
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        throttled -= P2 * rod_side.valve_inflow(p, y, x, P1, P2, Ps)
    elif p[P.ROD_SIDE_CHAMBER] > 0.0:
        throttled -= P2 * (rod_side.intake(p, y, v, P1, s2, Ps, h) + rod_side.leak(p, y, P1, P2))
    else:
        throttled += Ps * p[P.AREA_TOP] * v
    return throttled + friction_force(p, y, v, P1, z, P2, t) * v


@compiled
def force_beyond_pressure(p, y, v, volts, P1, P2, Ps, z, t, memory=0.0):
    """What acts along the leg besides P1 A1 [N]: rod side, friction, end stops and the effects of the force balance.

    memory: of a learned term.
    """
    force = -P2 * p[P.AREA_TOP] - friction_force(p, y, v, P1, z, P2, t)
    force += friction.end_stop_force(
        y,
        v,
        p[P.STROKE],
        p[P.CUSHION_LENGTH],
        p[P.CUSHION_STIFFNESS],
        p[P.CUSHION_DAMPING],
        p[P.CUSHION_CHOKE_LOW],
        p[P.CUSHION_CHOKE_HIGH],
    )
    force += p[P.EXTRA_FORCE] - p[P.EXTRA_SPRING] * (y - 0.5 * p[P.STROKE]) - p[P.EXTRA_DAMPING] * v
    if p[P.HARDENING] != 0.0:
        force -= p[P.HARDENING] * (y - 0.5 * p[P.STROKE]) ** 3
    if p[P.TONE_FORCE] != 0.0:
        force += p[P.TONE_FORCE] * math.sin(2.0 * math.pi * p[P.TONE_FREQUENCY] * t + p[P.TONE_PHASE])
    if p[P.LEARNED_BALANCE] == learned.FORCE:
        force += learned.term(p, y, v, volts, P1, Ps, t, memory)
    return force


@compiled
def leg_force(p, y, v, volts, P1, P2, Ps, z, t, memory=0.0):
    """Force of the leg on the load [N]: the pressure of the bottom chamber and all that acts besides."""
    return P1 * p[P.AREA_BOTTOM] + force_beyond_pressure(p, y, v, volts, P1, P2, Ps, z, t, memory)


@compiled
def leg_derivatives(p, y, v, volts, t, Ps, state, h, memory=0.0):
    """Rates of a leg's states, its metering spool position [m] and its net flow [m3/s].

    state: (s1, s2, x, x', z), chambers [Pa], spool [m] and [m/s], bristle [m]; the rates come in the same order, 0 for
    a state that the leg has not. h [s]: time step of who integrates; laws faster than it are slowed to it (pressures to
    h lambda = 1, the bristle to 2), towards the same balance. h = 0: exact. memory: of a learned
    term, whose own rate is `learned.memory_rate`.
    """
    s1, s2, place, speed, z = state
    P1, P2 = chamber.pressure(s1), chamber.pressure(s2)
    x = metering_spool(p, volts, t, place)
    flow = inflow_bottom(p, y, v, volts, x, P1, P2, Ps, t, memory)
    room, slower = chamber_capacity(p, y, P1), pressure_slowdown(p, y, x, P1, Ps, h)
    net = chamber.slowed(flow - p[P.AREA_BOTTOM] * v, s1, room, slower, h)
    ds1 = bottom_rate(p, y, v, s1, net, room)
    ds2 = dx = acceleration = dz = 0.0
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        ds2 = rod_side.valve_rate(p, y, v, x, P1, s2, Ps, h)
    elif p[P.ROD_SIDE_CHAMBER] > 0.0:
        ds2 = rod_side.port_rate(p, y, v, P1, s2, Ps, h)
    if p[P.SPOOL_OMEGA] > 0.0:
        command = commanded_spool(p, volts, t)
        dx, acceleration = valve.spool_rates(
            place, speed, command, p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING], p[P.SPOOL_RATE]
        )
    if p[P.BRISTLE_STIFFNESS] > 0.0:
        stiff = p[P.BRISTLE_STIFFNESS] * abs(v) / friction_level(p, y, v, P1, P2, t)
        dz = bristle_rate(p, y, v, P1, z, P2, t) / max(1.0, 0.5 * h * stiff)
    return (ds1, ds2, dx, acceleration, dz), x, flow


@allocating
def valve_volts(volts, hysteresis, delay_samples, spread=0.0):
    """What reaches the spool after delay and hysteresis, sample by sample: (n,) -> (n,). Starts at rest at volts[0].

    hysteresis, spread [V]: half width, and what the threshold's is less. A delay of a broken number of samples takes a share of both.
    """
    n = volts.shape[0]
    out = np.empty(n)
    held, apart = volts[0], 0.0
    for i in range(n):
        place = max(i - delay_samples, 0.0)
        k = int(place)
        share = place - k
        late = volts[k] if share == 0.0 else (1.0 - share) * volts[k] + share * volts[k + 1]
        held, apart = valve.hysteresis(late, held, apart, hysteresis, spread)
        out[i] = held
    return out
