"""Rounding of the valve's edges: how a metering edge that is not sharp leaves the straight line beyond the overlap.

A rounded edge opens as s log(1 + exp((x - delta)/s)), s the rounding in volts, delta the half dead band. Two parts:

The estimator identifies s from the reversals of plain control, before compensation engages. A reversal is two
passages: from where the spool leaves the straight part of its curve (t1) to its middle (t2), and from there to the
straight part of the other side. What a rounded edge lets through beyond a sharp one,

    z(t2) - z(t1) = k int f(x, 0) R dt + q phi,     phi = k int (f(x, s) - f(x, 0)) R dt / s^2,     q = s^2,

goes with the square of s: int (f(x, s) - f(x, 0)) dx = pi^2 q / 6 over both sides of an edge. f(x, s) is the opening, x
the spool by the identified backlash and lag. Plain control passes slowly, so that 10 mV move some 10 to 30 um: a few
reversals suffice, with 5 um of noise. Least squares of q, with its standard error. It also tests the whole valve: a
reversal that moves much less oil than sharp edges would (q well below zero), or another amount each time, is not
explained by the identified gain, dead band, lag and backlash.

The trim corrects an identified s while compensation acts. Its inverse at a speed v needs less than the straight line by

    c(v) = s log(1 - exp(-v / (k s))),     never below -delta

Too large a dead-band compensation moves too much oil on both sides of the reversal, too small a one too little.
"""

from __future__ import annotations

import math

from ..arithmetic import clip
from ..compiled import compiled
from ..spool_model import set_spool_model
from .chambers import pair_flow_m_s
from .layout import TRIM_TICKS
from .leak import add_to_passage, finish_passage, leak_known, skip_passage, start_passage
from .null import both_open
from .spool import round_lag
from .valve import edges_variance_m2_s2, overlap_V, valve_ready, valve_usable

PRIOR_V = 12e-3  # standard deviation of s before anything is known
MAX_ROUNDING_V = 25e-3
STRAIGHT_V = 0.05  # beyond the overlap, from where the curve is straight
PAIR = 4.0  # times these on a four-way valve, whose spool travels less: rounding in volts is wider
LEAST_OVERLAP_V = 0.03  # of both its edges, from which a leak is told from a null offset
MIN_PROBE_V = 5e-3  # phi is computed with the identified rounding, and no less than this
MAX_EXCESS_M = 3e-5  # a passage, or a compensated reversal, with more than this is something else
MAX_EXCESS_ERRORS = 6.0  # or with more than so many standard errors of noise
MAX_PASSAGE_S = 0.5  # so is a passage that takes longer
MEMORY, MEMORY_EARLY = 15.0, 2.0  # passages; the second while the valve itself is being identified
LOWER_ERRORS, LOWER_ERRORS_TOLD, LOWER_ERRORS_PAIR = 3.0, 4.0, 1.0  # standard errors of q from which edges are rounded
UPPER_ERRORS = 2.0  # standard errors of q added for the upper confidence bound
REJECT_ERRORS = 7.0  # standard errors of q below zero at which the identified valve is rejected
MISFIT_SHARE, MAX_MISFIT = 0.2, 3.0  # low-pass of the misfit, and its bound

TRIM_V_M = 60.0  # volts of rounding per metre of excess oil displacement at one reversal: 0.3 mV for 5 um
TRIM_BIAS_M = 1e-6  # of each excess, towards what is identified, so that noise does not add up to a rounding
MIN_ROUNDING_V = 4e-3  # below it edges are taken as sharp


@compiled
def opening(volts, dead_band_V, rounding_V):
    """Opening [V] of the spool at `volts` beyond an overlap with edges rounded so, both edges together: f(x, s)."""
    size = abs(volts)
    if rounding_V == 0.0:
        left = max(size - dead_band_V, 0.0)
    else:
        near, far = (size - dead_band_V) / rounding_V, (-size - dead_band_V) / rounding_V
        left = rounding_V * ((near if near > 30.0 else math.log1p(math.exp(near))) - math.log1p(math.exp(far)))
    return left if volts > 0.0 else -left


@compiled
def start_rounding(rounding, four_way):
    """Nothing is known."""
    rounding.prior_V, rounding.largest_V, rounding.straight_V = PRIOR_V, MAX_ROUNDING_V, STRAIGHT_V
    rounding.lower_errors, rounding.least_probe_V = LOWER_ERRORS, MIN_PROBE_V
    if four_way:
        rounding.prior_V, rounding.largest_V = PAIR * PRIOR_V, PAIR * MAX_ROUNDING_V
        rounding.least_probe_V = PAIR * MIN_PROBE_V
        rounding.straight_V, rounding.lower_errors = PAIR * STRAIGHT_V, LOWER_ERRORS_PAIR
    rounding.variance_V4, rounding.misfit, rounding.lag_s = rounding.prior_V**4, 1.0, -1.0
    rounding.model[0], rounding.probe_V = 1.0, rounding.least_probe_V


