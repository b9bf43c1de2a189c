"""Legs under their load in closed loop, compiled: the simulation that fits ask for thousands of times.

The balances of the plant (`hexsim.hydraulics.leg`) for each leg; the load by Newton and Euler (`mechanics.rigid_body`): a
mass on the axis of one leg, or a platform on six,

    wrench = sum f_i (u_i, r_i x u_i),   u_i, r_i: direction of a leg and its joint from the origin
    u_k = K (s_k - y_m)  every 1/rate seconds, held; then delay and play of the valve

RK4, in short steps where a piston reverses and friction is stiff, in COARSE steps a sample elsewhere. Laws whose time
constant is shorter than the step (supply line, bristle) are slowed to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hexsim.compiled import compiled
from hexsim.hydraulics import leg, supply, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.supply import S
from hexsim.mechanics.leg_geometry import write_legs
from hexsim.mechanics.rigid_body import (
    axial_acceleration,
    spring_acceleration,
    write_body_acceleration,
    write_centre_acceleration,
    write_quaternion_rate,
    write_rotation_of,
)

# states: supply pressure, payload on its spring; then those of each leg; then those of the load
SUPPLY, TRAVEL, TRAVEL_RATE, LEGS = range(4)
LEG_P1, LEG_P2, LEG_X, LEG_XD, LEG_Z, LEG_STATES = range(6)
POSITION, SPEED, N_AXIS = range(3)  # of a mass on an axis
PLACE, QUATERNION, VELOCITY, OMEGA, N_PLATFORM = 0, 3, 7, 10, 13  # of a platform: origin in the world, rates in its frame

COARSE_S = 5.0e-4  # [s] longest step away from reversals; error with it: 0.02 of the noise of accelerations, 0.003 of pressures
FOLLOW = 0.3  # of the gain: with all of it the noise of the logged position rings the oil, with less rounded volts let it drift
STIFF_SPEEDS = 5.0  # friction is stiff below so many times its sharpness (tanh: 1 - 1e-4)
DIVERGENCE_LIMIT = 1e3  # [m], [m/s], [rad/s] a load beyond it has diverged


class Inputs(NamedTuple):
    """What drives the simulation: (n_legs, n) setpoints, logged volts and positions; (n,) supply pressure, or (0,) if simulated.

    near_rest (n,): where any leg is near standstill by its measured position, see `steps_here`. rate_Hz: of the log.
    """

    setpoint: np.ndarray
    volts: np.ndarray
    position: np.ndarray
    supply: np.ndarray
    near_rest: np.ndarray
    rate_Hz: float


class Room(NamedTuple):
    """Arrays that the simulation works in: motion of the legs, rotation and Jacobian, forces, accelerations, four slopes."""

    y: np.ndarray
    v: np.ndarray
    held: np.ndarray
    rotation: np.ndarray
    jacobian: np.ndarray
    lengths: np.ndarray
    wrench: np.ndarray
    omega: np.ndarray
    gravity: np.ndarray
    spare: np.ndarray
    acceleration: np.ndarray
    slopes: np.ndarray
    trial: np.ndarray


@compiled
def room_for(n_legs, n_states):
    """Room for a machine; a bench's Jacobian is 1."""
    return Room(
        np.empty(n_legs), np.empty(n_legs), np.zeros(n_legs), np.empty((3, 3)), np.ones((n_legs, 6)), np.empty(6),
        np.empty(6), np.empty(6), np.empty(3), np.empty(6), np.empty(6), np.zeros((4, n_states)), np.empty(n_states),
    )  # fmt: skip


@compiled
def leg_motion(load, state, at, room):
    """Positions and velocities of the pistons, and the legs' Jacobian, from the load's states at place `at`."""
    y, v, jacobian, rotation, omega = room.y, room.v, room.jacobian, room.rotation, room.omega
    if y.shape[0] == 1:
        y[0], v[0] = state[at + POSITION], state[at + SPEED]
        return
    write_rotation_of(state[at + QUATERNION : at + VELOCITY], rotation)
    write_legs(state[at:], rotation, load.base, load.joints, 0.0, room.lengths, jacobian)
    w0, w1, w2 = state[at + OMEGA], state[at + OMEGA + 1], state[at + OMEGA + 2]
    for k in range(3):  # velocity of the origin and turning, both in the world
        omega[k] = state[at + VELOCITY + k]
        omega[3 + k] = rotation[k, 0] * w0 + rotation[k, 1] * w1 + rotation[k, 2] * w2
    for i in range(y.shape[0]):
        y[i] = room.lengths[i] - load.retracted[i]
        v[i] = 0.0
        for k in range(6):
            v[i] += jacobian[i, k] * omega[k]


