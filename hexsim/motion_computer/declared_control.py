"""The controllers of a declared machine as the numbers of `controller`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear

from hexsim.declaration import Machine
from hexsim.hydraulics import leg
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P, declared_rows
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.controller import N_CONSTANTS, C, Control
from hexsim.motion_computer.leg_load import leg_compliance

Array = NDArray[np.float64]


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
        C.EVERY: round(declared.rate_Hz / (declared.setpoint_rate_Hz or declared.rate_Hz)),
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
        inertia[:] = np.linalg.inv(leg_compliance(resolve(machine.model_copy(update={"effects": {}}))))
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
