"""The motion that is demanded of the leg, from now to the end of what the inverse looks at, planned anew each tick.

    y = r - lag,   lag' = (1 - g) r' - D(Kp lag),   v = g r' + D(Kp lag)         midpoint rule

r is the setpoint, D the speed that volts give through the identified valve. Where nothing is compensated, g = 0 and D has the dead
band, softened: the motion that plain control makes but for its bumps, so that the volts come in without a step. Then D loses its
dead band and g rises to 1: the leg follows the setpoint itself.

What the loop's model leaves out of plain control's lag (setpoint filter, imperfect feed-forward, computing delay) goes with the speed
and is measured: where plain control acts, r above is r - c r', c being what brings the demanded motion to the piston.

The platform's load at the leg follows what all legs' setpoints ask for: a = a_r - b,  b' = (1 - g) a_r' - b (mean of D' Kp).
"""

from __future__ import annotations

from math import sqrt

from ..compiled import compiled
from ..prediction import MAX_LOOK, predict, watch_setpoint
from .inverse import AHEAD
from .layout import QUEUE
from .leg import (
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    GAIN_DN,
    GAIN_UP,
    HOLD,
    MASS,
    PLAY,
    POSITION_LAG,
    S_A1,
    S_A2,
    S_FLOW,
    S_FOUR_WAY,
    S_TANK,
)  # fmt: skip

LATE_S = 4.0  # in which the lateness is forgotten: two periods of a sine of 0.5 Hz
USUAL_m_s = 0.05  # of a sine of 0.02 m at 0.5 Hz
MOST_LATE_S = 0.5  # what is later than this is no follower of the setpoint


@compiled
def gains(s):
    """Speed of a volt up and down, beyond the dead band."""
    n, sheet = s.numbers, s.sheet
    if n[MASS] == 0.0:
        return s.settings.velocity_gain_m_s_V, s.settings.velocity_gain_m_s_V
    a1, supply = sheet[S_A1], s.past.supply_mean_Pa
    four = sheet[S_FOUR_WAY] != 0.0
    up, down = _roots(n, sheet, supply, four, sheet[S_A2] / a1)
    return sheet[S_FLOW] * n[GAIN_UP] * up / a1, sheet[S_FLOW] * n[GAIN_DN] * down / a1


@compiled
def _roots(n, sheet, supply, four, ratio):
    """Roots of the pressure drop across the open edge, up and down, at the held force and Coulomb friction."""
    a1, tank = sheet[S_A1], sheet[S_TANK]
    up_N, dn_N = n[HOLD] + n[COULOMB_UP], n[HOLD] - n[COULOMB_DN]
    if four:  # Q2 = ratio Q1 through like edges: drops as 1 to ratio^2
        m = 1.0 + ratio * ratio * ratio
        return sqrt(max((supply - tank - up_N / a1) / m, 1.0)), sqrt(
            max((ratio * (supply - tank) + dn_N / a1) / m, 1.0)
        )
    held = ratio * supply
    return sqrt(max(supply - held - up_N / a1, 1.0)), sqrt(max(held + dn_N / a1 - tank, 1.0))


@compiled
def loop_speed(s, lag_m, left, up, down):
    """Speed that the position loop gives at a lag, through the valve with the share `left` of its dead band."""
    n = s.numbers
    volts = s.settings.position_gain_V_per_m * lag_m - left * 0.5 * (n[DEAD_UP] - n[DEAD_DN])
    half = 0.5 * (n[DEAD_UP] + n[DEAD_DN]) + n[PLAY]
    if left > 0.0 and half > 0.0:
        volts *= 1.0 - left * half / sqrt(volts * volts + 4.0 * half * half)
    mean = 0.5 * (up + down)
    return (mean + left * ((up if volts > 0.0 else down) - mean)) * volts


@compiled
def next_lag(s, lag_m, moved_m, share, left, up, down):
    """The lag a tick later, while the setpoint moves on."""
    tick_s = s.settings.tick_s
    half = lag_m + 0.5 * ((1.0 - share) * moved_m - tick_s * loop_speed(s, lag_m, left, up, down))
    return lag_m + (1.0 - share) * moved_m - tick_s * loop_speed(s, half, left, up, down)


@compiled
def _ahead(preview, look, bend):
    """Entry `look` of a preview, beyond its end with the last slope and second difference `bend`."""
    n = len(preview)
    if look < n:
        return preview[look]
    k = look - n + 1
    return preview[n - 1] + k * (preview[n - 1] - preview[n - 2]) + 0.5 * k * (k + 1) * bend


