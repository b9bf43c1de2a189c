"""The controller of each leg, tick by tick: compiled, with a flat memory, and without any plant.

    r = smoothed setpoint                                    Butterworth of second order (setpoint_filter_Hz)
    v = (r - r_1)/T,  a = (v - v_1)/T                        its velocity and acceleration, differences of the past
    F = sum_j M_ij a_j + b v                                 what the load asks of the leg (load_feed_forward), else 0
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
from scipy.signal import bilinear

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.declaration.controller import LONGEST_DELAY_TICKS
from hexsim.hydraulics import leg
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P, declared_rows
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.leg_load import leg_compliance

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
    END = 32


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
    LINE = 15  # the last volts, newest first


N_CONSTANTS = int(C.END)
N_MEMORY = M.LINE + LONGEST_DELAY_TICKS + 2


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
    memory[:] = 0.0
    memory[:, M.SETPOINT], memory[:, M.POSITION], memory[:, M.PRESSURE] = setpoint, position, pressure
    for c, m, r in zip(control.rows, memory, setpoint):
        m[M.SMOOTHING] = (1.0 - c[C.SMOOTHING + 1]) * r
        m[M.SMOOTHING + 1] = (c[C.SMOOTHING + 3] - c[C.SMOOTHING + 5]) * r


@compiled
def second_order(c, m, x):
    """One step of a second-order filter, direct form II transposed: c = (1, b0, b1, b2, a1, a2), m its two numbers."""
    out = c[1] * x + m[0]
    m[0] = c[2] * x - c[4] * out + m[1]
    m[1] = c[3] * x - c[5] * out
    return out


@compiled
def smoothed(control, memory, setpoints, out):
    """Setpoints (k, n_legs) of this tick and the next k - 1, smoothed, into `out`; the memory goes one tick further."""
    ahead = np.empty(2)
    for i in range(control.rows.shape[0]):
        c, m = control.rows[i, C.SMOOTHING :], memory[i, M.SMOOTHING : M.SMOOTHING + 2]
        if c[0] > 0.0:
            out[0, i] = second_order(c, m, setpoints[0, i])
            ahead[:] = m
            for k in range(1, setpoints.shape[0]):
                out[k, i] = second_order(c, ahead, setpoints[k, i])
        else:
            out[:, i] = setpoints[:, i]


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
            force = c[C.VISCOUS] * m[M.VELOCITY]
            for j in range(n):
                force += inertia[i, j] * memory[j, M.ACCELERATION]
        rate = m[M.VELOCITY] + c[C.FLEXIBILITY] * (force - m[M.FORCE]) / T
        change = (rate - m[M.TRAVEL_RATE]) / T
        m[M.FORCE], m[M.TRAVEL_RATE] = force, rate
        out[i] = c[C.VELOCITY_FORWARD] * rate + c[C.ACCELERATION_FORWARD] * change


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
    """sat(u) (n_legs,) into `out`, 0 for a leg that asks for NaN; the integrals a tick further."""
    for i in range(control.rows.shape[0]):
        c, m = control.rows[i], memory[i]
        if not math.isfinite(asked[i]):
            out[i] = 0.0
            continue
        out[i] = min(max(asked[i], -c[C.LIMIT]), c[C.LIMIT])
        if c[C.INTEGRAL] > 0.0:
            m[M.INTEGRAL] += c[C.TICK] * (c[C.INTEGRAL] * m[M.DRIVE] + c[C.TRACKING] * (out[i] - asked[i]))


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
def tick(control, memory, setpoint, position, pressure, out):
    """One tick of all legs without a compensator: valve volts (n_legs,) [V] into `out`. pressure: p (n_legs,) [Pa]."""
    path, forward = np.empty((1, out.shape[0])), np.empty(out.shape[0])
    smoothed(control, memory, setpoint.reshape(1, -1), path)
    feed_forward(control, memory, path[0], forward)
    feedback(control, memory, path[0], position, pressure, out)
    for i in range(out.shape[0]):
        out[i] += forward[i]
    saturated(control, memory, out, out)
    computed(control, memory, out, out)


def control_of(machine: Machine) -> Control:
    """The declared controllers. They know the declared machine, and nothing of its effects."""
    declared, rows = machine.controller, declared_rows(machine)
    tick = 1.0 / declared.rate_Hz
    constants = np.zeros((machine.n_legs, N_CONSTANTS))
    values = {
        C.GAIN: declared.gain_V_per_m,
        C.LIMIT: machine.valve.voltage_max_V,
        C.TICK: tick,
        C.CASCADE: float(declared.structure == "cascade"),
        C.INTEGRAL: 1.0 / declared.integral_time_s if declared.integral_time_s else 0.0,
        C.TRACKING: 1.0 / declared.anti_windup_s,
        C.VELOCITY_GAIN: declared.velocity_gain_V_s_per_m,
        C.VELOCITY_FORWARD: declared.velocity_feed_forward_V_s_per_m,
        C.ACCELERATION_FORWARD: declared.acceleration_feed_forward_V_s2_per_m,
        C.LOAD_FORWARD: float(declared.load_feed_forward),
        C.PRESSURE_GAIN: declared.pressure_feedback_V_per_Pa,
        C.DELAY: declared.computing_delay_ticks,
    }
    omega = 2 * math.pi * declared.velocity_filter_Hz
    values[C.VELOCITY_POLE], values[C.VELOCITY_SHARE] = _first_order(omega, omega, tick)
    values[C.PRESSURE_POLE], values[C.PRESSURE_SHARE] = _first_order(
        1.0, 2 * math.pi * declared.pressure_high_pass_Hz, tick
    )
    for place, value in values.items():
        constants[:, place] = value
    if declared.notch_Hz > 0.0:
        omega = 2 * math.pi * declared.notch_Hz
        width, depth = declared.notch_width * omega, declared.notch_depth
        at = slice(C.NOTCH, C.NOTCH + 6)
        constants[:, at] = _second_order([1.0, depth * width, omega**2], [1.0, width, omega**2], omega, tick)
    if declared.setpoint_filter_Hz > 0.0:
        omega = 2 * math.pi * declared.setpoint_filter_Hz
        at = slice(C.SMOOTHING, C.SMOOTHING + 6)
        constants[:, at] = _second_order([omega**2], [1.0, math.sqrt(2) * omega, omega**2], omega, tick)
    for c, p in zip(constants, rows, strict=True):
        c[C.AREA] = p[P.AREA_BOTTOM]
        c[C.AREA_RATIO] = p[P.AREA_TOP] / p[P.AREA_BOTTOM] if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else 0.0
        c[C.VISCOUS] = 0.5 * (p[P.VISCOUS_EXTEND] + p[P.VISCOUS_RETRACT])
        c[C.FLEXIBILITY] = 1.0 / oil_stiffness(p)
    inertia = np.zeros((machine.n_legs, machine.n_legs))
    if declared.load_feed_forward:
        inertia = np.linalg.inv(leg_compliance(resolve(machine.model_copy(update={"effects": {}}))))
    return Control(constants, inertia)


def _first_order(numerator: float, omega: float, tick: float) -> tuple[float, float]:
    """(pole, share) of numerator s/(s + omega) by the bilinear rule."""
    over, under = bilinear([numerator, 0.0], [1.0, omega], 1.0 / tick)
    return -float(under[1]), float(over[0])


def _second_order(over: list[float], under: list[float], omega: float, tick: float) -> Array:
    """(1, b0, b1, b2, a1, a2) of a fraction in s by the bilinear rule, prewarped at omega."""
    b, a = bilinear(over, under, omega / (2.0 * math.tan(0.5 * omega * tick)))
    return np.r_[1.0, b, a[1:]]


def oil_stiffness(p: Array) -> float:
    """Oil spring k [N/m] of a leg at mid stroke and half the supply pressure: A1^2/C1, and A2^2/C2 on a four-way valve."""
    middle, pressure = 0.5 * p[P.STROKE], 0.5 * p[P.SUPPLY_PRESSURE]
    stiffness = p[P.AREA_BOTTOM] ** 2 / leg.chamber_capacity(p, middle, pressure)
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        stiffness += p[P.AREA_TOP] ** 2 / leg.rod_side_room(p, middle, pressure)
    return float(stiffness)
