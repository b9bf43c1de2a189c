"""Identification of the valve, per direction: gain, dead band, lag and backlash, from displacements, not velocities.

Oil volume over piston area is z = y + V P1 / (E A1), and z' is the flow through the valve, whatever the load does
(Eq. 3.7). The spool x lags the volts u by tau and follows them through a backlash of half width h. The law of one edge
(Eq. 3.3, 3.4), integrated over a window, is linear in what is unknown:

    z(t2) - z(t1) = k int p R dt - k delta int R dt - k tau R^ [p]_t1^t2,     p = b + h s,     R = sqrt(dp / dp_ref)

R^ is the mean of R, k the velocity gain [m/s/V], delta the half dead band [V], tau the lag [s]. p is the output of the
backlash: b the volts where it last moved along with them, s = -1 where they were rising then, 1 where they were
falling. b is found with the h known so far. It depends on h only where the backlash reverses, so that little is wrong
while h is wrong, and windows gathered before h moved count for less.

Two fits run side by side, without backlash (p = u) and with it. The one with backlash is taken where its h is well
beyond its standard error.

Position noise enters only at the two ends of a window and not at all on the right, so that least squares is unbiased.
Nothing is differentiated. The residual is the noise of two positions if the valve is of this kind, and much more if it
is not: then the fit is rejected.
"""

from __future__ import annotations

import math

from ..arithmetic import clip, push
from ..compiled import compiled
from .piston_leak import tell_piston_leak
from .recursive_least_squares import scale_covariance
from .spool import mean_over_lag
from .valve_edge import (
    ACCEPT_ERRORS,
    MAX_DEAD_BAND_V,
    MIN_BACKLASH_V,
    REJECT_ERRORS,
    backlash_errors,
    edge_variance_m2_s2,
    lag_difference_s,
    restart_backlash_fit,
    restart_edge,
    shift_edge,
    start_edge,
    update_edge,
)

MAX_LAG_OIL_M = 15e-6  # oil at a crossing of the overlap by which the lags of both edges may differ: one spool, one lag
MAX_LAG_OIL_TOLD_M = 2.5e-5  # 1.8 ms: of a leg that has just become ready, two standard errors
MAX_LAG_OIL_PAIR_M = 5e-5  # on a four-way valve under load, whose directions differ by 0.6 ms about the spool's lag
MAX_CROSSING_V_S = 5.5e-3  # overlap times lag up to which a four-way valve's is compensated
NULL_ALPHA, NULL_BETA = 0.08, 0.47  # most with which the null follows, a window; and its rate, of the square of it
NULL_PERIOD = 2.0  # with which it follows, over the windows of the last two half strokes
NULL_ERROR_V, NULL_RATE_V_S, NULL_TICKS = 5e-3, 0.03, 100  # bounds: an error, the rate, ticks between windows
UNKNOWN_LEAK = 3.0  # times the slowest speed of a window, while a leak may move the piston by itself
RESTORED_VARIANCE, RESTORED_COUNT = 1e-5, 50  # of the prior's, of a known edge: 1 mV; windows its residual stands for
CLEAR_V = 0.12  # beyond the other edge of a valve with underlap, from where a single edge pair lets oil through
LONG_LAG_TICKS = 3.0  # from which the volts within a lag are looked at one by one
USABLE_WINDOWS = 8  # from which the gain is right within some per cent


@compiled
def start_valve(valve, tick_s, window, min_speed_m_s, settle, memory):
    """Both directions unknown. window: ticks; min_speed_m_s: mean speed of the piston from which a window counts;
    settle: ticks after the volts change sign in which the spool crosses; memory: windows."""
    valve.tick_s, valve.window, valve.min_speed_m_s, valve.settle = tick_s, window, min_speed_m_s, settle
    valve.side, valve.ticks, valve.leak_ratio = -1.0, 1, 1.0
    start_edge(valve.edges[0], memory)
    start_edge(valve.edges[1], memory)


@compiled
def valve_ready(valve):
    """Whether both directions are known well enough to act on."""
    return valve.edges[0].ready != 0 and valve.edges[1].ready != 0


@compiled
def valve_rejected(valve):
    """Whether a direction had been ready and no longer behaves as identified."""
    down, up = valve.edges[0], valve.edges[1]
    return (down.rejections > 0 and not down.ready) or (up.rejections > 0 and not up.ready)


@compiled
def valve_usable(valve):
    """Whether both directions are known well enough to tell how the piston moves."""
    return valve_ready(valve) or min(valve.edges[0].windows, valve.edges[1].windows) >= USABLE_WINDOWS


