"""Rates of legs and load, compiled, and a step of RK4.

The balances of the plant (`hexsim.hydraulics.leg`) for each leg; the load by Newton and Euler (`mechanics.rigid_body`): a
mass on the axis of one leg, or a platform on six,

    wrench = sum f_i (u_i, r_i x u_i),   u_i, r_i: direction of a leg and its joint from the origin

The time step is the plant's (`hydraulics.steps`), chosen at every sample of the log. The oil of a power unit keeps its
temperature: a log of a minute warms it by tenths of a degree.
"""

from __future__ import annotations

from itertools import accumulate

from hexsim.compiled import compiled
from hexsim.hydraulics import chamber, learned, leg, supply
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.steps import count_steps_by_rule, leg_steps, power_unit_steps
from hexsim.hydraulics.supply import S
from hexsim.mechanics.leg_geometry import leg_line
from hexsim.mechanics.rigid_body import (
    axial_acceleration,
    body_acceleration,
    dot,
    quaternion_rate,
    ride_wrench,
    rotated,
    rotated_back,
    rotation_of,
    spring_acceleration,
    triple,
)

# states: supply, payload on its spring, power unit; then those of each leg; then those of the load. Volumes of oil as in `chamber`
SUPPLY, TRAVEL, TRAVEL_RATE, MOTOR, PUMP_FLOW, LINE_FLOW, PUMP_PRESSURE, LEGS = range(8)
LEG_P1, LEG_P2, LEG_X, LEG_XD, LEG_Z, LEG_MEMORY, LEG_STATES = range(7)
POSITION, SPEED, N_AXIS = range(3)  # of a mass on an axis
PLACE, QUATERNION, VELOCITY, OMEGA, N_PLATFORM = accumulate(
    (0, 3, 4, 3, 3)
)  # of a platform: origin in the world, rates in its frame


@compiled
def platform_pose(state, at):
    """A platform's place, rotation, and its twist (v, w) in the world, from the states at place `at`."""
    rotation = rotation_of((state[at + 3], state[at + 4], state[at + 5], state[at + 6]))
    omega = rotated(rotation, triple(state, at + OMEGA))
    return triple(state, at + PLACE), rotation, triple(state, at + VELOCITY), omega


@compiled
def leg_on_platform(pose, geometry, i):
    """Position and velocity of piston i, direction and moment of its line in the world. geometry: see `rig.Rig`."""
    place, rotation, velocity, omega = pose
    base = (geometry[i, 0], geometry[i, 1], geometry[i, 2])
    joint = (geometry[i, 3], geometry[i, 4], geometry[i, 5])
    length, line, moment = leg_line(place, rotation, base, joint)
    return length - geometry[i, 6], dot(line, velocity) + dot(moment, omega), line, moment


@compiled
def write_leg_motion(geometry, state, y, v):
    """Positions and velocities of the pistons (n_legs,)."""
    at = LEGS + y.shape[0] * LEG_STATES
    if y.shape[0] == 1:
        y[0], v[0] = state[at + POSITION], state[at + SPEED]
        return
    pose = platform_pose(state, at)
    for i in range(y.shape[0]):
        y[i], v[i] = leg_on_platform(pose, geometry, i)[:2]


@compiled
def leg_rates(p, y, v, volts, t, ps, state, k, h, rate):
    """Write the rates of a leg's states from place k on; return its force [N], spool [m] and bottom pressure [Pa]."""
    own = (state[k + LEG_P1], state[k + LEG_P2], state[k + LEG_X], state[k + LEG_XD], state[k + LEG_Z])
    memory = state[k + LEG_MEMORY]
    P1, p2 = chamber.pressure(own[0]), rod_side_pressure(p, state, k)
    slopes, x, _ = leg.leg_derivatives(p, y, v, volts, t, ps, own, h, memory)
    for q in range(LEG_MEMORY):
        rate[k + q] = slopes[q]
    rate[k + LEG_MEMORY] = learned.memory_rate(p, y, v, volts, P1, ps, t, memory)
    return leg.leg_force(p, y, v, volts, P1, p2, ps, own[4], t, memory), x, P1


