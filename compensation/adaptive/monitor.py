"""Performance monitor: is a compensated reversal worse than plain control's? From the position transducer alone.

Acceleration from positions, over blocks of BLOCK ticks, high-passed over APART ticks:

    a = (m_0 - 2 m_1 + m_2) / (BLOCK T)^2,     h = a_k - (a_{k - APART} + a_{k + APART}) / 2

m_i are means of successive blocks. h passes about 3 to 40 Hz, so that it hardly holds the motion itself. Its range
over a reversal is the bump. A motion that is itself that quick, as in rough air, is no bump: of a compensated reversal
counts what the piston deviates from the reference, where that is less.

The baseline is plain control's last bump of either direction, with the acceleration asked for at that reversal. What
compensated bumps exceed it by is summed over the reversals (CUSUM): one that is much worse, or several that are a
little, end compensation. Of two unlike reversals, the one with more acceleration may have the larger bump, and more is
allowed.
"""

from __future__ import annotations

import math

from ..arithmetic import push
from ..compiled import compiled
from .layout import APART, BLOCK

FIRST, SECOND, THIRD = BLOCK - 1, 2 * BLOCK - 1, 3 * BLOCK - 1  # oldest position of each block
FILLED = 3 * BLOCK + 2 * APART  # ticks until the filter is filled
RATIO_ALIKE, RATIO_UNLIKE = 1.05, 1.5  # allowed bump over the baseline, at a reversal like the baseline's or unlike it
STANDARD_ERRORS, DRIFT_ERRORS = 2.5, 0.5  # of h: of the excess of several reversals; and allowed at each of them
ALIKE = 0.05  # relative difference in acceleration up to which reversals are alike
BASELINE_SHARE = 0.5  # low-pass of the baseline, a reversal
LEAST_SHARE = 0.3  # with which the smallest bump is forgotten, a reversal
FELT_M_S2 = 0.15  # bump of plain control from which a compensation that is still learning can be trusted to gain
FELT_ALONE_M_S2 = 0.115  # of a single leg, the mean of both directions
# of the load's acceleration by the friction step: less than this it cannot lose; and where the load is told, not found
RISK_SHARE, RISK_SHARE_TOLD = 0.3, 0.12
CROSSING_OIL_M = 1.7e-5  # too much and too little together, across overlaps of 5 to 20 um, 120 to 250 kg
MUCH_LESS = 0.7  # of the smallest bump of late: another kind of reversal, and no noise
GENTLE_M_S2 = 0.1  # reversal acceleration from which windows tell the inertia
NOISE_RANGE = 5.0  # standard errors between the extremes of noise; half of a bump's own swing hides some of them
NOISE_RANGE_ALONE = 4.4
NONE_YET = 1e9  # beyond any acceleration: a range that holds nothing
PAIR_NOISE = 2.0  # of it that adds to a bump; a four-way valve without overlap can be trusted with smaller ones


@compiled
def start_monitor(monitor, tick_s, noise_m):
    """noise_m: standard deviation of a position."""
    monitor.tick_s, monitor.noise_m = tick_s, noise_m
    begin_range(monitor)


@compiled
def begin_range(monitor):
    """The range of h begins anew."""
    for shaken in (monitor.piston, monitor.off):
        shaken.low_m_s2, shaken.high_m_s2 = NONE_YET, -NONE_YET


@compiled
def add_to_monitor(monitor, position_m, behind_m):
    """One tick; behind_m: the reference less the piston."""
    _add(monitor.piston, position_m, monitor.tick_s)
    _add(monitor.off, -behind_m, monitor.tick_s)


@compiled
def _add(shaken, position_m, tick_s):
    positions, sums = shaken.positions_m, shaken.sums_m
    first, second, third = positions[FIRST], positions[SECOND], positions[THIRD]
    sums[0] += position_m - first
    sums[1] += first - second
    sums[2] += second - third
    push(positions, position_m)
    kept = shaken.accelerations_m_s2
    push(kept, (sums[0] - 2.0 * sums[1] + sums[2]) / (BLOCK * (BLOCK * tick_s) ** 2))
    if shaken.count < FILLED:
        shaken.count += 1
        return
    h = kept[APART] - 0.5 * (kept[0] + kept[2 * APART])
    if h < shaken.low_m_s2:
        shaken.low_m_s2 = h
    if h > shaken.high_m_s2:
        shaken.high_m_s2 = h


