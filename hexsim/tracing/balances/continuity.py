"""Continuity of the bottom chamber: r_Q = phi(u, P1, Ps) - A1 v - C(y, P1) dP1/dt  [m3/s], Eq. 3.7 rearranged."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics.parameters import P
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.balances.balance import Balance, MeasuredPoint, measured_point, resolved_machine

Array = np.ndarray


@compiled
def inflows(p, y, v, volts, x, P1, Ps, t):
    """phi of every sample [m3/s]."""
    flow = np.empty(y.shape[0])
    for i in range(y.shape[0]):
        flow[i] = leg_equations.inflow(p, y[i], v[i], volts[i], x[i], P1[i], Ps[i], t[i])
    return flow


@compiled
def capacities(p, y, P1):
    """Hydraulic capacity of every sample [m3/Pa]."""
    capacity = np.empty(y.shape[0])
    for i in range(y.shape[0]):
        capacity[i] = leg_equations.chamber_capacity(p, y[i], P1[i])
    return capacity


def residual_of(p: Array, point: MeasuredPoint, window: Window) -> Array:
    """Net inflow, less what the piston sweeps, less what compresses, under the window (n,) [m3/s]."""
    assert point.P1 is not None
    flow = inflows(p, point.y, point.v, point.volts, point.x, point.P1, point.Ps, point.t)
    sensed = point.sensed
    y, P1 = sensed.mean_y, sensed.mean_P1
    capacity = capacities(p, y, P1)
    about = point.P1 - P1.mean()
    compression = window.rate(capacity * about) - window.mean(np.gradient(capacity, window.dt) * about)
    return window.mean(flow) - p[P.AREA_BOTTOM] * sensed.mean_v - compression


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

    def wants(self, log: Log) -> bool:
        return log.volts is not None and log.pressure is not None

    def places(self, log: Log) -> list[str]:
        return [f"leg {i + 1}" for i in range(log.n_legs)]

    def reported_as(self, signal: str) -> str:
        return "valve" if signal == "valve_V" else self.name

    def residual(self, log: Log, machine: Machine) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate)
        return np.stack(
            [
                residual_of(resolved.rows[i], measured_point(log, machine, resolved, i), window)
                for i in range(log.n_legs)
            ]
        )


BALANCES = (Continuity(),)
