"""Leak of the valve: oil that flows into the chamber while both edges are closed, from passages over the overlap.

A leak shifts the edges that the windows see, in volts, as a null offset does. Only while the valve is closed do the two
part: with the edges as the windows see them, a passage moves q T more oil than it should, T the time between the edges,
whatever the speed. A laminar leak goes with its drop, as R^2 of its edge: q = l R^2, from the supply where l > 0, to the
tank where l < 0. l is what is identified, the leak at the reference drop.
"""

from __future__ import annotations

import math

from ..compiled import compiled
from .valve import set_leak

LEAK_PRIOR_M_S = 8e-3  # standard deviation before anything is known
MAX_LEAK_M_S = 2e-2  # a passage with more is something else
LEAK_TOLERANCE_M_S, LEAK_CHANGE_M_S = 2e-4, 5e-5  # a smaller one, and a smaller change, is not taken into account
LEAK_MEMORY, LEAK_PASSAGES = 15.0, 2  # passages; and how many must have been seen
LEAK_ERRORS = 4.0  # standard errors from which there is a leak; half of them to stay
NONE_YET_M = 1e9  # more than any passage: none has begun
MISFIT_SHARE = 0.2  # low-pass of the misfit
INCONSISTENT = 5.0  # standard errors by which a passage contradicts the ones before it: then it is the first
MAX_RESTARTS = 2  # more is another cause


@compiled
def start_leak(leak):
    """Nothing is known."""
    leak.leak_m_s, leak.variance, leak.passages, leak.misfit = 0.0, LEAK_PRIOR_M_S**2, 0, 1.0
    leak.positive, leak.excess_m, leak.closed_s, leak.restarts = False, NONE_YET_M, 0.0, 0


@compiled
def leak_known(leak):
    """Whether it is known well enough to look at what else a passage tells."""
    return leak.passages >= LEAK_PASSAGES


@compiled
def restore_leak(leak, leak_m_s):
    """Start with what was identified before."""
    leak.leak_m_s, leak.variance, leak.passages = leak_m_s, 0.01 * LEAK_PRIOR_M_S**2, LEAK_PASSAGES


@compiled
def start_passage(leak, positive):
    """The spool is on the straight part of an edge."""
    leak.positive, leak.excess_m, leak.closed_s = positive, 0.0, 0.0


@compiled
def add_to_passage(leak, excess_m, closed_s):
    """Oil beyond what sharp edges let through, in a part of the passage."""
    leak.excess_m += excess_m
    leak.closed_s += closed_s


@compiled
def finish_passage(leak, positive, taken_m_s, variance_m2_s2=0.0, ratio=1.0):
    """The spool is on a straight part again; `taken_m_s` is the leak taken off already, `variance_m2_s2` that of the
    edges which the passage is held against, `ratio` R^2. True if the leak that is taken off must change."""
    excess_m, closed_s, across = leak.excess_m, ratio * leak.closed_s, positive != (leak.positive != 0)
    start_passage(leak, positive)
    if not across or closed_s == 0.0 or not abs(excess_m) < MAX_LEAK_M_S * abs(closed_s):
        return False
    error = excess_m / closed_s + taken_m_s - leak.leak_m_s
    expected = (leak.noise_m / closed_s) ** 2 + variance_m2_s2 / (ratio * ratio)
    total = expected + leak.variance
    if leak.restarts < MAX_RESTARTS and error * error > INCONSISTENT**2 * total:
        # what was gathered was made with edges that have moved since
        leak.leak_m_s, leak.variance, leak.passages, leak.misfit = leak.leak_m_s + error, expected, 1, 1.0
        leak.restarts += 1
        return False
    leak.passages += 1
    leak.misfit += MISFIT_SHARE * (error * error / total - leak.misfit)
    share = leak.variance / total
    leak.leak_m_s += share * error
    leak.variance = min(leak.variance * (1.0 - share) * (1.0 + share / LEAK_MEMORY), LEAK_PRIOR_M_S**2)
    found = used_leak_m_s(leak, taken_m_s)
    return leak_known(leak) and abs(found - taken_m_s) > LEAK_CHANGE_M_S


@compiled
def skip_passage(leak, positive):
    """A passage over an overlap that is too narrow to tell: what leaks is left in the null offset."""
    leak.passages += positive != (leak.positive != 0)
    start_passage(leak, positive)
    return False


@compiled
def leak_ratio(valve, roots):
    """R^2 of the drop that the leak goes over. roots: sqrt(dp/dp_ref) to the tank and from the supply; 1 on a four-way valve."""
    return 1.0 if valve.four_way else roots[1 if valve.leak_m_s >= 0.0 else 0] ** 2


@compiled
def leak_at_m_s(valve, roots):
    """Oil that leaks into the chamber at this drop, as velocity [m/s]."""
    return valve.leak_m_s * leak_ratio(valve, roots)


@compiled
def follow_leak(valve, roots):
    """Oil that leaks into the chamber now, as velocity; the valve's own windows take it at the same drop."""
    valve.leak_ratio = leak_ratio(valve, roots)
    return valve.leak_m_s * valve.leak_ratio


@compiled
def tell_leak(leak, valve):
    """Has the valve's identification take the leak off."""
    valve.leak_known, leak_m_s = leak_known(leak), used_leak_m_s(leak, valve.leak_m_s)
    if leak_known(leak) and abs(leak_m_s - valve.leak_m_s) > LEAK_CHANGE_M_S:
        set_leak(valve, leak_m_s)


@compiled
def used_leak_m_s(leak, taken_m_s):
    """The leak to take off [m/s]: 0 where there may be none."""
    errors = LEAK_ERRORS if taken_m_s == 0.0 else 0.5 * LEAK_ERRORS
    sure = abs(leak.leak_m_s) > errors * math.sqrt(leak.variance * max(1.0, leak.misfit)) + LEAK_TOLERANCE_M_S
    return leak.leak_m_s if sure else 0.0
