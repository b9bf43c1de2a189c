"""One leg in closed loop, compiled: the plant that fits ask for thousands of times.

The same balances as the general plant (`hexsim.hydraulics.leg`), with the load as a mass on the leg's axis:

    m dv/dt = P1 A1 + F(y, v, ...) - m g + k_p (q - y) + c_p (q' - v)      payload on a spring, if any
    u_k = K (s_k - y_m)  every 1/rate seconds, held; then delay and play of the valve

RK4, in short steps where the piston reverses and friction is stiff, in COARSE steps a sample elsewhere. Laws whose time
constant is shorter than the step (supply line, bristle) are slowed to it.
"""

from __future__ import annotations

import math

import numpy as np

from hexsim.compiled import compiled
from hexsim.hydraulics import leg, supply, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.supply import S

# states of the leg
Y, V, P1, X, XD, Z, PS, Q, QD, N_STATES = range(10)
# places in the load's row
MASS, GRAVITY, PAYLOAD_MASS, PAYLOAD_OMEGA, PAYLOAD_DAMPING, N_LOAD = range(6)
# places in the sensors' row
(Y_GAIN, Y_OFFSET, Y_DELAY, P_GAIN, P_OFFSET, P_DELAY, PS_GAIN, PS_OFFSET, A_GAIN, A_OFFSET, A_DELAY, N_SENSORS) = (
    range(12)
)
# places in the controller's row
GAIN, RATE, VOLTS_MAX, FEEDBACK, N_CONTROL = range(5)

OUTPUTS = ("position_m", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "acceleration_m_s2", "velocity_m_s")
N_OUTPUTS = len(OUTPUTS)
COARSE_S = 5.0e-4  # [s] longest step away from reversals; error with it: 0.02 of the noise of accelerations, 0.003 of pressures
FOLLOW = 0.3  # of the gain: with all of it the noise of the logged position rings the oil, with less rounded volts let it drift
STIFF_SPEEDS = 5.0  # friction is stiff below so many times its sharpness (tanh: 1 - 1e-4)


@compiled
def leg_terms(p, y, v, volts, t, h, p1, ps, x, xd, z):
    """One leg: (force on the load [N], spool used, dP1/dt, dx/dt, dx'/dt, dz/dt). h: step, for stiff laws."""
    (dp, _, dx, dxd, dz), used, _ = leg.leg_derivatives(p, y, v, volts, t, ps, (p1, ps, x, xd, z), h)
    return leg.leg_force(p, y, v, volts, p1, ps, ps, z, t), used, dp, dx, dxd, dz


@compiled
def supply_rate(s, ps, demand, h):
    """dPs/dt [Pa/s]; a line faster than the step is slowed to it."""
    if s[S.MODEL] != supply.LINE:
        return 0.0
    return supply.line_rate(s, ps, demand, s[S.PRESSURE], h)


@compiled
def rates(p, s, m, volts, t, h, state, rate):
    """Write d state/dt of the leg and its load at time t into `rate`; return the acceleration [m/s2]."""
    y, v, p1, ps = state[Y], state[V], state[P1], state[PS]
    force, x, rate[P1], rate[X], rate[XD], rate[Z] = leg_terms(
        p, y, v, volts, t, h, p1, ps, state[X], state[XD], state[Z]
    )
    rate[Q] = 0.0
    rate[QD] = 0.0
    if m[PAYLOAD_MASS] > 0.0:
        pull = m[PAYLOAD_OMEGA] ** 2 * (state[Q] - y) + 2.0 * m[PAYLOAD_DAMPING] * m[PAYLOAD_OMEGA] * (state[QD] - v)
        force += m[PAYLOAD_MASS] * pull - m[PAYLOAD_MASS] * m[GRAVITY]
        rate[Q] = state[QD]
        rate[QD] = -pull
    acceleration = force / m[MASS] - m[GRAVITY]
    rate[Y] = v
    rate[V] = acceleration
    rate[PS] = supply_rate(s, ps, leg.supply_demand(p, v, x, p1, ps, ps), h) if s[S.MODEL] == supply.LINE else 0.0
    return acceleration