@compiled
def leg_rates(p, y, v, volts, t, ps, state, k, h, rate):
    """Write the rates of a leg's states from place k on; return its force on the load [N] and the spool used [m]."""
    p1, z = state[k + LEG_P1], state[k + LEG_Z]
    used = leg.commanded_spool(p, volts, t)
    if p[P.SPOOL_OMEGA] > 0.0:
        rate[k + LEG_X], rate[k + LEG_XD] = valve.spool_rates(
            state[k + LEG_X], state[k + LEG_XD], used, p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING], p[P.SPOOL_RATE]
        )
        used = min(max(state[k + LEG_X], -p[P.SPOOL_TRAVEL]), p[P.SPOOL_TRAVEL])
    rate[k + LEG_P1] = leg.pressure_rate(p, y, v, volts, used, p1, ps, t)
    if p[P.BRISTLE_STIFFNESS] > 0.0:
        stiff = p[P.BRISTLE_STIFFNESS] * abs(v) / max(leg.friction_level(p, y, v, p1), 1e-9)
        rate[k + LEG_Z] = leg.bristle_rate(p, y, v, p1, z) / (1.0 + h * stiff)
    return p1 * p[P.AREA_BOTTOM] + leg.force_beyond_pressure(p, y, v, volts, p1, ps, ps, z, t), used


@compiled
def supply_rate(s, ps, demand, h):
    """dPs/dt [Pa/s]; a line faster than the step is slowed to it."""
    capacity = max(supply.line_capacity(s, ps), 2.0 * h / s[S.RESISTANCE])
    return supply.line_rate(s, ps, demand, s[S.PRESSURE], capacity)


@compiled
def load_rates(load, state, at, room, rate):
    """Write the rates of load and payload under the wrench of the legs (world) into `rate`, accelerations into `room`."""
    body, spring, acceleration, rotation = load.body, load.suspension, room.acceleration, room.rotation
    pull = spring_acceleration(spring, state[TRAVEL], state[TRAVEL_RATE]) if spring.mass > 0.0 else 0.0
    if room.y.shape[0] == 1:
        acceleration[0] = axial_acceleration(body, room.wrench[0], load.gravity[2], -spring.mass * pull)
        rate[at + POSITION], rate[at + SPEED] = state[at + SPEED], acceleration[0]
        felt = acceleration[0] - load.gravity[2]
    else:
        wrench, gravity, omega = room.spare, room.gravity, state[at + OMEGA : at + N_PLATFORM]
        for k in range(3):
            r0, r1, r2 = rotation[0, k], rotation[1, k], rotation[2, k]
            wrench[k] = r0 * room.wrench[0] + r1 * room.wrench[1] + r2 * room.wrench[2]
            wrench[3 + k] = r0 * room.wrench[3] + r1 * room.wrench[4] + r2 * room.wrench[5]
            gravity[k] = r0 * load.gravity[0] + r1 * load.gravity[1] + r2 * load.gravity[2]
        rest = room.omega
        write_body_acceleration(
            body, load.compliance, wrench, omega, gravity, -spring.mass * pull, rest, acceleration
        )
        write_quaternion_rate(state[at + QUATERNION : at + VELOCITY], omega, rate[at + QUATERNION : at + VELOCITY])
        for k in range(3):
            a0, a1, a2 = acceleration[0], acceleration[1], acceleration[2]
            rate[at + PLACE + k] = state[at + VELOCITY + k]
            rate[at + VELOCITY + k] = rotation[k, 0] * a0 + rotation[k, 1] * a1 + rotation[k, 2] * a2
            rate[at + OMEGA + k] = acceleration[3 + k]
        felt = 0.0
        if spring.mass > 0.0:
            write_centre_acceleration(body.centre, acceleration, omega, rest)
            felt = rest[2] - gravity[2]
    if spring.mass > 0.0:
        rate[TRAVEL], rate[TRAVEL_RATE] = state[TRAVEL_RATE], -pull - felt


@compiled
def rates(rig, room, t, h, state, rate):
    """Write d state/dt at time t into `rate`; h: step, for stiff laws. Motion and accelerations stay in `room`."""
    s, n_legs = rig.supply, rig.legs.shape[0]
    at = LEGS + n_legs * LEG_STATES
    leg_motion(rig.load, state, at, room)
    wrench, jacobian, ps = room.wrench, room.jacobian, state[SUPPLY]
    wrench[:] = 0.0
    demand = 0.0
    columns = 1 if n_legs == 1 else 6
    for i in range(n_legs):
        p, k = rig.legs[i], LEGS + i * LEG_STATES
        force, x = leg_rates(p, room.y[i], room.v[i], room.held[i], t, ps, state, k, h, rate)
        if s[S.MODEL] == supply.LINE:
            demand += leg.supply_demand(p, room.v[i], x, state[k + LEG_P1], ps, ps)
        for j in range(columns):
            wrench[j] += force * jacobian[i, j]
    if s[S.MODEL] == supply.LINE:
        rate[SUPPLY] = supply_rate(s, ps, demand, h)
    load_rates(rig.load, state, at, room, rate)