@compiled
def lags_agree(valve, told=False):
    """Whether both directions, and the fits without and with backlash, find the lag of one spool.

    Measured as oil at a crossing of the overlap. told: a platform's leg, which the other legs wait for.
    """
    down, up = valve.edges[0], valve.edges[1]
    crossing_m_s = max(down.gain_m_s_V, up.gain_m_s_V) * (down.dead_band_V + up.dead_band_V)
    difference_s = 0.5 * abs(lag_difference_s(down) + lag_difference_s(up))
    most_m = MAX_LAG_OIL_PAIR_M if valve.four_way else (MAX_LAG_OIL_TOLD_M if told else MAX_LAG_OIL_M)
    return crossing_m_s * max(abs(down.lag_s - up.lag_s), difference_s) < most_m


@compiled
def overlap_V(valve):
    """Volts between the edges, negative with underlap."""
    return valve.edges[0].dead_band_V + valve.edges[1].dead_band_V


@compiled
def crossing_in_time(valve):
    """Whether a four-way valve is not both wide and late: across 0.8 V of overlap with 7 ms of lag, 4 of them the
    position's, one direction stayed 1.5 times worse than plain control."""
    return not valve.four_way or overlap_V(valve) * valve.lag_s < MAX_CROSSING_V_S


@compiled
def edges_variance_m2_s2(valve):
    """Variance of where both edges open, as velocities k delta."""
    down, up = valve.edges[0], valve.edges[1]
    return edge_variance_m2_s2(down, valve.with_backlash) + edge_variance_m2_s2(up, valve.with_backlash)


@compiled
def _follow_null(valve, error_m, edge):
    """What a window left over moves the null, and its rate (alpha-beta filter), in half a period and no sooner: within a
    half stroke an error of the lag looks like a null that drifts, and both would wander."""
    share = min(NULL_ALPHA, NULL_PERIOD / (valve.half_windows + valve.last_half_windows))
    off = error_m / (edge.gain_m_s_V * edge.root * valve.window * valve.tick_s)
    off = -valve.direction * clip(off, -NULL_ERROR_V, NULL_ERROR_V)
    since = min(valve.ticks, NULL_TICKS) * valve.tick_s
    valve.ticks = 0
    valve.null_rate_V_s = clip(
        valve.null_rate_V_s + NULL_BETA * share * share * off / since, -NULL_RATE_V_S, NULL_RATE_V_S
    )
    null_V = valve.null_V + share * off + valve.null_rate_V_s * since
    valve.null_V = clip(null_V, -MAX_DEAD_BAND_V, MAX_DEAD_BAND_V)


@compiled
def set_leak(valve, leak_m_s):
    """Takes a leak off the oil displacement, from now on and from what was gathered."""
    change = leak_m_s - valve.leak_m_s
    valve.leak_m_s = leak_m_s
    down, up = valve.edges[0], valve.edges[1]
    shift_edge(up, 0.0, change * valve.leak_ratio)
    shift_edge(down, 0.0, -change * valve.leak_ratio)
    restart_window(valve)
    if abs(change) > 0.25 * valve.min_speed_m_s and not valve.underlap:
        restart_edge(up)
        restart_edge(down)


@compiled
def add_to_valve(valve, z_m, valve_V, root):
    """One tick: oil displacement now less what leaked, volts of the tick past less the null, mean sqrt(dp/dp_ref)
    in it of their edge."""
    valve.ticks += 1
    if valve.four_way:
        push(valve.past_V, valve_V)
    direction = 1 if valve_V > 0.0 else -1
    size = direction * valve_V
    if direction != valve.direction:
        valve.direction, valve.wait = direction, valve.settle
        valve.last_half_windows, valve.half_windows = valve.half_windows, 0
        restart_window(valve)
        return
    edge = valve.edges[1 if direction > 0 else 0]
    if valve.underlap and size < CLEAR_V - valve.edges[0 if direction > 0 else 1].dead_band_V:
        restart_window(valve)
    half = max(edge.fitted_backlash_V, MIN_BACKLASH_V)
    beyond = valve.side * (valve.reversal_V - valve_V)
    if beyond >= 0.0:
        valve.reversal_V = valve_V
    elif beyond < -2.0 * half:
        valve.reversal_V, valve.side = valve_V, -valve.side
    if valve.wait > 0:
        valve.wait -= 1
        return
    through, moved_V = direction * (valve.reversal_V + half * valve.side), 0.0
    if valve.four_way and valve.lag_s > LONG_LAG_TICKS * valve.tick_s:
        moved_V = size - direction * mean_over_lag(valve.past_V, valve.lag_s / valve.tick_s)
    if valve.count:
        valve.across_sum += valve.across_Pa
        s = valve.sums
        s[0] += size * root
        s[1] += root
        if edge.significant:
            s[2] += direction * valve.reversal_V * root
            s[3] += direction * valve.side * root
        else:
            s[2] += size * root
            s[3] += direction * (valve.side + (valve.reversal_V - valve_V) / half) * root
        if valve.count == valve.window:
            _finish_window(valve, edge, z_m, size - moved_V, through - moved_V)
            valve.count = 0
    if valve.count == 0:
        valve.start_m, valve.start_V, valve.start_through_V = z_m, size - moved_V, through - moved_V
        for i in range(4):
            valve.sums[i] = 0.0
        valve.across_sum = 0.0
    valve.count += 1