@compiled
def disturb_rounding(rounding, told):
    """told: a platform's leg, whose passages other legs disturb."""
    if told and rounding.lower_errors == LOWER_ERRORS:
        rounding.lower_errors = LOWER_ERRORS_TOLD


@compiled
def lower_bound_V(rounding):
    """Lower confidence bound of the rounding [V]; 0 where edges may be sharp."""
    return _root(
        rounding, rounding.square_V2 * clip(rounding.square_V2 / _error(rounding) - rounding.lower_errors, 0.0, 1.0)
    )


@compiled
def upper_bound_V(rounding):
    """Upper confidence bound of the rounding [V]."""
    return _root(rounding, max(rounding.square_V2, 0.0) + UPPER_ERRORS * _error(rounding))


@compiled
def seem_sharp(rounding):
    """Whether no reversal so far speaks of a rounding."""
    return rounding.square_V2 < UPPER_ERRORS * _error(rounding)


@compiled
def reversals_seen(rounding):
    """Whether a reversal was held against the identified valve."""
    return rounding.variance_V4 < rounding.prior_V**4


@compiled
def explains_reversals(rounding):
    """Whether reversals move the oil that the identified valve lets through."""
    return rounding.misfit < MAX_MISFIT**2 and rounding.square_V2 > -REJECT_ERRORS * _error(rounding)


@compiled
def add_to_rounding(rounding, leak, z_m, valve_V, roots, valve, damping):
    """One tick: oil displacement now, volts of the tick past, mean sqrt(dp/dp_ref) in it of the edges;
    damping: of the spool. True when a passage was completed.
    """
    tick_s, before = valve.tick_s, rounding.spool_V
    if valve.lag_s != rounding.lag_s:
        rounding.lag_s = valve.lag_s
        set_spool_model(rounding.model, round_lag(valve.lag_s), tick_s, damping)
    x = _advance_spool(rounding, valve_V, valve.edges[1 if valve_V > 0.0 else 0].backlash_V)
    edge = valve.edges[1 if x > 0.0 else 0]
    straight = abs(x) > abs(edge.dead_band_V) + rounding.straight_V  # with underlap, where the other edge is shut
    if straight and rounding.ticks <= 1:
        start_passage(leak, x > 0.0)
        rounding.ticks, rounding.start_m, rounding.sharp_m, rounding.rounded_m = 1, z_m, 0.0, 0.0
        return False
    if not rounding.ticks:
        return False
    rounding.ticks += 1
    mean = 0.5 * (before + x)
    sharp, rounded = _openings(rounding, mean, valve, edge, roots)
    moved = tick_s if valve.four_way else edge.gain_m_s_V * roots[1 if valve_V > 0.0 else 0] * tick_s
    rounding.sharp_m += moved * sharp
    rounding.closed_ticks += (1 if sharp == 0.0 else 0) - (1 if both_open(valve, mean) else 0)
    rounding.rounded_m += moved * (rounded - sharp)
    if straight or before * x <= 0.0:
        add_to_passage(leak, z_m - rounding.start_m - rounding.sharp_m, rounding.closed_ticks * tick_s)
        judged = straight and valve_usable(valve)
        if judged and _judge_passage(leak, x > 0.0, valve):
            rounding.ticks = rounding.closed_ticks = 0
            return True
        if leak_known(leak) and _may_be_judged(valve):
            open_s = rounding.closed_ticks * tick_s if valve.underlap else 0.0
            unsure_m2 = (edges_variance_m2_s2(valve) + leak.variance) * open_s * open_s
            _update(rounding, z_m, MEMORY if valve_ready(valve) else MEMORY_EARLY, unsure_m2)
        rounding.closed_ticks, rounding.ticks = 0, 1 if straight else 2
        rounding.start_m, rounding.sharp_m, rounding.rounded_m = z_m, 0.0, 0.0
        return True
    if rounding.ticks * tick_s > MAX_PASSAGE_S:
        rounding.ticks = 0
    return False


@compiled
def _may_be_judged(valve):
    """Whether a passage may be held against the valve yet: 5 of 10 ms of lag passed for 89 of 40 mV. Where the spool jumps across an
    overlap and on a differential cylinder early ones count as well, which edges and lag say less of."""
    return valve_ready(valve) or valve.differential or not told_while_compensated(valve)


@compiled
def told_while_compensated(valve):
    """Whether compensated passages tell the rounding too: not where the spool jumps across an overlap."""
    return valve.four_way and overlap_V(valve) < LEAST_OVERLAP_V


