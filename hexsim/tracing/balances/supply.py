"""Supply: r_S = P0 - Ps for a constant supply, else the flow that is left over as the pressure that would make it  [Pa].

    r_S = (min((P0 - Ps)/R, Q_max) - q - C dPs/dt) / hypot(slope, C k),   slope = 1/R below Q_max, 0 at it

The divisor is what noise of the pressure makes of the flow, so that neither a vanishing R nor a large C makes any
residual small. k [1/s]: noise of the window's rate over that of its mean.
"""

from __future__ import annotations

import numpy as np

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics.supply import LINE, S, line_capacity
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.balances.balance import Balance, measured_point, resolved_machine

Array = np.ndarray


@compiled
def demands(p, v, x, P1, Ps):
    """Flow that a leg takes from the supply, every sample [m3/s]."""
    flow = np.empty(v.shape[0])
    for i in range(v.shape[0]):
        flow[i] = leg_equations.supply_demand(p, v[i], x[i], P1[i], Ps[i], Ps[i])
    return flow


@compiled
def capacities(s, Ps):
    """Capacity of the accumulator, every sample [m3/Pa]."""
    capacity = np.empty(Ps.shape[0])
    for i in range(Ps.shape[0]):
        capacity[i] = line_capacity(s, Ps[i])
    return capacity


class Supply(Balance):
    """The supply's own balance, with the demand of all legs from measured signals."""

    name = "supply"
    unit = "Pa"
    caption = "supply pressure = what the declared supply gives for the flow taken"
    order = 20
    signals = ("velocity_m_s", "time_s", "valve_V", "position_m", "pressure_bottom_Pa", "acceleration_m_s2")

    def wants(self, log: Log) -> bool:
        return log.supply is not None

    def places(self, log: Log) -> list[str]:
        return ["all legs"]

    def residual(self, log: Log, machine: Machine) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate)
        supply = resolved.supply
        assert log.supply is not None
        Ps = log.supply / resolved.sensors.supply_pressure_gain
        lacking = supply[S.PRESSURE] - Ps
        if supply[S.MODEL] != LINE:
            return window.mean(lacking)[None]
        demand = np.zeros(log.n)
        for i in range(log.n_legs):
            point = measured_point(log, machine, resolved, i)
            if point.P1 is not None:
                demand += demands(resolved.rows[i], point.v, point.x, point.P1, point.Ps)
        delivered, slope = lacking / supply[S.RESISTANCE], np.full(log.n, 1.0 / supply[S.RESISTANCE])
        if supply[S.FLOW_MAX] > 0:
            slope = np.where(delivered < supply[S.FLOW_MAX], slope, 0.0)
            delivered = np.minimum(delivered, supply[S.FLOW_MAX])
        capacity = capacities(supply, window.mean(Ps))
        net = window.mean(delivered - demand) - capacity * window.rate(Ps)
        return (net / np.hypot(window.mean(slope), capacity * window.roughness))[None]


BALANCES = (Supply(),)
