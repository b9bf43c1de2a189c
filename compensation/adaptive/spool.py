"""The spool as the algorithm takes it, and what its lag asks of the taps.

The spool is second order with the damping of the data sheet, so that one number is to be found, its lag
tau = 2 zeta / omega [s].
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import compiled
from .arithmetic import clip
from .layout import MAX_SHIFT, PATH_BEFORE, PATH_FINE

NEARLY_CRITICAL = 1e-6  # of 1 - zeta^2, within which it is taken as 0: 1e-6 (w t)^2/6 is off
LAG_STEP_S = 1e-5  # lags are rounded to this before a design is made
LAG_MAX_S = 1.4e-2
SHIFT_TICKS = 2.2  # of lag that LEAD_TICKS are enough for


@compiled
def free_motion(damping, omega_1_s, t_s):
    """c and s of x'' + 2 zeta w x' + w^2 x = 0 after a time: c = exp(-zeta w t) cos(w_d t), s = exp(-zeta w t) sin(w_d t)/w_d [s],
    w_d = w sqrt(1 - zeta^2); beyond critical damping the same with cosh and sinh."""
    decay, square = damping * omega_1_s, 1.0 - damping * damping
    if square > NEARLY_CRITICAL:
        wd = omega_1_s * math.sqrt(square)
        size = math.exp(-decay * t_s)
        return size * math.cos(wd * t_s), size * math.sin(wd * t_s) / wd
    if square > -NEARLY_CRITICAL:
        size = math.exp(-decay * t_s)
        return size, size * t_s
    wd = omega_1_s * math.sqrt(-square)
    slow, fast = math.exp(-omega_1_s * omega_1_s / (decay + wd) * t_s), math.exp(-(decay + wd) * t_s)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / wd


@compiled
def step_response(t_s, lag_s, delay_s, damping):
    """Unit step response of the spool at a time, zero before 0."""
    t_s, lag_s = t_s - delay_s, lag_s - delay_s
    if t_s < 0.0:
        return 0.0
    if lag_s <= 0.0:
        return 1.0
    w = 2 * damping / lag_s
    c, s = free_motion(damping, w, t_s)
    return 1 - (c + damping * w * s)


@compiled
def mean_over_lag(past, ticks):
    """Mean of the newest `ticks` of a history: what a delay of them has not let through yet, over it. The newest value alone
    leaves the second order, lag^2/2 u': compensated volts made it 15 um a window at 7 ms, and the valve was rejected."""
    ticks = min(ticks, len(past) - 1.0)
    whole = int(ticks)
    total = (ticks - whole) * past[whole]
    for i in range(whole):
        total += past[i]
    return total / ticks


@compiled
def round_lag(lag_s):
    """Lag [s] on the grid that filters are designed for."""
    return clip(np.rint(lag_s / LAG_STEP_S) * LAG_STEP_S, 0.0, LAG_MAX_S)


@compiled
def look_ahead_shift(lag_s, tick_s):
    """Ticks by which the taps lie earlier, for a lag."""
    return min(max(math.ceil(lag_s / tick_s - SHIFT_TICKS), 0), MAX_SHIFT)


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


@compiled
def blocked_flow(path, share, slope_V, half_V):
    """Flow that the overlap blocks while the spool crosses it, before and after the reversal, as volts of one tick.

    path: of the crossing; share: of its tick that lies before the reversal (0 .. 1): so much of the step comes a tick
    later; slope_V: volts by which the demanded flow grows in a tick; half_V: half dead band. Signed like the slope.
    """
    before = after = 0.0
    for i in range(PATH_FINE, len(path)):
        time = (i + 0.5) / PATH_FINE - PATH_BEFORE - share
        demanded = slope_V * time
        spool = demanded + half_V * (path[i] + share * (path[i - PATH_FINE] - path[i]))
        through = spool - half_V if spool > half_V else (spool + half_V if spool < -half_V else 0.0)
        if time < 0.0:
            before += demanded - through
        else:
            after += demanded - through
    return before / PATH_FINE, after / PATH_FINE