@compiled
def integrate(rig, room, t, dt, steps, state):
    """RK4 over one sample, in place; the first slope of the first step stands in `room.slopes[0]` already."""
    h, slopes, trial = dt / steps, room.slopes, room.trial
    for j in range(steps):
        tau = t + j * h
        if j > 0:
            rates(rig, room, tau, h, state, slopes[0])
        for stage in range(1, 4):
            reach = h if stage == 3 else 0.5 * h
            for q in range(state.shape[0]):
                trial[q] = state[q] + reach * slopes[stage - 1, q]
            rates(rig, room, tau + reach, h, trial, slopes[stage])
        for q in range(state.shape[0]):
            state[q] += h / 6.0 * (slopes[0, q] + 2.0 * slopes[1, q] + 2.0 * slopes[2, q] + slopes[3, q])


@compiled
def delayed(history, i, delay):
    """history at sample i - delay (delay in samples, fractional)."""
    place = i - delay
    if place <= 0.0:
        return history[0]
    k = int(place)
    share = place - k
    if share == 0.0 or k + 1 > i:
        return history[k]
    return (1.0 - share) * history[k] + share * history[k + 1]


@compiled
def steps_here(p, speed, dt, substeps, near_rest):
    """Steps of the sample that begins at this speed: all of them near standstill.

    near_rest is measured, so that variants of a model step alike and their differences are smooth; a model that stands
    still where the machine moved is seen by its own speed.
    """
    slow = abs(speed) < STIFF_SPEEDS * p[P.SHARPNESS]
    stiff = p[P.BRISTLE_STIFFNESS] > 0.0 or p[P.SPOOL_OMEGA] * COARSE_S > 0.7
    return substeps if near_rest or slow or stiff else min(math.ceil(dt / COARSE_S - 1e-9), substeps)


@compiled
def shown(history, i, gain, offset, delay):
    """What a sensor shows at sample i."""
    return gain * delayed(history, i, delay) + offset


@compiled
def asked_volts(controller, inputs, j, i, position):
    """Volts of leg j's loop at sample i for the position that its sensor shows."""
    if controller.follows:
        volts = inputs.volts[j, i] + FOLLOW * controller.gain_V_per_m * (inputs.position[j, i] - position)
    else:
        volts = controller.gain_V_per_m * (inputs.setpoint[j, i] - position)
    return min(max(volts, -controller.limit_V), controller.limit_V)


@compiled
def run(rig, inputs, start, substeps, out):
    """Simulate and write the measured outputs, without noise, into out (rows of `outputs`, n). False after a divergence."""
    n_legs, n, rate = rig.legs.shape[0], inputs.setpoint.shape[1], inputs.rate_Hz
    axes = rig.sensors.acceleration_gain.shape[0]
    dt, state, room = 1.0 / rate, start.copy(), room_for(n_legs, start.shape[0])
    y_true, p_true, u_true, a_true = np.empty((n_legs, n)), np.empty((n_legs, n)), np.empty((n_legs, n)), np.empty((axes, n))
    every = max(round(rate / rig.controller.rate_Hz), 1)
    at, s = LEGS + n_legs * LEG_STATES, rig.sensors
    for i in range(n):
        t = i * dt
        if inputs.supply.shape[0] == n:
            state[SUPPLY] = inputs.supply[i]
        leg_motion(rig.load, state, at, room)
        for j in range(n_legs):
            y_true[j, i], p_true[j, i] = room.y[j], state[LEGS + j * LEG_STATES + LEG_P1]
            y = shown(y_true[j], i, s.position_gain[j], s.position_offset[j], s.position_delay[j] * rate)
            u_true[j, i] = asked_volts(rig.controller, inputs, j, i, y) if i % every == 0 else u_true[j, i - 1]
            late = delayed(u_true[j], i, rig.legs[j, P.VALVE_DELAY] * rate)
            room.held[j] = valve.play(late, room.held[j], rig.legs[j, P.HYSTERESIS])
            out[j, i], out[n_legs + j, i] = y, u_true[j, i]
            out[2 * n_legs + j, i] = shown(
                p_true[j], i, s.pressure_gain[j], s.pressure_offset[j], s.pressure_delay[j] * rate
            )
        rates(rig, room, t, dt / substeps, state, room.slopes[0])
        out[3 * n_legs, i] = s.supply_gain * state[SUPPLY]
        for a in range(axes):
            a_true[a, i] = room.acceleration[a]
            out[3 * n_legs + 1 + a, i] = shown(
                a_true[a], i, s.acceleration_gain[a], s.acceleration_offset[a], s.acceleration_delay * rate
            )
        steps = 1
        for j in range(n_legs):
            steps = max(steps, steps_here(rig.legs[j], room.v[j], dt, substeps, inputs.near_rest[i]))
        integrate(rig, room, t, dt, steps, state)
        for k in range(at, state.shape[0]):
            if not abs(state[k]) < DIVERGENCE_LIMIT:
                out[:, i + 1 :] = math.nan
                return False
    return True


@compiled
def carrying_pressure(p, y, v, ps, thrust):
    """Pressure [Pa] of the bottom chamber that gives the thrust [N] in steady motion: friction may depend on it."""
    p1 = 0.5 * ps
    for _ in range(20):
        p1 = (thrust - leg.force_beyond_pressure(p, y, v, 0.0, p1, ps, ps, 0.0, 0.0)) / p[P.AREA_BOTTOM]
    return p1