@compiled
def initial_state(p, s, m, y, v):
    """State at rest or in steady motion: the pressure that balances the forces at y, v."""
    state = np.zeros(N_STATES)
    state[Y], state[V], state[PS], state[Q], state[QD] = y, v, s[S.PRESSURE], y, v
    load = (m[MASS] + m[PAYLOAD_MASS]) * m[GRAVITY]
    p1 = 0.5 * s[S.PRESSURE]
    for _ in range(20):  # pressure-dependent friction makes this a fixed point
        beyond = leg.force_beyond_pressure(p, y, v, 0.0, p1, s[S.PRESSURE], s[S.PRESSURE], 0.0, 0.0)
        p1 = (load - beyond) / p[P.AREA_BOTTOM]
    state[P1] = p1
    return state


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
def run_leg(p, s, m, c, sensors, setpoint, u_known, y_known, ps_known, y0, v0, rate_log, substeps, near_rest, out):
    """Simulate and write the measured outputs, without noise, into out (N_OUTPUTS, n).

    feedback 0: the position loop u = K (setpoint - y_m).  feedback 1: the logged volts, held to the logged position,
    u = u_known + FOLLOW K (y_known - y_m), for logs whose controller is not known.
    ps_known: (0,) the supply is simulated; (n,) the supply as measured drives the leg. near_rest (n,): see `steps_here`.
    """
    n = setpoint.shape[0]
    dt = 1.0 / rate_log
    state = initial_state(p, s, m, y0, v0)
    k1, k2, k3, k4 = np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES)
    work = np.empty(N_STATES)
    y_true, p_true, a_true, u_hist = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    if p[P.SPOOL_OMEGA] > 0.0:
        state[X] = leg.commanded_spool(p, 0.0, 0.0)
    every = max(round(rate_log / c[RATE]), 1)
    volts, held = 0.0, 0.0
    valve_delay = p[P.VALVE_DELAY] * rate_log
    driven = ps_known.shape[0] == n
    for i in range(n):
        t = i * dt
        if driven:
            state[PS] = ps_known[i]
        y_true[i] = state[Y]
        p_true[i] = state[P1]
        if i % every == 0:
            y_m = sensors[Y_GAIN] * delayed(y_true, i, sensors[Y_DELAY] * rate_log) + sensors[Y_OFFSET]
            if c[FEEDBACK] == 0.0:
                volts = c[GAIN] * (setpoint[i] - y_m)
            else:
                volts = u_known[i] + FOLLOW * c[GAIN] * (y_known[i] - y_m)
            volts = min(max(volts, -c[VOLTS_MAX]), c[VOLTS_MAX])
        u_hist[i] = volts
        held = valve.play(delayed(u_hist, i, valve_delay), held, p[P.HYSTERESIS])
        a_true[i] = rates(p, s, m, held, t, dt / substeps, state, k1)
        out[0, i] = sensors[Y_GAIN] * delayed(y_true, i, sensors[Y_DELAY] * rate_log) + sensors[Y_OFFSET]
        out[1, i] = volts
        out[2, i] = sensors[P_GAIN] * delayed(p_true, i, sensors[P_DELAY] * rate_log) + sensors[P_OFFSET]
        out[3, i] = sensors[PS_GAIN] * state[PS] + sensors[PS_OFFSET]
        out[4, i] = sensors[A_GAIN] * delayed(a_true, i, sensors[A_DELAY] * rate_log) + sensors[A_OFFSET]
        out[5, i] = state[V]
        steps = steps_here(p, state[V], dt, substeps, near_rest[i])
        h = dt / steps
        for j in range(steps):
            tau = t + j * h
            if j > 0:
                rates(p, s, m, held, tau, h, state, k1)
            for q in range(N_STATES):
                work[q] = state[q] + 0.5 * h * k1[q]
            rates(p, s, m, held, tau + 0.5 * h, h, work, k2)
            for q in range(N_STATES):
                work[q] = state[q] + 0.5 * h * k2[q]
            rates(p, s, m, held, tau + 0.5 * h, h, work, k3)
            for q in range(N_STATES):
                work[q] = state[q] + h * k3[q]
            rates(p, s, m, held, tau + h, h, work, k4)
            for q in range(N_STATES):
                state[q] += h / 6.0 * (k1[q] + 2.0 * k2[q] + 2.0 * k3[q] + k4[q])
        if not math.isfinite(state[Y]) or abs(state[Y]) > 1e3:
            out[:, i + 1 :] = math.nan
            return False
    return True
