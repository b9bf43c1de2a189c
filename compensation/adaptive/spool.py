"""The spool as the algorithm takes it, and what its lag asks of the taps.

The spool is second order with the damping of the data sheet, so that one number is to be found, its lag
tau = 2 zeta / omega [s].
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic import clip
from ..compiled import compiled
from ..spool_model import free_motion
from .layout import MAX_SHIFT, PATH_BEFORE, PATH_FINE

LAG_STEP_S = 1e-5  # lags are rounded to this before a design is made
LAG_MAX_S = 1.4e-2
SHIFT_TICKS = 2.2  # of lag that LEAD_TICKS are enough for


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
