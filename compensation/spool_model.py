"""A spool of second order, exactly: what its data sheet says of it, tick by tick."""

from __future__ import annotations

import math

from .compiled import compiled


@compiled
def free_motion(damping, omega_1_s, t_s):
    """c and s of x'' + 2 zeta w x' + w^2 x = 0 after a time: c = exp(-zeta w t) cos(w_d t), s = exp(-zeta w t) sin(w_d t)/w_d [s],
    w_d = w sqrt(1 - zeta^2); beyond critical damping the same with cosh and sinh."""
    decay, square = damping * omega_1_s, 1.0 - damping * damping
    nearly_critical = 1e-6  # within which 1 - zeta^2 is taken as 0: 1e-6 (w t)^2/6 is off
    if square > nearly_critical:
        wd = omega_1_s * math.sqrt(square)
        size = math.exp(-decay * t_s)
        return size * math.cos(wd * t_s), size * math.sin(wd * t_s) / wd
    if square > -nearly_critical:
        size = math.exp(-decay * t_s)
        return size, size * t_s
    wd = omega_1_s * math.sqrt(-square)
    slow, fast = math.exp(-omega_1_s * omega_1_s / (decay + wd) * t_s), math.exp(-(decay + wd) * t_s)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / wd


@compiled
def set_spool_model(model, lag_s, tick_s, damping):
    """a, b, c, d of one tick of the spool: x += a (u - x) + b w, w = c (u - x) + d w, with w its rate [V/tick]."""
    if lag_s < 0.25 * tick_s:
        model[0], model[1], model[2], model[3] = 1.0, 0.0, 0.0, 0.0
        return
    w = 2 * damping / lag_s
    c, s = free_motion(damping, w, tick_s)
    model[0], model[1] = 1 - (c + damping * w * s), s / tick_s
    model[2], model[3] = w * w * s * tick_s, c - damping * w * s