@compiled
def write_platform_rates(load, state, at, rotation, wrench, rate):
    """Rates of a platform under the wrench of its legs (world).

    Returns (a, w') in its frame, and what its payload on a spring feels along it, 0 without one. Of that the moments of
    what accelerates it are those of its place at rest: its travel times its acceleration is left out.
    """
    body, spring, q = load.body, load.spring, (state[at + 3], state[at + 4], state[at + 5], state[at + 6])
    omega, gravity = triple(state, at + OMEGA), rotated_back(rotation, load.gravity)
    (fx, fy, fz), (mx, my, mz) = rotated_back(rotation, wrench[0]), rotated_back(rotation, wrench[1])
    none, travel, speed = (0.0, 0.0, 0.0), state[TRAVEL], state[TRAVEL_RATE]
    if spring.mass > 0.0:
        F, M, _ = ride_wrench(spring, none, none, omega, gravity, travel, speed)
        fx, fy, fz, mx, my, mz = fx - F[0], fy - F[1], fz - F[2], mx - M[0], my - M[1], mz - M[2]
    a, turning = body_acceleration(body, load.compliance, (fx, fy, fz), (mx, my, mz), omega, gravity)
    in_world, turn = rotated(rotation, a), quaternion_rate(q, omega)
    for k in range(4):
        rate[at + QUATERNION + k] = turn[k]
    for k in range(3):
        rate[at + PLACE + k] = state[at + VELOCITY + k]
        rate[at + VELOCITY + k] = in_world[k]
        rate[at + OMEGA + k] = turning[k]
    felt = ride_wrench(spring, a, turning, omega, gravity, travel, speed)[2] if spring.mass > 0.0 else 0.0
    return a, turning, felt


@compiled
def rod_side_pressure(p, state, k):
    """P2 [Pa] of the leg whose states begin at place k."""
    return chamber.pressure(state[k + LEG_P2] if p[P.ROD_SIDE_CHAMBER] > 0.0 else state[SUPPLY])


@compiled
def rod_side_state(p, state, k):
    """s2 [Pa] of the leg whose states begin at place k; Ps where its rod side is no chamber."""
    return state[k + LEG_P2] if p[P.ROD_SIDE_CHAMBER] > 0.0 else chamber.pressure(state[SUPPLY])


@compiled
def write_supply_rates(s, state, demand, h, rate):
    """Write the rates of a supply that has states, for the flow that all legs take [m3/s]. The motor is on."""
    if s[S.MODEL] == supply.LINE:
        rate[SUPPLY] = supply.line_rate(s, state[SUPPLY], demand, s[S.PRESSURE], h)
    elif s[S.MODEL] == supply.POWER_UNIT:
        oil = s[S.START_TEMPERATURE]
        unit = (state[MOTOR], state[PUMP_FLOW], state[LINE_FLOW], state[PUMP_PRESSURE], oil, state[SUPPLY])
        of_unit = supply.power_unit_rates(s, unit, 1.0, demand, 0.0)
        rate[MOTOR], rate[PUMP_FLOW], rate[LINE_FLOW] = of_unit[0], of_unit[1], of_unit[2]
        rate[PUMP_PRESSURE], rate[SUPPLY] = of_unit[3], of_unit[5]