@compiled
def restart_window(valve):
    """The window in hand and the one before it do not count."""
    valve.count, valve.moving, valve.pending = 0, False, False


@compiled
def _finish_window(valve, edge, z_m, size, through):
    """Use the window before this one, if the piston moved in it, before it and after it.

    So none reaches into the overlap.
    """
    tick = valve.tick_s
    moved = valve.direction * (z_m - valve.start_m)
    slowest = valve.min_speed_m_s if valve.leak_known else UNKNOWN_LEAK * valve.min_speed_m_s
    leak_m_s = valve.leak_m_s * valve.leak_ratio
    travelled = abs(z_m - valve.start_m + leak_m_s * valve.window * tick)  # a leak moves oil at rest, too
    if min(moved, travelled) < slowest * valve.window * tick:
        restart_window(valve)
        return
    if valve.pending:
        down, up = valve.edges[0], valve.edges[1]
        error = update_edge(edge, valve.phi, valve.phi_backlash, valve.moved_m, valve.with_backlash)
        if valve_usable(valve):
            _follow_null(valve, error, edge)
            if valve.differential:
                tell_piston_leak(valve, 1 if valve.direction > 0 else 0, error)
        _decide_backlash(valve, down, up)
        valve.lag_s = (down.lag_s * down.windows + up.lag_s * up.windows) / (down.windows + up.windows)
    valve.across_phi = valve.across_sum * tick
    s = valve.sums
    mean = edge.root = s[1] / valve.window
    valve.phi[0], valve.phi[1], valve.phi[2] = s[0] * tick, -s[1] * tick, (valve.start_V - size) * mean
    valve.phi_backlash[0], valve.phi_backlash[1] = s[2] * tick, -s[1] * tick
    valve.phi_backlash[2], valve.phi_backlash[3] = (valve.start_through_V - through) * mean, s[3] * tick
    valve.moved_m, valve.pending, valve.moving = moved, valve.moving, True
    valve.half_windows += 1


@compiled
def _decide_backlash(valve, down, up):
    """Whether both edges are taken with backlash: where it is well beyond its standard error."""
    if down.windows >= down.windows_needed and up.windows >= up.windows_needed:
        errors = (backlash_errors(down) + backlash_errors(up)) / math.sqrt(2.0)
        found = errors > (REJECT_ERRORS if valve.with_backlash else ACCEPT_ERRORS)
        if found and not valve.with_backlash:
            restart_backlash_fit(down)
            restart_backlash_fit(up)
        valve.with_backlash = found


@compiled
def keep_valve(valve, known):
    """What was identified of both edges, in numbers."""
    known.null_V, known.leak_m_s = valve.null_V, valve.leak_m_s
    _keep_edge(valve.edges[0], known.retract)
    _keep_edge(valve.edges[1], known.extend)


@compiled
def _keep_edge(edge, known):
    for i in range(3):
        known.theta[i] = edge.plain_fit.theta[i]
    for i in range(4):
        known.theta_backlash[i] = edge.backlash_fit.theta[i]
    known.windows, known.ready = edge.windows, edge.ready
    known.gain_m_s_V, known.dead_band_V = edge.gain_m_s_V, edge.dead_band_V
    known.lag_s, known.backlash_V = edge.lag_s, edge.backlash_V


@compiled
def restore_valve(valve, known):
    """Start with what was identified before."""
    down, up = valve.edges[0], valve.edges[1]
    _restore_edge(down, known.retract)
    _restore_edge(up, known.extend)
    valve.null_V, valve.leak_m_s = known.null_V, known.leak_m_s
    valve.leak_known = valve_ready(valve)
    valve.lag_s = 0.5 * (down.lag_s + up.lag_s)
    valve.with_backlash = down.backlash_V > 0.0 or up.backlash_V > 0.0


@compiled
def _restore_edge(edge, known):
    for i in range(3):
        edge.plain_fit.theta[i] = known.theta[i]
    for i in range(4):
        edge.backlash_fit.theta[i] = known.theta_backlash[i]
    if known.ready != 0.0:
        scale_covariance(edge.plain_fit, RESTORED_VARIANCE)
        scale_covariance(edge.backlash_fit, RESTORED_VARIANCE)
        for fit in (edge.plain_fit, edge.backlash_fit):  # one odd window is not enough to reject it
            fit.count, fit.residual = RESTORED_COUNT, edge.noise_m**2
    edge.windows, edge.ready = known.windows, known.ready != 0.0
    edge.gain_m_s_V, edge.dead_band_V = known.gain_m_s_V, known.dead_band_V
    edge.lag_s, edge.backlash_V = known.lag_s, known.backlash_V
