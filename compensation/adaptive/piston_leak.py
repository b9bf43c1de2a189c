"""Leak across the piston, from windows after reversals.

    z' = k x R - l P,     P = (P1 - P2) (w1 + w2 / r),     l = L / A1

What is constant of it is a null offset. On a differential cylinder P changes by a hundred bar within some windows after
a reversal. What a window leaves over is compared with the change, by least squares in one unknown,

    e = -(l - l^) int (P - P_mean) dt,     P_mean of the windows of this direction, low-passed

A symmetric cylinder hardly has such a change but by its mass: there it comes slowly, or stays in null and lag.
"""

from __future__ import annotations

from ..arithmetic import clip
from ..compiled import compiled

MEAN_SHARE = 0.05  # low-pass of the mean pressure, a window
MEMORY = 0.995  # of the sum, a window
PRIOR_M_S_PA = 1.6e-10  # standard deviation before anything is known
MAX_LEAK_M_S_PA = 1e-8
MAX_ERROR_M = 5e-5  # that a window is taken to have left over


@compiled
def tell_piston_leak(valve, up, error_m):
    """A window of the direction `up` left `error_m` over, counted in its direction."""
    length_s = valve.window * valve.tick_s
    if valve.across_means[up] == 0.0:
        valve.across_means[up] = valve.across_phi / length_s
    change = valve.across_phi - valve.across_means[up] * length_s
    valve.across_means[up] += MEAN_SHARE * change / length_s
    valve.across_squares = MEMORY * valve.across_squares + change * change
    error_m = clip(error_m, -MAX_ERROR_M, MAX_ERROR_M) * (1.0 if up else -1.0)
    found = valve.across_m_s_Pa - error_m * change / (
        (valve.edges[up].noise_m / PRIOR_M_S_PA) ** 2 + valve.across_squares
    )
    valve.across_m_s_Pa = clip(found, 0.0, MAX_LEAK_M_S_PA)


@compiled
def leaked_across_m_s(valve, across_Pa):
    """Oil that leaks across the piston, as velocity."""
    return valve.across_m_s_Pa * across_Pa
