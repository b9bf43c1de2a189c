"""The controllers of a declared machine as the numbers of `controller`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Controller, Machine
from hexsim.declaration.controller import LONGEST_DELAY_TICKS
from hexsim.hydraulics.oil_spring import oil_stiffness
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P, declared_rows
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.controller import N_CONSTANTS, C, Control
from hexsim.motion_computer.leg_load import leg_compliance

Array = NDArray[np.float64]


def control_of(machine: Machine) -> Control:
    """The declared controllers, a row a leg. They know the declared machine; of its effects they have their own, a wrong
    gain and a computing delay."""
    rows = [
        _row(own.controller, own.valve.voltage_max_V, p)
        for own, p in zip(machine.legs, declared_rows(machine), strict=True)
    ]
    inertia = np.zeros((machine.n_legs, machine.n_legs))
    if machine.controller.load_feed_forward:
        inertia[:] = np.linalg.inv(leg_compliance(resolve(machine.model_copy(update={"effects": {}}))))
    control = Control(np.array(rows), inertia)
    if machine.effects:
        running = resolve(machine)
        control.rows[:, C.GAIN] *= running.loop_gain
        control.rows[:, C.DELAY] = np.minimum(control.rows[:, C.DELAY] + running.loop_delay_ticks, LONGEST_DELAY_TICKS)
    return control


def _row(declared: Controller, limit_V: float, p: Array) -> Array:
    """Constants (N_CONSTANTS,) of a leg with the hydraulics p."""
    tick, c = 1.0 / declared.rate_Hz, np.zeros(N_CONSTANTS)
    c[C.GAIN], c[C.LIMIT], c[C.TICK] = declared.gain_V_per_m, limit_V, tick
    c[C.CASCADE] = float(declared.structure == "cascade")
    c[C.INTEGRAL] = 1.0 / declared.integral_time_s if declared.integral_time_s else 0.0
    c[C.TRACKING] = 1.0 / declared.anti_windup_s
    c[C.VELOCITY_GAIN] = declared.velocity_gain_V_s_per_m
    omega = 2 * math.pi * declared.velocity_filter_Hz
    c[C.VELOCITY_POLE], c[C.VELOCITY_SHARE] = _first_order(omega, omega, tick)
    c[C.VELOCITY_FORWARD] = declared.velocity_feed_forward_V_s_per_m
    c[C.ACCELERATION_FORWARD] = declared.acceleration_feed_forward_V_s2_per_m
    c[C.LOAD_FORWARD], c[C.FLEXIBILITY] = float(declared.load_feed_forward), 1.0 / oil_stiffness(p)
    c[C.VISCOUS] = 0.5 * (p[P.VISCOUS_EXTEND] + p[P.VISCOUS_RETRACT])
    c[C.COULOMB_EXTEND], c[C.COULOMB_RETRACT] = p[P.COULOMB_EXTEND], p[P.COULOMB_RETRACT]
    c[C.AREA] = p[P.AREA_BOTTOM]
    c[C.AREA_RATIO] = p[P.AREA_TOP] / p[P.AREA_BOTTOM] if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else 0.0
    c[C.PRESSURE_GAIN] = declared.pressure_feedback_V_per_Pa
    c[C.PRESSURE_POLE], c[C.PRESSURE_SHARE] = _first_order(1.0, 2 * math.pi * declared.pressure_high_pass_Hz, tick)
    c[C.DELAY] = declared.computing_delay_ticks
    c[C.EVERY] = round(declared.rate_Hz / (declared.setpoint_rate_Hz or declared.rate_Hz))
    if declared.notch_Hz > 0.0:
        omega = 2 * math.pi * declared.notch_Hz
        width, depth = declared.notch_width * omega, declared.notch_depth
        at = slice(C.NOTCH, C.NOTCH + 6)
        c[at] = _second_order([1.0, depth * width, omega**2], [1.0, width, omega**2], omega, tick)
    if declared.setpoint_filter_Hz > 0.0:
        omega = 2 * math.pi * declared.setpoint_filter_Hz
        at = slice(C.SMOOTHING, C.SMOOTHING + 6)
        c[at] = _second_order([omega**2], [1.0, math.sqrt(2) * omega, omega**2], omega, tick)
    return c


def _first_order(numerator: float, omega: float, tick: float) -> tuple[float, float]:
    """(pole, share) of numerator s/(s + omega) by the bilinear rule."""
    over, under = _bilinear([numerator, 0.0], [1.0, omega], 1.0 / tick)
    return -float(under[1]), float(over[0])


def _second_order(over: list[float], under: list[float], omega: float, tick: float) -> Array:
    """(1, b0, b1, b2, a1, a2) of a fraction in s by the bilinear rule, prewarped at omega."""
    b, a = _bilinear(over, under, omega / (2.0 * math.tan(0.5 * omega * tick)))
    return np.r_[1.0, b, a[1:]]


def _bilinear(over: list[float], under: list[float], rate_Hz: float) -> tuple[Array, Array]:
    """(b, a) of a fraction in s, highest power first, with s = 2 rate (z - 1)/(z + 1).

    As `scipy.signal.bilinear`, which is half a second of start-up.
    """
    n = len(under) - 1

    def in_z(powers: list[float]) -> Array:
        terms = zip(reversed(powers), range(len(powers)), strict=True)
        return sum(c * (2.0 * rate_Hz) ** k * np.poly([1.0] * k + [-1.0] * (n - k)) for c, k in terms)  # type: ignore[return-value]

    a = in_z(under)
    return in_z(over) / a[0], a / a[0]
