"""Continuity of the chambers: what flows in = what the piston sweeps + what compresses  [m3/s], Eq. 3.7 rearranged.

bottom   r_Q = phi(u, P1, Ps) - A1 v - C(y, P1) dP1/dt
fast     the same of the bottom chamber under a short window less that under the usual one
top      r_Q = phi_B(u, P2, Ps) + A2 v - C_B(y, P2) dP2/dt       of a rod side on the valve
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from hexsim.compiled import allocating
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics import rod_side
from hexsim.hydraulics.learned import memories
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.signals.log import Log
from hexsim.signals.weak_form import SHORT_S, WHOLE, Window
from hexsim.tracing.balances.balance import (
    Balance,
    MeasuredPoint,
    SensedLeg,
    channel_settings,
    leg_key,
    measured_point,
    position_settings,
    resolved_machine,
)
from hexsim.tracing.memory import latest

Array = np.ndarray
FlowOf = Callable[[Array, MeasuredPoint], Array]
LeftOf = Callable[[Array, MeasuredPoint, Array, Window], Array]
OF_FORCE = (  # of a leg's row: no flow depends on it
    *range(P.CUSHION_LENGTH, P.CUSHION_DAMPING + 1), *range(P.VISCOUS_EXTEND, P.TONE_PHASE + 1), P.SEAL_FRICTION_TOP,
    P.SEAL_FRICTION_ACROSS, P.HARDENING, P.FRICTION_WARM_UP, P.FRICTION_WARM_UP_TIME,
    P.FRICTION_SETTLED, P.VISCOUS_FADING,
)  # fmt: skip


@allocating
def inflows(p, y, v, volts, x, P1, P2, Ps, t):
    """phi of every sample [m3/s]."""
    flow, memory = np.empty(y.shape[0]), memories(p, y, v, volts, P1, Ps, t)
    for i in range(y.shape[0]):
        flow[i] = leg_equations.inflow_bottom(p, y[i], v[i], volts[i], x[i], P1[i], P2[i], Ps[i], t[i], memory[i])
    return flow


@allocating
def top_inflows(p, y, x, P1, P2, Ps):
    """phi_B of every sample [m3/s]."""
    flow = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        flow[i] = rod_side.valve_inflow(p, y[i], x[i], P1[i], P2[i], Ps[i])
    return flow


@allocating
def capacities(p, y, P1):
    """Hydraulic capacity of the bottom chamber of every sample [m3/Pa]."""
    capacity = np.empty(y.shape[0])
    for i in range(y.shape[0]):
        capacity[i] = leg_equations.chamber_capacity(p, y[i], P1[i])
    return capacity


@allocating
def top_capacities(p, y, P2):
    """Hydraulic capacity of the rod side of every sample [m3/Pa]."""
    capacity = np.empty(y.shape[0])
    for i in range(y.shape[0]):
        capacity[i] = rod_side.capacity(p, y[i], P2[i])
    return capacity


def compression(capacity: Array, pressure: Array, mean: Array, window: Window) -> Array:
    """<w, C dP/dt> (n_at,) [m3/s] without a derivative of the pressure; mean: of the pressure under the window."""
    about = pressure - mean.mean()
    return window.rate(capacity * about) - window.mean(np.gradient(capacity, window.dt) * about)


def inflow_of(p: Array, point: MeasuredPoint) -> Array:
    """phi (n,) [m3/s]. Without a pressure on the rod side nothing leaks across the piston."""
    assert point.P1 is not None
    across = point.P1 if point.P2 is None else point.P2
    return inflows(p, point.y, point.v, point.volts, point.x, point.P1, across, point.Ps, point.t)


def top_inflow_of(p: Array, point: MeasuredPoint) -> Array:
    """phi_B (n,) [m3/s]."""
    assert point.P1 is not None and point.P2 is not None
    return top_inflows(p, point.y, point.x, point.P1, point.P2, point.Ps)


def capacity_of(p: Array, sensed: SensedLeg) -> Array:
    """Of the bottom chamber under the window (n,) [m3/Pa]."""
    return capacities(p, sensed.mean_y, sensed.mean_P1)


def residual_of(p: Array, point: MeasuredPoint, flow: Array, window: Window) -> Array:
    """Of the bottom chamber (n_at,) [m3/s]."""
    assert point.P1 is not None
    sensed = point.sensed
    capacity = capacity_of(p, sensed)
    compressed = compression(capacity, point.P1, sensed.mean_P1, window)
    return window.mean(flow) - p[P.AREA_BOTTOM] * sensed.mean_v[window.at] - compressed


def fast_residual_of(p: Array, point: MeasuredPoint, flow: Array, window: Window) -> Array:
    """Of the bottom chamber (n_at,) [m3/s], what is slower than the usual window taken off."""
    assert point.P1 is not None
    sensed, at, short = point.sensed, window.at, Window(1.0 / window.dt, SHORT_S, window.at)
    capacity = capacities(p, np.ascontiguousarray(sensed.mean_y[at]), np.ascontiguousarray(sensed.mean_P1[at]))
    net = flow - p[P.AREA_BOTTOM] * sensed.fast_v
    with np.errstate(invalid="ignore"):  # a flow without bound leaves NaN, as any divergence
        return short.mean(net) - window.mean(net) - capacity * fast_rate(point.P1, 1.0 / window.dt, at)


def fast_rate(signal: Array, rate_Hz: float, at: slice = WHOLE) -> Array:
    """Rate of a signal under the short window less that under the usual one, (n_at,) [1/s]."""
    return Window(rate_Hz, SHORT_S, at).rate(signal) - Window(rate_Hz, at=at).rate(signal)


def top_residual_of(p: Array, point: MeasuredPoint, flow: Array, window: Window) -> Array:
    """Of a rod side on the valve (n_at,) [m3/s]."""
    assert point.P2 is not None
    sensed = point.sensed
    capacity = top_capacities(p, sensed.mean_y, sensed.mean_P2)
    compressed = compression(capacity, point.P2, sensed.mean_P2, window)
    return window.mean(flow) + p[P.AREA_TOP] * sensed.mean_v[window.at] - compressed


def of_legs(flow_of: FlowOf, left: LeftOf, log: Log, machine: Machine, at: slice) -> Array:
    """The residual of each leg at some samples, a row a leg."""
    resolved, window = resolved_machine(machine), Window(log.rate, at=at)

    def residual(leg: int) -> Array:
        row, point = resolved.rows[leg], measured_point(log, machine, resolved, leg)
        key = leg_key(resolved, leg, OF_FORCE)
        flow = latest(log, (flow_of.__name__, leg), key, lambda: flow_of(row, point))
        place = left.__name__, leg, at.start, at.stop, at.step
        return latest(log, place, key, lambda: left(row, point, flow, window))

    return np.stack([residual(leg) for leg in range(log.n_legs)])


class Continuity(Balance):
    """Continuity of each leg's bottom chamber."""

    name = "continuity"
    unit = "m3/s"
    caption = "valve flow = piston flow + compression of the oil"
    order = 30
    signals = (
        "valve_V", "position_m", "pressure_bottom_Pa", "time_s", "velocity_m_s", "pressure_supply_Pa", "acceleration_m_s2",
    )  # fmt: skip
    usual_signal = "valve_V"
    learned_as = "continuity"
    other_names: ClassVar = {"valve": "the same, put down to the valve where the valve explains it"}

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return (("valve", "pressure_bottom"),)

    def reported_as(self, signal: str) -> str:
        return "valve" if signal == "valve_V" else self.name

    def noise_gains(self, resolved: Resolved) -> Array:
        """Of the positions, whose rate is noisier than the pressures'."""
        return np.array([position_settings(resolved, leg)[1] for leg in range(resolved.machine.n_legs)])

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        return of_legs(inflow_of, residual_of, log, machine, at)


