"""Reference of the feed-forward, PREVIEW_TICKS ahead: it lets the feed-forward come in without a jerk.

    y_m' = g r' + s D(Kp (r - y_m) - (1 - h) n) + (1 - h) q
    D(w) = w - (1 - h) delta w / sqrt(w^2 + (SOFTNESS delta)^2);   midpoint rule

r is the setpoint, n the valve's null, q the velocity that a leak gives, delta the valve's half dead band, s its gain,
g the share of the feed-forward, h that of the dead-band compensation. With g = h = 0 this is the motion that the position
loop makes of the setpoint through the uncompensated valve, but for the standstill at a reversal, which it passes
smoothly. So engaging in the midst of a stroke hardly changes the motion. h then rises to 1: no dead band. So does g, in
motion with small turns once the compensation is trusted (trust.py). With g = 1 y_m = r: full velocity feed-forward.

The load a of the pressure is y_m''. A leg of a platform is told what the setpoints of all legs give it, a_r; the other
legs lag like this one:

    a' = g a_r' + w (a_r - a),     w the mean of s Kp over both directions
"""

from __future__ import annotations

from math import sqrt

from ..compiled import compiled

NO_LAG_M = 1e-9  # lag that counts as none once the feed-forward is all in
SOFTNESS = 2.0  # half dead bands about zero within which D is softened
SOFTNESS_UNDERLAP = 1.0  # of a negative one: the gain is twice as high where both edges are open


@compiled
def advance_reference(reference, behind_m, here_m, ahead_m):
    """One tick on; setpoints at the boundary before, at the one asked for, and after."""
    tick, share, lag = reference.tick_s, reference.feed_forward, reference.lag_m
    if share == 1.0 and -NO_LAG_M < lag < NO_LAG_M:
        lag = loop_m_s = 0.0
    else:
        moved = (1.0 - share) * (here_m - behind_m)
        half = lag + 0.5 * (moved - tick * _loop_m_s(reference, lag))
        lag += moved - tick * _loop_m_s(reference, half)
        loop_m_s = _loop_m_s(reference, lag)
    reference.lag_m, reference.position_m = lag, here_m - lag
    velocity = share * (ahead_m - behind_m) / (2 * tick) + loop_m_s
    reference.acceleration_m_s2 = (velocity - reference.velocity_m_s) / tick
    reference.velocity_m_s = velocity
    _advance_load(reference)


@compiled
def expect_load(reference, loads_m_s2, look):
    """For the next step: what all legs' setpoints give this leg to carry, of this tick and the next (n,); of none: y_m''."""
    before, reference.load_given = reference.load_given, 1 if len(loads_m_s2) > look else 0
    if reference.load_given == 1:
        asked = loads_m_s2[look]
        reference.load_lag_m_s2 += (1.0 - reference.feed_forward) * (asked - reference.expected_m_s2) if before else 0.0
        reference.expected_m_s2 = asked


@compiled
def _advance_load(reference):
    if reference.load_given != 1:
        reference.load_m_s2, reference.load_given = reference.acceleration_m_s2, 0
        return
    reference.load_given = 2
    decay = 0.5 * reference.tick_s * (reference.loop_1_s[0] + reference.loop_1_s[1])
    reference.load_lag_m_s2 *= 1.0 - decay
    reference.load_m_s2 = reference.expected_m_s2 - reference.load_lag_m_s2


@compiled
def _loop_m_s(reference, lag_m):
    """Velocity that the position loop gives at a lag."""
    left = 1.0 - reference.linear
    lag_m -= left * reference.null_m
    up = 1 if lag_m > 0.0 else 0
    dead_band = reference.dead_band_m[up]
    if dead_band != 0.0 and left != 0.0:
        soft = (SOFTNESS if dead_band > 0.0 else SOFTNESS_UNDERLAP) * dead_band
        lag_m *= 1.0 - left * dead_band / sqrt(lag_m * lag_m + soft * soft)
    return reference.loop_1_s[up] * lag_m + left * reference.leak_m_s
