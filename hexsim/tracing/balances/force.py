"""Force on the moving mass of a bench: r_F = P1 A1 - Ps A2 - m g - m a - F_f(v) + ...  [N]."""

from __future__ import annotations

import numpy as np
from scipy.signal import bilinear, lfilter

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import PayloadMode
from hexsim.signals.log import MeasuredLog
from hexsim.signals.weak_form import Window
from hexsim.tracing.balances.balance import measured_point, resolved_machine

Array = np.ndarray


@compiled
def forces_beyond_pressure(p, y, v, volts, P1, Ps, t):
    """What acts along the leg besides P1 A1, every sample [N]; the bristle runs along where the leg has one."""
    n = y.shape[0]
    force = np.empty(n)
    z = 0.0
    for i in range(n):
        force[i] = leg_equations.force_beyond_pressure(p, y[i], v[i], volts[i], P1[i], Ps[i], Ps[i], z, t[i])
        if p[P.BRISTLE_STIFFNESS] > 0.0 and i + 1 < n:
            h = (t[i + 1] - t[i]) / 10.0
            stiff = p[P.BRISTLE_STIFFNESS] * abs(v[i]) / leg_equations.friction_level(p, y[i], v[i], P1[i])
            for _ in range(10):
                z += h * leg_equations.bristle_rate(p, y[i], v[i], P1[i], z) / (1.0 + h * stiff)
    return force


def on_spring(mode: PayloadMode, felt: Array, rate: float) -> Array:
    """Specific force (n,) [m/s2] that a payload on a spring and damper gives back when its foot feels `felt` (n,).

    (2 zeta w p + w^2)/(p^2 + 2 zeta w p + w^2) by the bilinear rule (0.1 % off in frequency at 17 Hz and 1 kHz), steady at
    first. felt: acceleration less gravity, along the spring.
    """
    omega = 2 * np.pi * mode.frequency_Hz
    damper = 2 * mode.damping_ratio * omega
    top, bottom = bilinear([damper, omega**2], [1.0, damper, omega**2], rate)
    return lfilter(top, bottom, felt - felt[0]) + felt[0]


class Force:
    """Force balance of a bench. A hexapod has the platform balance instead."""

    name = "force"
    unit = "N"

    def wants(self, log: MeasuredLog) -> bool:
        return log.n_legs == 1 and log.pressure is not None and log.acceleration is not None

    def places(self, log: MeasuredLog) -> list[str]:
        return ["leg 1"]

    def residual(self, log: MeasuredLog, machine: Machine) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate)
        point, p = measured_point(log, machine, resolved, 0), resolved.rows[0]
        assert point.P1 is not None and point.sensed.acceleration is not None
        beyond = forces_beyond_pressure(p, point.y, point.v, point.volts, point.P1, point.Ps, point.t)
        mass, gravity = resolved.load.moving_mass_kg, -resolved.gravity_m_s2[2]
        net = point.P1 * p[P.AREA_BOTTOM] + beyond - mass * (point.sensed.acceleration + gravity)
        for mode in resolved.payload_modes:
            net = net - mode.mass_kg * on_spring(mode, point.sensed.acceleration + gravity, log.rate)
        return window.mean(net)[None]