@compiled
def jumps(valve):
    """Whether a four-way valve's spool jumps across an overlap."""
    return valve.four_way and not told_while_compensated(valve)


@compiled
def _openings(rounding, volts, valve, edge, roots):
    """Sharp and rounded: openings [V], or of a four-way valve what both edge pairs let through [m/s]."""
    if valve.four_way:
        sharp = pair_flow_m_s(volts, valve.edges, roots, 0.0)
        return sharp, pair_flow_m_s(volts, valve.edges, roots, rounding.probe_V)
    return opening(volts, edge.dead_band_V, 0.0), opening(volts, edge.dead_band_V, rounding.probe_V)


@compiled
def _judge_passage(leak, positive, valve):
    """True if the leak that is taken off must change."""
    if valve.four_way and not valve.underlap and overlap_V(valve) < LEAST_OVERLAP_V and valve.leak_m_s == 0.0:
        return skip_passage(leak, positive)
    return finish_passage(leak, positive, valve.leak_m_s, edges_variance_m2_s2(valve), valve.leak_ratio)


@compiled
def restore_rounding(rounding, rounding_V):
    """Start with what was identified before."""
    rounding.square_V2, rounding.variance_V4 = rounding_V**2, 0.01 * rounding.prior_V**4


@compiled
def _root(rounding, square_V2):
    return min(math.sqrt(square_V2), rounding.largest_V) if square_V2 > 0.0 else 0.0


@compiled
def _error(rounding):
    return math.sqrt(rounding.variance_V4)


@compiled
def _advance_spool(rounding, volts, backlash_V):
    """The spool at the end of a tick of these volts."""
    m = rounding.model
    rounding.backlash_V = clip(rounding.backlash_V, volts - backlash_V, volts + backlash_V)
    away = rounding.backlash_V - rounding.spool_V
    rounding.spool_V += m[0] * away + m[1] * rounding.rate_V
    rounding.rate_V = m[2] * away + m[3] * rounding.rate_V
    return rounding.spool_V


@compiled
def _update(rounding, z_m, memory, unsure_m2):
    """A passage in: one step of least squares with forgetting. unsure_m2: variance that edges and leak give it."""
    phi = rounding.rounded_m / rounding.probe_V**2
    excess = z_m - rounding.start_m - rounding.sharp_m - phi * rounding.square_V2
    if abs(excess) > max(MAX_EXCESS_M, MAX_EXCESS_ERRORS * rounding.noise_m) + abs(phi) * rounding.largest_V**2:
        return
    expected = rounding.noise_m**2 + unsure_m2 + phi * rounding.variance_V4 * phi
    rounding.misfit += MISFIT_SHARE * (excess * excess / expected - rounding.misfit)
    share = rounding.variance_V4 * phi / expected
    rounding.square_V2 += share * excess
    rounding.variance_V4 *= (1.0 - share * phi) * (1.0 + share * phi / memory)
    rounding.variance_V4 = min(rounding.variance_V4, rounding.prior_V**4)
    rounding.probe_V = max(_root(rounding, rounding.square_V2), rounding.least_probe_V)


@compiled
def rounding_correction_V(trim, speed_m_s, gain_m_s_V, dead_band_V):
    """c [V] at a speed."""
    s = max(trim.rounding_V, trim.minimum_V)
    if s < MIN_ROUNDING_V or speed_m_s > 6.0 * s * gain_m_s_V:
        return 0.0
    share = 1.0 - math.exp(-speed_m_s / (s * gain_m_s_V))
    return max(s * math.log(share), -dead_band_V) if share > 0.0 else -dead_band_V


@compiled
def add_to_trim(trim, oil_error_m, flow_m_s, identified_V, highest_V):
    """One tick: oil displacement less the demanded one, of the last ticks, newest first; the flow demanded of the valve now.

    identified_V: the rounding as identified, to which a small excess leads back. Without one edges stay sharp: other errors
    leave 1 um of excess on average, which added up to 10 mV within ten periods.
    """
    direction, trim.known = 1.0 if flow_m_s > 0 else -1.0, identified_V > 0.0
    if direction != trim.direction:
        trim.direction, trim.ticks = direction, 0
        trim.reversal_m = oil_error_m[0]
        trim.before_m = -direction * (trim.reversal_m - oil_error_m[TRIM_TICKS])
    trim.ticks += 1
    if trim.ticks == TRIM_TICKS and trim.known:
        excess = 0.5 * (direction * (oil_error_m[0] - trim.reversal_m) + trim.before_m)
        if abs(excess) < MAX_EXCESS_M:
            bias_m = math.copysign(TRIM_BIAS_M, trim.rounding_V - identified_V)
            trim.rounding_V = clip(trim.rounding_V + TRIM_V_M * (excess - bias_m), 0.0, highest_V)
