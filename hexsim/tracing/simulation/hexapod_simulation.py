"""Six legs under a rigid platform in closed loop, compiled: what fits of a hexapod ask for hundreds of times.

Same leg equations as everywhere (`leg_simulation.leg_terms`); the platform by Newton and Euler about its centre:

    m p_c'' = sum f_i u_i + W,   I w' + w x I w = sum (r_i - c) x f_i u_i,   r_i, c in the platform frame
    a_O = p_c'' - w' x c - w x (w x c)        acceleration of the origin, which the accelerometers see

A payload on a spring along the platform's z axis adds a mass that moves with the platform across that axis.
Fixed-step RK4.
"""

from __future__ import annotations

import math

import numpy as np

from hexsim.compiled import compiled
from hexsim.hydraulics import leg, supply, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.supply import S
from hexsim.tracing.simulation.leg_simulation import (
    A_DELAY,
    A_GAIN,
    A_OFFSET,
    FEEDBACK,
    FOLLOW,
    GAIN,
    P_DELAY,
    P_GAIN,
    P_OFFSET,
    PS_GAIN,
    PS_OFFSET,
    RATE,
    VOLTS_MAX,
    Y_DELAY,
    Y_GAIN,
    Y_OFFSET,
    delayed,
    leg_terms,
    steps_here,
    supply_rate,
)

# a leg's states, six times; then the platform's
LEG_P1, LEG_X, LEG_XD, LEG_Z, LEG_STATES = range(5)
PLACE = 6 * LEG_STATES  # position of the origin (3), quaternion (4), velocity of the origin (3), rates in the frame (3)
QUATERNION, VELOCITY, OMEGA, SUPPLY, TRAVEL, TRAVEL_RATE = (
    PLACE + 3,
    PLACE + 7,
    PLACE + 10,
    PLACE + 13,
    PLACE + 14,
    PLACE + 15,
)
N_STATES = PLACE + 16
# places in the load's row: mass, weight force in the world (3), centre of mass (3), inertia about it (9), payload
MASS, WEIGHT, CENTRE, INERTIA, PAYLOAD_MASS, PAYLOAD_OMEGA, PAYLOAD_DAMPING, N_LOAD = 0, 1, 4, 7, 16, 17, 18, 19
N_OUTPUTS = (
    6 + 6 + 6 + 1 + 3 + 3 + 6
)  # position, volts, pressure, supply, acceleration, angular, velocity of the pistons