class TopContinuity(Continuity):
    """Continuity of each leg's rod side, where it is on the valve."""

    name = "continuity of the rod side"
    caption = "the same of the rod side"
    order = 35
    learned_as = None
    other_names: ClassVar = {}

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        if machine.cylinder.rod_side != "valve":
            return ()
        return (("valve", "pressure_bottom", "pressure_top"),)

    def reported_as(self, signal: str) -> str:
        return self.name

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        return of_legs(top_inflow_of, top_residual_of, log, machine, at)


def mean_capacity(log: Log, machine: Machine) -> float:
    """Of the bottom chamber of the first leg over a log [m3/Pa]."""
    resolved = resolved_machine(machine)
    row, key = resolved.rows[0], leg_key(resolved, 0, OF_FORCE)

    def mean() -> Array:
        return np.mean(capacity_of(row, measured_point(log, machine, resolved, 0).sensed), keepdims=True)

    return float(latest(log, "mean capacity", key, mean)[0])


class FastContinuity(Continuity):
    """What of the bottom chamber is faster than the usual window, of a bench: the oil's spring, 30 to 150 Hz.

    Nothing that is slow is in it: drifts, wear, scales. So a soft chamber, a slow spool or a delay stand out there beside
    a rest. No balance of the library: the position alone does not show it, and reversals leave more than noise.
    """

    def __init__(self, flow_noise_m3_s: float = 1.0, rate_noise_Pa_s: float = 0.0):
        self.flow_noise_m3_s, self.rate_noise_Pa_s = flow_noise_m3_s, rate_noise_Pa_s

    name = "fast continuity"
    unit = "1"
    caption = "fast part of: valve flow = piston flow + compression of the oil"
    order = 36
    other_names: ClassVar = Continuity.other_names | {Continuity.name: Continuity.caption}

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return () if machine.is_hexapod else (("valve", "pressure_bottom", "acceleration"),)

    def wants(self, log: Log, machine: Machine) -> bool:
        return self.measurable(log, machine) and log.rate >= 3.0 / SHORT_S  # three samples in half a window

    def noise_gains(self, resolved: Resolved) -> Array:
        """In its noise already."""
        return np.ones(1)

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        _, gain, _, _ = channel_settings(resolved_machine(machine), 0, "pressure", "Pa")
        noise = np.hypot(self.flow_noise_m3_s, self.rate_noise_Pa_s * mean_capacity(log, machine) / gain)
        return of_legs(inflow_of, fast_residual_of, log, machine, at) / noise


BALANCES = (Continuity(), TopContinuity())
