"""Supply: what it gives for the flow taken, against the measured supply pressure  [Pa].

    constant     r_S = P0 - Ps
    line         r_S = (min((P0 - Ps)/R, Q_max) - q - C dPs/dt) / hypot(slope, C k),  slope 1/R below Q_max, 0 at it
    power unit   r_S = Ps - that of the unit's own equations under the flow q

The divisor is what noise of the pressure makes of the flow: neither a vanishing R nor a large C makes the residual small.
k [1/s]: noise of the window's rate over that of its mean. q is the demand of all legs at the measured point. A rod side
on the valve whose pressure is not measured is taken at Ps + Pt - P1, as between matched edges.
"""

from __future__ import annotations

import numpy as np

from hexsim.compiled import allocating, compiled
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.steps import STEP
from hexsim.hydraulics.supply import LINE, POWER_UNIT, S, line_capacity, power_unit_rates, pump_flow_command
from hexsim.signals.log import Log
from hexsim.signals.weak_form import HALF_WIDTH_S, Window
from hexsim.tracing.balances.balance import Balance, measured_point, resolved_machine

Array = np.ndarray


@allocating
def demands(p, y, v, x, P1, P2, Ps):
    """Flow that a leg takes from the supply, every sample [m3/s]."""
    flow = np.empty(v.shape[0])
    for i in range(v.shape[0]):
        flow[i] = leg_equations.supply_demand_in_step(p, y[i], v[i], x[i], P1[i], P2[i], Ps[i])
    return flow


@allocating
def capacities(s, Ps):
    """Capacity of the accumulator, every sample [m3/Pa]."""
    capacity = np.empty(Ps.shape[0])
    for i in range(Ps.shape[0]):
        capacity[i] = line_capacity(s, Ps[i])
    return capacity


@compiled
def moved(a, h, rate):
    """State (6 numbers) of a power unit after h [s] at this rate."""
    return (
        a[0] + h * rate[0], a[1] + h * rate[1], a[2] + h * rate[2], a[3] + h * rate[3], a[4], a[5] + h * rate[5],
    )  # fmt: skip


@allocating
def power_unit_pressures(s, start, demand, dt):
    """Ps [Pa] that a power unit gives for the flow taken (n,) [m3/s], from rest at the pressure `start`. RK4."""
    Ps = np.empty(demand.shape[0])
    steps = max(int(np.ceil(dt / STEP.fastest_law_s)), 1)
    h = dt / steps
    state = (1.0, pump_flow_command(s, 1.0, start), demand[0], start, s[S.START_TEMPERATURE], start)
    for i in range(demand.shape[0]):
        Ps[i] = state[5]
        for _ in range(steps):
            k1 = power_unit_rates(s, state, 1.0, demand[i], 0.0)
            k2 = power_unit_rates(s, moved(state, 0.5 * h, k1), 1.0, demand[i], 0.0)
            k3 = power_unit_rates(s, moved(state, 0.5 * h, k2), 1.0, demand[i], 0.0)
            k4 = power_unit_rates(s, moved(state, h, k3), 1.0, demand[i], 0.0)
            state = moved(moved(moved(moved(state, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4)
    return Ps


def demand_of_all(log: Log, machine: Machine, resolved: Resolved) -> Array:
    """Flow (n,) [m3/s] that the legs take together at the measured point; of a leg without a pressure nothing is known."""
    demand = np.zeros(log.n)
    for i in range(log.n_legs):
        point, row = measured_point(log, machine, resolved, i), resolved.rows[i]
        if point.P1 is not None:
            P2 = point.Ps + row[P.TANK_PRESSURE] - point.P1 if point.P2 is None else point.P2
            demand += demands(row, point.y, point.v, point.x, point.P1, P2, point.Ps)
    return demand


class Supply(Balance):
    """The supply's own balance, with the demand of all legs from measured signals."""

    name = "supply"
    unit = "Pa"
    caption = "supply pressure = what the declared supply gives for the flow taken"
    order = 20
    signals = ("velocity_m_s", "time_s", "valve_V", "position_m", "pressure_bottom_Pa", "acceleration_m_s2")

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return (("pressure_supply",),)

    def places(self, log: Log) -> list[str]:
        return ["all legs"]

    def noise_gains(self, resolved: Resolved) -> Array:
        """Of the supply's transducer."""
        return np.array([resolved.sensors.supply_pressure_gain])

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate, at=at)
        supply = resolved.supply
        assert log.supply is not None
        Ps = log.supply / resolved.sensors.supply_pressure_gain
        lacking = supply[S.PRESSURE] - Ps
        if supply[S.MODEL] not in (LINE, POWER_UNIT):
            return window.mean(lacking)[None]
        demand = demand_of_all(log, machine, resolved)
        if supply[S.MODEL] == POWER_UNIT:
            start = float(Ps[: max(int(HALF_WIDTH_S * log.rate), 4)].mean())
            return window.mean(Ps - power_unit_pressures(supply, start, demand, 1.0 / log.rate))[None]
        delivered, slope = lacking / supply[S.RESISTANCE], np.full(log.n, 1.0 / supply[S.RESISTANCE])
        if supply[S.FLOW_MAX] > 0:
            slope = np.where(delivered < supply[S.FLOW_MAX], slope, 0.0)
            delivered = np.minimum(delivered, supply[S.FLOW_MAX])
        capacity = capacities(supply, window.mean(Ps))
        net = window.mean(delivered - demand) - capacity * window.rate(Ps)
        return (net / np.hypot(window.mean(slope), capacity * window.roughness))[None]


BALANCES = (Supply(),)