@compiled
def worse_than_baseline(monitor, extending, reversal_m_s2, ramp):
    """Closes a reversal, between it and the next; whether its bump was worse than the baseline.

    reversal_m_s2: acceleration asked for at it; ramp: 0 plain control, whose bump becomes the baseline.
    """
    bump, off = monitor.piston.high_m_s2 - monitor.piston.low_m_s2, monitor.off.high_m_s2 - monitor.off.low_m_s2
    begin_range(monitor)
    if ramp == 1.0 and off < bump:
        bump = off
    if not bump >= 0.0:
        return False
    i = 1 if extending else 0
    baseline, reversal = monitor.baseline_m_s2[i], monitor.reversal_m_s2[i]
    alike = abs(reversal_m_s2 - reversal) < ALIKE * reversal_m_s2
    if ramp == 0.0:
        usual = monitor.usual_m_s2[i]
        monitor.usual_m_s2[i] = usual + (BASELINE_SHARE if usual > 0.0 else 1.0) * (bump - usual)
        least = monitor.least_m_s2[i]
        smaller = least == 0.0 or bump < MUCH_LESS * least
        monitor.least_m_s2[i] = bump if smaller else least + LEAST_SHARE * (bump - least)
        monitor.baseline_m_s2[i] = baseline + BASELINE_SHARE * (bump - baseline) if alike else bump
        monitor.reversal_m_s2[i] = reversal_m_s2
        return False
    unlike = RATIO_UNLIKE * baseline * max(1.0, reversal_m_s2 / max(reversal, 1e-9))
    noise = bump_noise_m_s2(monitor)
    over = bump - (RATIO_ALIKE * baseline if alike else unlike) - DRIFT_ERRORS * noise
    monitor.excess_m_s2[i] = max(0.0, monitor.excess_m_s2[i] + over)
    if baseline == 0.0 or monitor.excess_m_s2[i] <= STANDARD_ERRORS * noise:
        return False
    monitor.excess_m_s2[0] = monitor.excess_m_s2[1] = 0.0
    return True


@compiled
def worth_compensating(monitor, step_m_s2, told, noise_range):
    """Whether plain control's bumps, both directions' mean, are larger than those of a compensation that is still learning;
    for a platform's leg, whose bumps are small beside those of the others, the larger one, or the mean of late. step_m_s2:
    acceleration that the friction step gives the load; told: a platform's leg is told its load; noise_range: standard
    errors that noise adds to a bump."""
    noise_m_s2 = noise_range * bump_noise_m_s2(monitor)
    return plain_bump_m_s2(monitor, told) > least_bump_m_s2(monitor, step_m_s2, told) + noise_m_s2


@compiled
def plain_bump_m_s2(monitor, told):
    """Plain control's bump that counts."""
    first, second = monitor.baseline_m_s2
    return max(first, second, monitor.usual_m_s2[0], monitor.usual_m_s2[1]) if told else 0.5 * (first + second)


@compiled
def least_bump_m_s2(monitor, step_m_s2, told):
    """What it must be above, beside noise."""
    if told:
        return min(FELT_M_S2, RISK_SHARE_TOLD * step_m_s2)
    least = min(FELT_ALONE_M_S2, RISK_SHARE * step_m_s2)
    reversal_m_s2 = max(monitor.reversal_m_s2[0], monitor.reversal_m_s2[1])
    return least * GENTLE_M_S2 / reversal_m_s2 if 0.0 < reversal_m_s2 < GENTLE_M_S2 else least


@compiled
def worth_crossing(monitor, resonance_Hz):
    """Where a four-way valve's spool jumps across an overlap: whether the smallest of plain control's bumps of late is larger than
    what the oil that such a jump lets through wrongly gives the load at its resonance, more for a light one. In irregular
    motion the last bump of either direction is chance."""
    wrong_m_s2 = CROSSING_OIL_M * (2.0 * math.pi * resonance_Hz) ** 2
    return min(monitor.least_m_s2[0], monitor.least_m_s2[1]) > wrong_m_s2


@compiled
def noise_range(four_way, told):
    """Standard errors that noise adds to a bump."""
    if four_way:
        return PAIR_NOISE
    return NOISE_RANGE if told else NOISE_RANGE_ALONE


@compiled
def monitor_ready(monitor):
    """Whether both directions have a baseline."""
    return monitor.baseline_m_s2[0] > 0.0 and monitor.baseline_m_s2[1] > 0.0


@compiled
def bump_noise_m_s2(monitor):
    """Standard deviation of h from that of a position."""
    return math.sqrt(1.5 * 6.0 / BLOCK) * monitor.noise_m / (BLOCK * monitor.tick_s) ** 2
