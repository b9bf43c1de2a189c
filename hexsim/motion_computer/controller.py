"""The controller of each leg, tick by tick: compiled, with a flat memory, and without any plant.

    r = low-passed setpoint                                  Butterworth of second order (setpoint_filter_Hz)
    v = (r - r_1)/T,  a = (v - v_1)/T                        its velocity and acceleration, differences of the past
    F = sum_j M_ij a_j + b v + F_c tanh(v/TURN)              what load and friction ask of the leg (load_feed_forward)
    z = r + F/k                                              oil travel: the piston's and what the oil spring k gives
    u_f = k_v z' + k_a z''                                   feed-forward
    v_m = w s/(s + w) y                                      velocity of the position that is read
    pid:      u_d = Kp (r - y),                   u_b = u_d + I - K_d v_m
    cascade:  u_d = K_d (Kp/K_d (r - y) + v - v_m),   u_b = u_d + I
    u_p = -K_p s/(s + w_p) (p - F/A1),  p = P1 - P2 A2/A1    pressure feedback (three-way valve: p = P1)
    u = notch(u_b) + u_p + u_f + u_c                         u_c: a compensator's
    I' = u_d/T_i + (sat(u) - u)/T_t                          integral, back-calculation against windup
    valve volts = sat(u), `computing_delay_ticks` later

With the gain alone: u = sat(Kp (r - y) + u_c), report 2.2.4. Anti-windup: Astroem and Haegglund, PID Controllers (1995),
3.5. Filters by the bilinear rule (Franklin, Powell, Workman, Digital Control, 6.1; the notch's middle prewarped), the
integral by Euler's. A delay of n + f ticks is (1 - f) u_n + f u_(n+1): the mean over the tick of volts that change within it.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import allocating, compiled
from hexsim.declaration.controller import LONGEST_DELAY_TICKS

Array = NDArray[np.float64]


class C(IntEnum):
    """Places in a leg's row of constants."""

    GAIN = 0  # Kp [V/m]
    LIMIT = 1  # [V]
    TICK = 2  # T [s]
    CASCADE = 3  # 1: cascade, 0: pid
    INTEGRAL = 4  # 1/T_i [1/s]
    TRACKING = 5  # 1/T_t [1/s]
    VELOCITY_GAIN = 6  # K_d [V s/m]
    VELOCITY_POLE = 7  # y_k = pole y_(k-1) + share (x_k - x_(k-1)), all first-order filters
    VELOCITY_SHARE = 8
    VELOCITY_FORWARD = 9  # k_v [V s/m]
    ACCELERATION_FORWARD = 10  # k_a [V s2/m]
    LOAD_FORWARD = 11  # 1: F is fed forward
    FLEXIBILITY = 12  # 1/k [m/N]
    VISCOUS = 13  # b [N s/m]
    AREA = 14  # A1 [m2]
    AREA_RATIO = 15  # A2/A1 of a leg on a four-way valve, else 0
    PRESSURE_GAIN = 16  # K_p [V/Pa]
    PRESSURE_POLE = 17
    PRESSURE_SHARE = 18
    DELAY = 19  # [ticks]
    NOTCH = 20  # 1: there is one; b0, b1, b2, a1, a2 stand behind it
    SMOOTHING = 26  # of the setpoint, likewise
    EVERY = 32  # ticks between setpoints
    COULOMB_EXTEND = 33  # F_c [N]
    COULOMB_RETRACT = 34
    END = 35


class M(IntEnum):
    """Places in a leg's row of memory."""

    SETPOINT = 0
    VELOCITY = 1  # of the setpoint
    ACCELERATION = 2
    FORCE = 3
    TRAVEL_RATE = 4  # z'
    POSITION = 5
    MEASURED_VELOCITY = 6
    INTEGRAL = 7  # [V]
    DRIVE = 8  # u_d of this tick [V]
    PRESSURE = 9  # p - F/A1
    HIGH_PASSED = 10
    NOTCH = 11  # two numbers
    SMOOTHING = 13  # two numbers
    START = 15  # of the straight line that the setpoint is on
    GOAL = 16
    PHASE = 17  # ticks since its start
    FORCE_PASSED = 18  # F/A1 through the high-pass of the pressure feedback
    LINE = 19  # the last volts, newest first


N_CONSTANTS = int(C.END)
N_MEMORY = M.LINE + LONGEST_DELAY_TICKS + 2


TURN_m_s = 2e-3  # speed within which dry friction changes its sign


class Control(NamedTuple):
    """Constants (n_legs, N_CONSTANTS); inertia M [kg] of the load along the legs (n_legs, n_legs)."""

    rows: Array
    inertia: Array


def new_memory(n_legs: int) -> Array:
    """Memory (n_legs, N_MEMORY) before the first tick; `begin` fills it."""
    return np.zeros((n_legs, N_MEMORY))