@compiled
def plan_setpoints(s, table, preview):
    """Setpoints of the ticks from now on, where nobody gives them as they are predicted. Returns whether they are."""
    ref, n = s.reference, len(preview)
    middle = (n - 1) // 2
    bend = preview[0] - 2.0 * preview[middle] + preview[2 * middle]
    if ref.count == 0:
        ref.setpoint_m[:] = preview[0]
        ref.count, ref.behind_m, ref.behind_two_m = 1, preview[0], preview[0]
    else:
        ref.behind_two_m, ref.behind_m = ref.behind_m, ref.setpoint_m[0]
    for j in range(QUEUE - 1):
        ref.setpoint_m[j] = ref.setpoint_m[j + 1]
    if not watch_setpoint(s.prediction, n if 2 * n >= AHEAD else 1, bend, preview[0]):  # half a window is a future
        last_bend = preview[n - 1] - 2.0 * preview[n - 2] + preview[n - 3] if n > 2 else 0.0
        for j in range(QUEUE):
            ref.setpoint_m[j] = _ahead(preview, j, last_bend)
        return False
    _, here, after = predict(s.prediction, table, MAX_LOOK, preview[0])
    ref.setpoint_m[MAX_LOOK] = here
    for j in range(MAX_LOOK + 1, QUEUE):
        here, after = after, 2.0 * after - here + s.prediction.acceleration_m
        ref.setpoint_m[j] = here
    return True


@compiled
def _on_setpoint(s, j):
    """How far the motion is the setpoint's own, j ticks on: the plan knows that it moves on. At constant speed, and without a jerk."""
    linear = min(max(s.linear + j * s.linear_step, 0.0), 1.0)
    return linear, linear * linear * (3.0 - 2.0 * linear)


@compiled
def shares(s, j):
    """Share g of the setpoint's speed and of the dead band that is left, j ticks on."""
    linear, g = _on_setpoint(s, j)
    return (g if s.settings.controller_feeds_forward == 0.0 else 1.0), 1.0 - linear


@compiled
def watch_lateness(s, position_m):
    """What plain control's motion lags by beyond the loop's model [s]: a slope over the setpoint's speed, by least squares. It is taken
    where the setpoint turns: there it moves nothing. It begins with USUAL_m_s seen without lateness, which is forgotten like the rest."""
    ref, tick_s = s.reference, s.settings.tick_s
    speed = (ref.setpoint_m[1] - ref.behind_m) / (2.0 * tick_s)
    if s.share == 0.0 and s.linear == 0.0:
        ahead = ref.position_m[0] + ref.late_s * speed - position_m - s.numbers[POSITION_LAG] * ref.velocity_m_s[0]
        share = tick_s / LATE_S
        ref.late_sums[0] += share * (ahead * speed - ref.late_sums[0])
        ref.late_sums[1] += share * (speed * speed - ref.late_sums[1])
        if speed * ref.speed_m_s <= 0.0:
            ref.late_s = min(max(ref.late_sums[0] / ref.late_sums[1], -MOST_LATE_S), MOST_LATE_S)
    ref.speed_m_s = speed


@compiled
def _follow(s):
    """The setpoints less what plain control lags by beyond the loop's model, as far as plain control still acts: from the tick before
    on, all by what is known now, so that their differences are those of one motion."""
    ref = s.reference
    before = ref.behind_two_m
    for j in range(-1, QUEUE):
        here = ref.setpoint_m[j] if j >= 0 else ref.behind_m
        after = ref.setpoint_m[j + 1] if j + 1 < QUEUE else 2.0 * here - before
        left = 1.0 - _on_setpoint(s, j)[1]
        ref.followed_m[j + 1] = here - left * ref.late_s * (after - before) / (2.0 * s.settings.tick_s)
        before = here


@compiled
def plan_motion(s, loads, predicted):
    """Position, speed and load of the ticks from now on."""
    ref, tick_s = s.reference, s.settings.tick_s
    up, down = gains(s)
    _follow(s)
    lag, before = ref.lag_m, ref.followed_m[0]
    for j in range(QUEUE):
        share, left = shares(s, j)
        here = ref.followed_m[j + 1]
        after = ref.followed_m[j + 2] if j + 1 < QUEUE else 2.0 * here - before
        ref.position_m[j] = here - lag
        ref.velocity_m_s[j] = share * (after - before) / (2.0 * tick_s) + loop_speed(s, lag, left, up, down)
        lag = next_lag(s, lag, after - here, share, left, up, down)
        if j == 0:
            ref.lag_m = lag
        before = here
    ref.extra_m_s2[:] = 0.0
    if len(loads) < 3 or predicted:
        ref.load_lag_m_s2, ref.loaded = 0.0, 0
        return
    decay = 0.5 * s.settings.position_gain_V_per_m * (up + down) * tick_s
    # a second difference is not known at the first setpoint: of this tick it is what the last one saw ahead
    load_lag, here = ref.load_lag_m_s2, ref.load_m_s2 if ref.loaded else loads[0]
    ref.load_m_s2, ref.loaded = loads[1], 1
    for j in range(QUEUE - 1):
        after, share = _ahead(loads, j + 1, 0.0), shares(s, j)[0]
        load = here - load_lag
        load_lag += (1.0 - share) * (after - here) - decay * load_lag
        if j == 0:
            ref.load_lag_m_s2 = load_lag
        own = s.settings.own_mobility * (ref.velocity_m_s[j + 1] - ref.velocity_m_s[j]) / tick_s
        ref.extra_m_s2[j] = 0.5 * (load + after - load_lag) - own
        here = after
