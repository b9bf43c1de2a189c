"""Force on the moving mass of a bench: r_F = P1 A1 - P2 A2 - m g - m a - F_f(v) + ...  [N].

P2: measured where the rod side is on the valve, else the supply's. Of a cylinder with equal areas the difference of the
pressures does as well; what depends on P1 alone (seals) then sees half of Ps + Pt + (P1 - P2).

Without an accelerometer <w, m a> = m <w'', y>: the position is not differentiated, the window is. Position noise of 3 um
at 1 kHz makes 0.008 m/s2 of it.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from hexsim.compiled import allocating
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics.learned import memories
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.machine.geometry import moving_body, suspension
from hexsim.mechanics.rigid_body import pushed_back
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.balances.balance import (
    Balance,
    MeasuredPoint,
    channel_settings,
    leg_key,
    measured_point,
    resolved_machine,
)
from hexsim.tracing.memory import latest

Array = np.ndarray
OF_FLOW = (  # of a leg's row: no force depends on it
    *range(P.RETURN_RESISTANCE, P.AIR_FRACTION + 1), P.PIPELINE_VOLUME, P.HOSE_COMPLIANCE,
    *range(P.LEAK_SUPPLY_CHAMBER, P.HYSTERESIS_SPREAD + 1), P.RELIEF_CONDUCTANCE, P.RELIEF_OPENS, P.NULL_WARM_UP,
    P.NULL_WARM_UP_TIME, *range(P.WEAR_CONDUCTANCE, P.WEAR_WIDTH + 1),
)  # fmt: skip


@allocating
def forces_beyond_pressure(p, y, v, volts, P1, P2, Ps, t):
    """What acts along the leg besides P1 A1, every sample [N]; the bristle runs along where the leg has one."""
    n = y.shape[0]
    force = np.empty(n)
    memory = memories(p, y, v, volts, P1, Ps, t)
    z = 0.0
    for i in range(n):
        force[i] = leg_equations.force_beyond_pressure(p, y[i], v[i], volts[i], P1[i], P2[i], Ps[i], z, t[i], memory[i])
        if p[P.BRISTLE_STIFFNESS] > 0.0 and i + 1 < n:
            h = (t[i + 1] - t[i]) / 10.0
            stiff = p[P.BRISTLE_STIFFNESS] * abs(v[i]) / leg_equations.friction_level(p, y[i], v[i], P1[i], P2[i], t[i])
            for _ in range(10):
                z += h * leg_equations.bristle_rate(p, y[i], v[i], P1[i], z, P2[i], t[i]) / (1.0 + h * stiff)
    return force


def force_pressures(machine: Machine) -> tuple[tuple[str, ...], ...]:
    """Pressures that a log must hold for the force of a leg, see `Balance.needs`."""
    if machine.cylinder.rod_side != "valve":
        return (("pressure_bottom",),)
    both = ("pressure_bottom", "pressure_top")
    area_bottom, area_top = machine.cylinder.area_bottom_m2, machine.cylinder.area_top_m2
    return (both, ("pressure_difference",)) if np.isclose(area_bottom, area_top, rtol=1e-6) else (both,)


def leg_thrust(p: Array, point: MeasuredPoint) -> Array:
    """Force (n,) [N] of a leg on its load at the measured point."""
    P1, P2 = point.P1, point.P2
    if P1 is None or P2 is None:
        assert point.sensed.difference is not None
        half = 0.5 * (point.Ps + p[P.TANK_PRESSURE])
        P1, P2 = half + 0.5 * point.sensed.difference, half - 0.5 * point.sensed.difference
    return P1 * p[P.AREA_BOTTOM] + forces_beyond_pressure(p, point.y, point.v, point.volts, P1, P2, point.Ps, point.t)


def thrust_key(resolved: Resolved, leg: int) -> Hashable:
    """All of a machine that `leg_thrust` depends on: not the valve, but for a learned force over its volts."""
    learned = resolved.rows[leg, P.LEARNED_BALANCE] != 0.0
    return leg_key(resolved, leg, () if learned else OF_FLOW)


def push_of_payloads(resolved: Resolved, felt: Array, rate: float) -> Array:
    """Force (n,) [N] that payloads on springs push a bench back with; felt: acceleration less gravity (n,)."""
    springs = [suspension(mode, resolved.gravity_m_s2) for mode in resolved.payload_modes]
    pushes = [spring.mass * pushed_back(spring, felt, rate) for spring in springs]
    return np.sum(pushes, axis=0) if pushes else np.zeros(len(felt))


class Force(Balance):
    """Force balance of a bench. A hexapod has the platform balance instead."""

    name = "force"
    unit = "N"
    caption = "pressures − weight − friction = mass times acceleration"
    order = 40
    learned_as = "force"

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return () if machine.is_hexapod else force_pressures(machine)

    def noise_gains(self, resolved: Resolved) -> Array:
        """The pressures make about half of it, the speed by friction the other."""
        return np.sqrt(np.array([channel_settings(resolved, 0, "pressure", "Pa")[1]]))

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate, at=at)
        point, p = measured_point(log, machine, resolved, 0), resolved.rows[0]
        thrust = latest(log, "thrust", thrust_key(resolved, 0), lambda: leg_thrust(p, point))
        mass, gravity = moving_body(resolved, log.loaded).mass, -resolved.gravity_m_s2[2]
        shown = point.sensed.acceleration
        felt = gravity + (shown if shown is not None else Window(log.rate).second_rate(point.y))
        inertia = window.mean(mass * felt) if shown is not None else mass * felt[at]
        return (window.mean(thrust - push_of_payloads(resolved, felt, log.rate)) - inertia)[None]


BALANCES = (Force(),)