@compiled
def begin(control, memory, setpoint, position, pressure):
    """At rest at these readings (n_legs,), volts 0: what a loop starts from."""
    for i in range(memory.shape[0]):
        c, m = control.rows[i], memory[i]
        for k in range(m.shape[0]):
            m[k] = 0.0
        m[M.SETPOINT], m[M.POSITION], m[M.PRESSURE] = setpoint[i], position[i], pressure[i]
        m[M.START], m[M.GOAL] = setpoint[i], setpoint[i]
        m[M.SMOOTHING] = (1.0 - c[C.SMOOTHING + 1]) * setpoint[i]
        m[M.SMOOTHING + 1] = (c[C.SMOOTHING + 3] - c[C.SMOOTHING + 5]) * setpoint[i]


@compiled
def second_order(c, m, x):
    """One step of a second-order filter, direct form II transposed: c = (1, b0, b1, b2, a1, a2), m its two numbers."""
    out = c[1] * x + m[0]
    m[0] = c[2] * x - c[4] * out + m[1]
    m[1] = c[3] * x - c[5] * out
    return out


@compiled
def straight(every, m, setpoints, out):
    """Setpoints (k,) of this tick and the next k - 1 of one leg, taken at every `every`-th tick, with straight lines in
    between: the line to a setpoint begins when it comes, so the path is `every` ticks late. Beyond k the last line goes on."""
    phase = int(m[M.PHASE])
    if phase == 0:
        m[M.START], m[M.GOAL] = m[M.GOAL], setpoints[0]
    start, goal = m[M.START], m[M.GOAL]
    for k in range(setpoints.shape[0]):
        place = (phase + k) % every
        if k > 0 and place == 0:
            start, goal = goal, setpoints[k]
        out[k] = start + place / every * (goal - start)
    m[M.PHASE] = (phase + 1) % every


@compiled
def leg_path(control, memory, setpoints, out):
    """Setpoints (k, n_legs) of this tick and the next k - 1 into `out`, before the filter: straight lines where they come
    more slowly than the ticks."""
    for i in range(control.rows.shape[0]):
        for k in range(setpoints.shape[0]):
            out[k, i] = setpoints[k, i]
        if control.rows[i, C.EVERY] > 1.0:
            straight(int(control.rows[i, C.EVERY]), memory[i], setpoints[:, i], out[:, i])


@compiled
def smoothed(control, memory, setpoint, out):
    """The setpoint (n_legs,) of this tick behind its filter, as the controller follows it, into `out`, which may be `setpoint`."""
    for i in range(control.rows.shape[0]):
        c, m = control.rows[i, C.SMOOTHING :], memory[i, M.SMOOTHING : M.SMOOTHING + 2]
        out[i] = second_order(c, m, setpoint[i]) if c[0] > 0.0 else setpoint[i]


@compiled
def high_passed(pole, share, before, x, x_before):
    """One step of a first-order filter without gain at rest."""
    return pole * before + share * (x - x_before)


@compiled
def feed_forward(control, memory, setpoint, out):
    """u_f (n_legs,) [V] into `out`; notes the setpoint's motion and the load's force."""
    rows, inertia = control
    n, T = rows.shape[0], rows[0, C.TICK]
    for i in range(n):
        m = memory[i]
        velocity = (setpoint[i] - m[M.SETPOINT]) / T
        m[M.ACCELERATION] = (velocity - m[M.VELOCITY]) / T
        m[M.SETPOINT], m[M.VELOCITY] = setpoint[i], velocity
    for i in range(n):
        c, m = rows[i], memory[i]
        force = 0.0
        if c[C.LOAD_FORWARD] > 0.0:
            v = m[M.VELOCITY]
            coulomb = c[C.COULOMB_EXTEND] if v > 0.0 else c[C.COULOMB_RETRACT]
            force = c[C.VISCOUS] * v + coulomb * math.tanh(v / TURN_m_s)
            for j in range(n):
                force += inertia[i, j] * memory[j, M.ACCELERATION]
        if c[C.PRESSURE_GAIN] > 0.0:
            m[M.FORCE_PASSED] = high_passed(
                c[C.PRESSURE_POLE], c[C.PRESSURE_SHARE], m[M.FORCE_PASSED], force / c[C.AREA], m[M.FORCE] / c[C.AREA]
            )
        rate = m[M.VELOCITY] + c[C.FLEXIBILITY] * (force - m[M.FORCE]) / T
        change = (rate - m[M.TRAVEL_RATE]) / T
        m[M.FORCE], m[M.TRAVEL_RATE] = force, rate
        out[i] = c[C.VELOCITY_FORWARD] * rate + c[C.ACCELERATION_FORWARD] * change


@compiled
def of_the_setpoint(control, memory, forward, out):
    """Volts (n_legs,) that are of the setpoint alone, into `out`: u_f, K_d v of a cascade, K_p H(F/A1)."""
    for i in range(control.rows.shape[0]):
        c, m = control.rows[i], memory[i]
        out[i] = forward[i] + c[C.CASCADE] * c[C.VELOCITY_GAIN] * m[M.VELOCITY]
        out[i] += c[C.PRESSURE_GAIN] * m[M.FORCE_PASSED]