@compiled
def rates(legs, geometry, s, load, held, t, h, state, rate):
    """Write d state/dt at time t into `rate`; return (a, w') of the load. held: volts at the valves; h: step, for stiff laws."""
    n_legs, ps, spring = legs.shape[0], chamber.pressure(state[SUPPLY]), load.spring
    at = LEGS + n_legs * LEG_STATES
    alone = n_legs == 1
    none = (0.0, 0.0, 0.0)
    pose = (none, (none, none, none), none, none) if alone else platform_pose(state, at)
    f0 = f1 = f2 = m0 = m1 = m2 = demand = 0.0
    for i in range(n_legs):
        y, v, line, moment = state[at + POSITION], state[at + SPEED], (0.0, 0.0, 1.0), none
        if not alone:
            y, v, line, moment = leg_on_platform(pose, geometry, i)
        p, k = legs[i], LEGS + i * LEG_STATES
        force, x, P1 = leg_rates(p, y, v, held[i], t, ps, state, k, h, rate)
        if s[S.MODEL] != supply.CONSTANT:
            demand += leg.supply_demand_in_step(p, y, v, x, P1, rod_side_state(p, state, k), ps, h)
        f0, f1, f2 = f0 + force * line[0], f1 + force * line[1], f2 + force * line[2]
        m0, m1, m2 = m0 + force * moment[0], m1 + force * moment[1], m2 + force * moment[2]
    write_supply_rates(s, state, demand, h, rate)
    pull = spring_acceleration(spring, state[TRAVEL], state[TRAVEL_RATE])
    if alone:
        a, turning = (0.0, 0.0, axial_acceleration(load.body, f2, load.gravity[2], -spring.mass * pull)), none
        rate[at + POSITION], rate[at + SPEED], felt = state[at + SPEED], a[2], a[2] - load.gravity[2]
    else:
        a, turning, felt = write_platform_rates(load, state, at, pose[1], ((f0, f1, f2), (m0, m1, m2)), rate)
    if spring.mass > 0.0:
        rate[TRAVEL], rate[TRAVEL_RATE] = state[TRAVEL_RATE], -pull - felt
    return a, turning


@compiled
def moved(state, h, slope, there):
    """there = state + h slope."""
    for q in range(state.shape[0]):
        there[q] = state[q] + h * slope[q]


@compiled
def integrate(legs, geometry, s, load, held, t, dt, steps, state, slopes):
    """RK4 over one sample, in place; the first slope of the first step stands in slopes[0] already."""
    h = dt / steps
    k1, k2, k3, k4, there = slopes
    for j in range(steps):
        tau = t + j * h
        if j > 0:
            rates(legs, geometry, s, load, held, tau, h, state, k1)
        moved(state, 0.5 * h, k1, there)
        rates(legs, geometry, s, load, held, tau + 0.5 * h, h, there, k2)
        moved(state, 0.5 * h, k2, there)
        rates(legs, geometry, s, load, held, tau + 0.5 * h, h, there, k3)
        moved(state, h, k3, there)
        rates(legs, geometry, s, load, held, tau + h, h, there, k4)
        for q in range(state.shape[0]):
            state[q] += h / 6.0 * (k1[q] + 2.0 * k2[q] + 2.0 * k3[q] + k4[q])


@compiled
def steps_of_sample(legs, s, rule, state, y, v, held, t, calm_s, dt):
    """Time steps of the sample that begins with this state, calm_s after a leg was last near standstill."""
    ps = chamber.pressure(state[SUPPLY])
    asked = power_unit_steps(s, state[PUMP_PRESSURE]) if s[S.MODEL] == supply.POWER_UNIT else 0.0
    for j in range(y.shape[0]):
        k = LEGS + j * LEG_STATES
        x = leg.metering_spool(legs[j], held[j], t, state[k + LEG_X])
        P1, p2 = chamber.pressure(state[k + LEG_P1]), rod_side_pressure(legs[j], state, k)
        steps = leg_steps(rule, legs[j], y[j], v[j], x, P1, p2, ps, state[k + LEG_Z])
        asked = max(asked, steps)
    return count_steps_by_rule(rule, asked, calm_s, dt)


@compiled
def carrying_pressure(p, y, v, p2, ps, thrust):
    """Pressure [Pa] of the bottom chamber that gives the thrust [N] in steady motion: friction may depend on it."""
    p1 = 0.5 * ps
    for _ in range(20):
        memory = learned.signal_of(p, y, v, 0.0, p1, ps, 0.0)
        p1 = (thrust - leg.force_beyond_pressure(p, y, v, 0.0, p1, p2, ps, 0.0, 0.0, memory)) / p[P.AREA_BOTTOM]
    return p1