@compiled
def rotation_of(q, R):
    """Rotation matrix of a quaternion (w, x, y, z), normalised."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w, x, y, z = q[0] / n, q[1] / n, q[2] / n, q[3] / n
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled
def leg_motion(state, R, base, joints, retracted, y, v, direction):
    """Piston position and velocity of each leg, and its direction in the platform frame (6, 3)."""
    w0, w1, w2 = state[OMEGA], state[OMEGA + 1], state[OMEGA + 2]
    for i in range(6):
        b0, b1, b2 = joints[i, 0], joints[i, 1], joints[i, 2]
        s0 = state[PLACE] - base[i, 0] + R[0, 0] * b0 + R[0, 1] * b1 + R[0, 2] * b2
        s1 = state[PLACE + 1] - base[i, 1] + R[1, 0] * b0 + R[1, 1] * b1 + R[1, 2] * b2
        s2 = state[PLACE + 2] - base[i, 2] + R[2, 0] * b0 + R[2, 1] * b1 + R[2, 2] * b2
        length = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
        s0, s1, s2 = s0 / length, s1 / length, s2 / length
        d0 = R[0, 0] * s0 + R[1, 0] * s1 + R[2, 0] * s2
        d1 = R[0, 1] * s0 + R[1, 1] * s1 + R[2, 1] * s2
        d2 = R[0, 2] * s0 + R[1, 2] * s1 + R[2, 2] * s2
        direction[i, 0], direction[i, 1], direction[i, 2] = d0, d1, d2
        y[i] = length - retracted[i]
        v[i] = (
            s0 * state[VELOCITY] + s1 * state[VELOCITY + 1] + s2 * state[VELOCITY + 2]
            + d0 * (w1 * b2 - w2 * b1) + d1 * (w2 * b0 - w0 * b2) + d2 * (w0 * b1 - w1 * b0)
        )  # fmt: skip


@compiled
def platform_rates(m, inverse, state, R, wrench, rate, acceleration):
    """Rates of the platform from the wrench (6,) of the legs (platform frame, about the origin); writes accelerations.

    acceleration (6,): of the origin, and angular, both in the platform frame.
    """
    w0, w1, w2 = state[OMEGA], state[OMEGA + 1], state[OMEGA + 2]
    c0, c1, c2 = m[CENTRE], m[CENTRE + 1], m[CENTRE + 2]
    f0, f1, f2 = wrench[0], wrench[1], wrench[2]
    h0 = m[INERTIA] * w0 + m[INERTIA + 1] * w1 + m[INERTIA + 2] * w2
    h1 = m[INERTIA + 3] * w0 + m[INERTIA + 4] * w1 + m[INERTIA + 5] * w2
    h2 = m[INERTIA + 6] * w0 + m[INERTIA + 7] * w1 + m[INERTIA + 8] * w2
    t0 = wrench[3] - (c1 * f2 - c2 * f1) - (w1 * h2 - w2 * h1)
    t1 = wrench[4] - (c2 * f0 - c0 * f2) - (w2 * h0 - w0 * h2)
    t2 = wrench[5] - (c0 * f1 - c1 * f0) - (w0 * h1 - w1 * h0)
    a0 = inverse[0, 0] * t0 + inverse[0, 1] * t1 + inverse[0, 2] * t2
    a1 = inverse[1, 0] * t0 + inverse[1, 1] * t1 + inverse[1, 2] * t2
    a2 = inverse[2, 0] * t0 + inverse[2, 1] * t1 + inverse[2, 2] * t2
    across = m[MASS] + m[PAYLOAD_MASS]  # across its axis a payload on a spring moves along
    ratio = across / m[MASS]
    g0, g1, g2 = m[WEIGHT], m[WEIGHT + 1], m[WEIGHT + 2]
    f0 += (R[0, 0] * g0 + R[1, 0] * g1 + R[2, 0] * g2) * ratio
    f1 += (R[0, 1] * g0 + R[1, 1] * g1 + R[2, 1] * g2) * ratio
    f2 += R[0, 2] * g0 + R[1, 2] * g1 + R[2, 2] * g2
    v0, v1, v2 = w1 * c2 - w2 * c1, w2 * c0 - w0 * c2, w0 * c1 - w1 * c0
    acceleration[0] = f0 / across - (a1 * c2 - a2 * c1) - (w1 * v2 - w2 * v1)
    acceleration[1] = f1 / across - (a2 * c0 - a0 * c2) - (w2 * v0 - w0 * v2)
    acceleration[2] = f2 / m[MASS] - (a0 * c1 - a1 * c0) - (w0 * v1 - w1 * v0)
    acceleration[3], acceleration[4], acceleration[5] = a0, a1, a2
    q0, q1, q2, q3 = state[QUATERNION], state[QUATERNION + 1], state[QUATERNION + 2], state[QUATERNION + 3]
    rate[QUATERNION] = 0.5 * (-q1 * w0 - q2 * w1 - q3 * w2)
    rate[QUATERNION + 1] = 0.5 * (q0 * w0 + q2 * w2 - q3 * w1)
    rate[QUATERNION + 2] = 0.5 * (q0 * w1 - q1 * w2 + q3 * w0)
    rate[QUATERNION + 3] = 0.5 * (q0 * w2 + q1 * w1 - q2 * w0)
    for a in range(3):
        rate[PLACE + a] = state[VELOCITY + a]
        rate[OMEGA + a] = acceleration[3 + a]
        rate[VELOCITY + a] = R[a, 0] * acceleration[0] + R[a, 1] * acceleration[1] + R[a, 2] * acceleration[2]


@compiled
def along_axis_of_centre(m, state, acceleration):
    """Acceleration [m/s2] of the centre of mass along the platform's z axis: a + w' x c + w x (w x c)."""
    w0, w1, w2 = state[OMEGA], state[OMEGA + 1], state[OMEGA + 2]
    c0, c1, c2 = m[CENTRE], m[CENTRE + 1], m[CENTRE + 2]
    turn = acceleration[3] * c1 - acceleration[4] * c0
    return acceleration[2] + turn + w0 * (w2 * c0 - w0 * c2) - w1 * (w1 * c2 - w2 * c1)


@compiled
def rates(fixed, volts, t, h, state, rate, y, v, acceleration):
    """Write d state/dt into `rate`, piston positions and velocities into y, v, accelerations into acceleration (6,).

    fixed: the machine's numbers, and R (3, 3), direction (6, 3) and wrench (6,) as room to work in.
    """
    p, s, m, inverse, base, joints, retracted, R, direction, wrench = fixed
    rotation_of(state[QUATERNION : QUATERNION + 4], R)
    leg_motion(state, R, base, joints, retracted, y, v, direction)
    wrench[:] = 0.0
    demand = 0.0
    for i in range(6):
        k = i * LEG_STATES
        thrust, x, dp, dx, dxd, dz = leg_terms(
            p[i], y[i], v[i], volts[i], t, h, state[k + LEG_P1], state[SUPPLY],
            state[k + LEG_X], state[k + LEG_XD], state[k + LEG_Z],
        )  # fmt: skip
        rate[k + LEG_P1], rate[k + LEG_X], rate[k + LEG_XD], rate[k + LEG_Z] = dp, dx, dxd, dz
        if s[S.MODEL] == supply.LINE:
            demand += leg.supply_demand(p[i], v[i], x, state[k + LEG_P1], state[SUPPLY], state[SUPPLY])
        f0, f1, f2 = thrust * direction[i, 0], thrust * direction[i, 1], thrust * direction[i, 2]
        wrench[0] += f0
        wrench[1] += f1
        wrench[2] += f2
        wrench[3] += joints[i, 1] * f2 - joints[i, 2] * f1
        wrench[4] += joints[i, 2] * f0 - joints[i, 0] * f2
        wrench[5] += joints[i, 0] * f1 - joints[i, 1] * f0
    rate[SUPPLY] = supply_rate(s, state[SUPPLY], demand, h)
    rate[TRAVEL] = 0.0
    rate[TRAVEL_RATE] = 0.0
    if m[PAYLOAD_MASS] > 0.0:
        omega = m[PAYLOAD_OMEGA]
        spring = omega * omega * state[TRAVEL] + 2.0 * m[PAYLOAD_DAMPING] * omega * state[TRAVEL_RATE]
        pull = m[PAYLOAD_MASS] * spring
        wrench[2] += pull
        wrench[3] += m[CENTRE + 1] * pull
        wrench[4] -= m[CENTRE] * pull
        platform_rates(m, inverse, state, R, wrench, rate, acceleration)
        weight = R[0, 2] * m[WEIGHT] + R[1, 2] * m[WEIGHT + 1] + R[2, 2] * m[WEIGHT + 2]
        rate[TRAVEL] = state[TRAVEL_RATE]
        rate[TRAVEL_RATE] = -spring + weight / m[MASS] - along_axis_of_centre(m, state, acceleration)
    else:
        platform_rates(m, inverse, state, R, wrench, rate, acceleration)


@compiled
def run_hexapod(
    p, s, m, inverse, base, joints, retracted, c, sensors, shared, setpoint, u_known, y_known, ps_known, start,
    rate_log, substeps, near_rest, out,
):  # fmt: skip
    """Simulate and write the measured outputs, without noise, into out (N_OUTPUTS, n).

    sensors (6, N_SENSORS): a leg's gains, offsets, delays; shared (N_SENSORS,): those of supply and accelerometers.
    setpoint, u_known, y_known (6, n); ps_known (0,) or (n,): see `leg_simulation.run_leg`. start (N_STATES,).
    """
    n = setpoint.shape[1]
    dt = 1.0 / rate_log
    fine = dt / substeps
    state = start.copy()
    k1, k2, k3, k4 = np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES)
    work = np.empty(N_STATES)
    y, v, acceleration, spare = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    fixed = (p, s, m, inverse, base, joints, retracted, np.empty((3, 3)), np.empty((6, 3)), np.empty(6))
    y_true, p_true, a_true, u_hist = np.empty((6, n)), np.empty((6, n)), np.empty((6, n)), np.empty((6, n))
    every = max(round(rate_log / c[RATE]), 1)
    volts, held = np.zeros(6), np.zeros(6)
    driven = ps_known.shape[0] == n
    for i in range(n):
        t = i * dt
        if driven:
            state[SUPPLY] = ps_known[i]
        rates(fixed, held, t, fine, state, k1, y, v, acceleration)
        for j in range(6):
            y_true[j, i] = y[j]
            p_true[j, i] = state[j * LEG_STATES + LEG_P1]
            if i % every == 0:
                late = sensors[j, Y_DELAY] * rate_log
                y_m = sensors[j, Y_GAIN] * delayed(y_true[j], i, late) + sensors[j, Y_OFFSET]
                if c[FEEDBACK] == 0.0:
                    volts[j] = c[GAIN] * (setpoint[j, i] - y_m)
                else:
                    volts[j] = u_known[j, i] + FOLLOW * c[GAIN] * (y_known[j, i] - y_m)
                volts[j] = min(max(volts[j], -c[VOLTS_MAX]), c[VOLTS_MAX])
            u_hist[j, i] = volts[j]
            held[j] = valve.play(delayed(u_hist[j], i, p[j, P.VALVE_DELAY] * rate_log), held[j], p[j, P.HYSTERESIS])
        rates(fixed, held, t, fine, state, k1, y, v, acceleration)
        for a in range(6):
            a_true[a, i] = acceleration[a]
        for j in range(6):
            late = sensors[j, Y_DELAY] * rate_log
            out[j, i] = sensors[j, Y_GAIN] * delayed(y_true[j], i, late) + sensors[j, Y_OFFSET]
            out[6 + j, i] = volts[j]
            late = sensors[j, P_DELAY] * rate_log
            out[12 + j, i] = sensors[j, P_GAIN] * delayed(p_true[j], i, late) + sensors[j, P_OFFSET]
            gain = shared[A_GAIN] if j < 3 else 1.0
            offset = shared[A_OFFSET] if j == 2 else 0.0
            out[19 + j, i] = gain * delayed(a_true[j], i, shared[A_DELAY] * rate_log) + offset
            out[25 + j, i] = v[j]
        out[18, i] = shared[PS_GAIN] * state[SUPPLY] + shared[PS_OFFSET]
        steps = 1
        for j in range(6):
            steps = max(steps, steps_here(p[j], v[j], dt, substeps, near_rest[i]))
        h = dt / steps
        for step in range(steps):
            tau = t + step * h
            if step > 0:
                rates(fixed, held, tau, h, state, k1, y, v, spare)
            for q in range(N_STATES):
                work[q] = state[q] + 0.5 * h * k1[q]
            rates(fixed, held, tau + 0.5 * h, h, work, k2, y, v, spare)
            for q in range(N_STATES):
                work[q] = state[q] + 0.5 * h * k2[q]
            rates(fixed, held, tau + 0.5 * h, h, work, k3, y, v, spare)
            for q in range(N_STATES):
                work[q] = state[q] + h * k3[q]
            rates(fixed, held, tau + h, h, work, k4, y, v, spare)
            for q in range(N_STATES):
                state[q] += h / 6.0 * (k1[q] + 2.0 * k2[q] + 2.0 * k3[q] + k4[q])
        if not (abs(state[PLACE + 2]) < 1e3 and abs(state[PLACE]) < 1e3):
            out[:, i + 1 :] = math.nan
            return False
    return True