@compiled
def feedback(control, memory, setpoint, position, pressure, out):
    """notch(u_b) + u_p (n_legs,) [V] into `out`. A leg without a finite position: NaN, its memory as it was."""
    for i in range(control.rows.shape[0]):
        c, m = control.rows[i], memory[i]
        drive = c[C.GAIN] * (setpoint[i] - position[i])
        if not math.isfinite(drive):
            out[i] = math.nan
            continue
        volts = drive
        if c[C.VELOCITY_GAIN] > 0.0:
            velocity = high_passed(
                c[C.VELOCITY_POLE], c[C.VELOCITY_SHARE], m[M.MEASURED_VELOCITY], position[i], m[M.POSITION]
            )
            m[M.MEASURED_VELOCITY] = velocity
            if c[C.CASCADE] > 0.0:
                drive += c[C.VELOCITY_GAIN] * m[M.VELOCITY]
            volts = drive - c[C.VELOCITY_GAIN] * velocity
            drive = volts if c[C.CASCADE] > 0.0 else drive
        m[M.POSITION], m[M.DRIVE] = position[i], drive
        if c[C.INTEGRAL] > 0.0:
            volts += m[M.INTEGRAL]
        if c[C.NOTCH] > 0.0:
            volts = second_order(c[C.NOTCH :], m[M.NOTCH : M.NOTCH + 2], volts)
        if c[C.PRESSURE_GAIN] > 0.0 and math.isfinite(pressure[i]):
            beyond = pressure[i] - m[M.FORCE] / c[C.AREA]
            m[M.HIGH_PASSED] = high_passed(
                c[C.PRESSURE_POLE], c[C.PRESSURE_SHARE], m[M.HIGH_PASSED], beyond, m[M.PRESSURE]
            )
            m[M.PRESSURE] = beyond
            volts -= c[C.PRESSURE_GAIN] * m[M.HIGH_PASSED]
        out[i] = volts


@compiled
def saturated(control, memory, asked, out):
    """sat(u) (n_legs,) into `out`, which may be `asked`, 0 for a leg that asks for NaN; the integrals a tick further."""
    for i in range(control.rows.shape[0]):
        c, m, volts = control.rows[i], memory[i], asked[i]
        if not math.isfinite(volts):
            out[i] = 0.0
            continue
        out[i] = min(max(volts, -c[C.LIMIT]), c[C.LIMIT])
        if c[C.INTEGRAL] > 0.0:
            m[M.INTEGRAL] += c[C.TICK] * (c[C.INTEGRAL] * m[M.DRIVE] + c[C.TRACKING] * (out[i] - volts))


@compiled
def computed(control, memory, volts, out):
    """Valve volts (n_legs,) into `out`: `volts` after the computing delay."""
    for i in range(control.rows.shape[0]):
        delay, line = control.rows[i, C.DELAY], memory[i, M.LINE :]
        out[i] = volts[i]
        if delay > 0.0:
            for k in range(line.shape[0] - 1, 0, -1):
                line[k] = line[k - 1]
            line[0] = volts[i]
            whole = int(delay)
            part = delay - whole
            out[i] = (1.0 - part) * line[whole] + part * line[whole + 1]


@compiled
def ask(control, memory, setpoints, position, pressure, path, followed, forward, own, out):
    """What all legs ask for before a compensator (n_legs,) [V] into `out`. setpoints (k, n_legs) of this tick and the next; `path`
    (k, n_legs) takes them before the filter, `followed` this tick's behind it, `forward` u_f, `own` what is of the setpoint alone."""
    leg_path(control, memory, setpoints, path)
    smoothed(control, memory, path[0], followed)
    feed_forward(control, memory, followed, forward)
    feedback(control, memory, followed, position, pressure, out)
    for i in range(out.shape[0]):
        out[i] += forward[i]
    of_the_setpoint(control, memory, forward, own)


@compiled
def send(control, memory, asked, commanded, out):
    """Saturation and computing delay: `asked` (n_legs,) into `commanded` and into `out`."""
    saturated(control, memory, asked, commanded)
    computed(control, memory, commanded, out)


@allocating
def tick(control, memory, setpoint, position, pressure, out):
    """One tick of all legs without a compensator: valve volts (n_legs,) [V] into `out`. pressure: p (n_legs,) [Pa]."""
    path, forward = np.empty((1, out.shape[0])), np.empty(out.shape[0])
    leg_path(control, memory, setpoint.reshape(1, -1), path)
    smoothed(control, memory, path[0], path[0])
    feed_forward(control, memory, path[0], forward)
    feedback(control, memory, path[0], position, pressure, out)
    for i in range(out.shape[0]):
        out[i] += forward[i]
    saturated(control, memory, out, out)
    computed(control, memory, out, out)
