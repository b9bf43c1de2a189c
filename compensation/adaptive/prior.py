"""What is believed of a leg before anything is measured: mean and standard deviation of each number, and bounds.

Sizes follow the data sheet: volts the half dead band that is possible (edge_V), forces the supply's force on the piston. They are
wide: a standard deviation is the spread between machines of one kind, not the doubt about one of them.
"""

from __future__ import annotations

from math import log, pi, tan

import numpy as np

from ..arithmetic import copy
from ..compiled import compiled
from .fit import N_STATE, STATE_SCALE
from .inverse import FELT_HZ
from .layout import MOST_DELAY
from .leg import (
    AIR,
    AMP_LAG,
    BEND,
    BEND2,
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    DELAY,
    DRIFT,
    GAIN_DN,
    GAIN_UP,
    GIVE,
    HOLD,
    LEAK,
    LEAK_SUPPLY,
    LEAK_SUPPLY_TOP,
    LEAK_TANK,
    LEAK_TANK_TOP,
    LN_LAMINAR,
    LN_ROUND,
    LN_ROUND_RATIO,
    LN_SPOOL,
    LN_STRIBECK,
    LN_TURBULENT,
    MASS,
    N_NUMBERS,
    NOTCH,
    PLAY,
    POSITION_LAG,
    PRESSURE_LAG,
    REG,
    RETURN,
    S_A1,
    S_A2,
    S_E,
    S_FLOW,
    S_FOUR_WAY,
    S_OWN,
    S_PASS,
    S_POLE1,
    S_POLE2,
    S_STROKE,
    S_TANK,
    S_TICK,
    S_V1,
    S_V2,
    SKEW_DN,
    SKEW_UP,
    SOFT,
    SPREAD,
    SPRING,
    STATIC_DN,
    STATIC_UP,
    TAIL,
    VISCOUS_DN,
    VISCOUS_UP,
    ZETA,
)  # fmt: skip

GRAVITY_m_s2 = 9.81  # between a held force and a mass
NONE = 1e300  # no bound
# units of the figures below: numerator and denominator in `fill_prior`
(
    ONE, VOLTS, PER_VOLT, PER_VOLT2, RANGE2, FORCE, FORCE_A_STROKE, FORCE_A_SPEED, WEIGHT, HELD, LEAKS, PER_FLOW, GIVES,
    STRIBECK,
) = range(14)  # fmt: skip
# Number, mean, standard deviation, lowest, highest, unit; and 1 where the number is a logarithm: of that mean and those bounds. All are
# assumed: what machines of one kind differ by, and where the equations are still those of a leg.
TABLE = np.array([
    (GAIN_UP, 1.0, 0.2, 0.3, 3.0, ONE, 0),  # of the sheet's flow
    (GAIN_DN, 1.0, 0.2, 0.3, 3.0, ONE, 0),
    (DEAD_UP, 0.06, 0.12, -0.6, 2.0, VOLTS, 0),  # from an underlap to twice the half dead band that is possible
    (DEAD_DN, 0.06, 0.12, -0.6, 2.0, VOLTS, 0),
    (LN_ROUND, 0.012, 0.9, 1e-3, 0.2, VOLTS, 1),  # a fifth of the dead band that is expected: edges worn round, clearance
    (LN_ROUND_RATIO, 0.0, 0.3, -1.5, 1.5, ONE, 0),  # retracting edges over extending ones: worn unlike
    (TAIL, 0.0, 0.5, 0.0, 1.0, ONE, 0),  # clearance and round corners: none until it shows
    (NOTCH, 0.0, 0.1, 0.0, 1.0, ONE, 0),  # share of the linear part that is missing: 1 in the quadratic law, Eq. 3.11
    (BEND, 0.0, 0.2, -0.6, 2.0, PER_VOLT, 0),  # ports neither straight nor round; of the quadratic law 1
    (BEND2, 0.0, 0.1, -0.3, 0.5, PER_VOLT2, 0),
    (LN_SPOOL, 65.0, 0.6, 10.0, 500.0, ONE, 1),  # [Hz] servo valves; what a sheet gives: `fill_prior`
    (ZETA, 0.75, 0.3, 0.15, 2.5, ONE, 0),  # from a spool that rings to one that creeps
    (AMP_LAG, 5e-4, 8e-4, 0.0, 6e-3, ONE, 0),  # [s] a corner of 300 Hz
    (DELAY, 1e-3, 3e-3, 0.0, 0.0, ONE, 0),  # [s] of a bus; its highest: `fill_prior`
    (PLAY, 0.01, 0.015, 0.0, 0.2, VOLTS, 0),  # hysteresis of a torque motor
    (SPREAD, 0.0, 0.3, 0.0, 0.9, ONE, 0),  # share of it that is a narrower one: none until it shows
    (DRIFT, 0.0, 1e-3, -0.02, 0.02, VOLTS, 0),  # [a second] of the null: a tenth of its spread in 10 s
    (SKEW_UP, 0.0, 0.02, -0.2, 0.2, VOLTS, 0),  # of a tank edge beside its supply edge: lands ground to 2 um
    (SKEW_DN, 0.0, 0.02, -0.2, 0.2, VOLTS, 0),
    (LN_TURBULENT, 3e4, 2.0, 10.0, 3e6, ONE, 1),  # [Pa] drop above which the flow goes with its root
    (LN_LAMINAR, 10.0, 3.5, 0.01, 1e5, RANGE2, 1),  # [Pa] the same of a laminar edge that is open all the way: from none to cold oil
    (LEAK, 0.0, 1.0, -20.0, 20.0, LEAKS, 0),  # of either sign, for it stands beside what the dead band lets through
    (LEAK_TANK, 0.0, 1.0, -20.0, 20.0, LEAKS, 0),
    (LEAK_SUPPLY, 0.0, 1.0, -20.0, 20.0, LEAKS, 0),
    (LEAK_SUPPLY_TOP, 0.0, 1.0, -20.0, 20.0, LEAKS, 0),
    (LEAK_TANK_TOP, 0.0, 1.0, -20.0, 20.0, LEAKS, 0),
    (RETURN, 0.0, 0.01, 0.0, 0.1, PER_FLOW, 0),  # a hundredth of the supply at the flow of a volt
    (SOFT, 0.25, 0.4, -0.5, 5.0, ONE, 0),  # of the sheet's compressibility: hoses
    (AIR, 0.002, 0.005, 0.0, 0.1, ONE, 0),  # of the volume, free air at one bar
    (MASS, 1.0, 0.25, 0.3, 4.0, WEIGHT, 0),  # a leg moves more and less than what it holds
    (HOLD, 0.0, 0.05, -NONE, NONE, HELD, 0),  # its mean is what was held: `fill_prior`
    (SPRING, 0.0, 0.1, -NONE, NONE, FORCE_A_STROKE, 0),  # cables
    (COULOMB_UP, 0.01, 0.008, 1e-4, NONE, FORCE, 0),  # seals: from a hydrostatic bearing to 3 %
    (COULOMB_DN, 0.01, 0.008, 1e-4, NONE, FORCE, 0),
    (STATIC_UP, 0.0035, 0.0035, 0.0, NONE, FORCE, 0),  # break-away, on top: a third of it
    (STATIC_DN, 0.0035, 0.0035, 0.0, NONE, FORCE, 0),
    (VISCOUS_UP, 0.035, 0.0175, 0.0, NONE, FORCE_A_SPEED, 0),
    (VISCOUS_DN, 0.035, 0.0175, 0.0, NONE, FORCE_A_SPEED, 0),
    (LN_STRIBECK, 1.0, 0.8, 1.0, 1.0, STRIBECK, 1),  # its bounds: `fill_prior`
    (REG, 2.5e-4, 3e-4, 2e-5, 5e-2, ONE, 0),  # [m/s] within which friction turns
    (GIVE, 1e-3, 8.0, 1e-3, 70.0, GIVES, 0),  # [m/N] of a seal before it slides: none until it shows, 20 um at 1 % of the force
    (PRESSURE_LAG, 4e-4, 1e-3, 0.0, 0.01, ONE, 0),  # [s] a corner of 400 Hz, at least 16 Hz
    (POSITION_LAG, 2e-4, 7e-4, 0.0, 0.01, ONE, 0),  # [s] a corner of 800 Hz, at least 16 Hz
])  # fmt: skip
# Two numbers are alike within a share of the first one's standard deviation
PAIRS = np.array([
    (COULOMB_UP, COULOMB_DN, 0.3), (STATIC_UP, STATIC_DN, 0.3), (VISCOUS_UP, VISCOUS_DN, 0.3), (GAIN_UP, GAIN_DN, 0.25),
])  # fmt: skip
MASS_PAIR = 0.1  # of the mass, by which it differs from the held force over gravity
# standard deviations between the legs of one machine, over that between machines: equally likely before they are measured
LEGS_ALIKE = (0.01, 0.03, 0.1, 0.3)
BETWEEN_RUNS = 0.1  # of a number between two runs: oil's temperature, wear


@compiled
def fill_sheet(sheet, settings):
    """The declared leg for the model."""
    sheet[S_A1], sheet[S_A2] = settings.area_bottom_m2, settings.area_top_m2
    sheet[S_FLOW] = settings.velocity_gain_m_s_V * settings.area_bottom_m2 / (0.5 * settings.supply_pressure_Pa) ** 0.5
    sheet[S_E], sheet[S_V1], sheet[S_V2] = (
        settings.bulk_modulus_Pa,
        settings.pipeline_volume_m3,
        settings.pipeline_volume_top_m3,
    )
    sheet[S_STROKE], sheet[S_TANK] = settings.stroke_m, settings.tank_pressure_Pa
    sheet[S_FOUR_WAY], sheet[S_TICK] = settings.four_way, settings.tick_s
    sheet[S_OWN] = settings.own_mobility
    k = tan(pi * min(FELT_HZ * settings.tick_s, 0.45))  # Butterworth's low pass by the bilinear rule
    norm = 1.0 / (1.0 + 2.0**0.5 * k + k * k)
    sheet[S_PASS], sheet[S_POLE1], sheet[S_POLE2] = (
        k * k * norm,
        2.0 * (k * k - 1.0) * norm,
        (1.0 - 2.0**0.5 * k + k * k) * norm,
    )


@compiled
def unit_of(unit, settings, hold_N):
    """What a figure of the table is multiplied with and divided by."""
    force, volts = settings.area_bottom_m2 * settings.supply_pressure_Pa, settings.edge_V / 0.5
    if unit == VOLTS:
        return volts, 1.0
    if unit == PER_VOLT:
        return 1.0, volts
    if unit == PER_VOLT2:
        return 1.0, volts**2
    if unit == RANGE2:
        return settings.voltage_max_V**2, 1.0
    if unit == FORCE:
        return force, 1.0
    if unit == FORCE_A_STROKE:
        return force, settings.stroke_m
    if unit == FORCE_A_SPEED:  # the speed that a volt gives
        return force, settings.velocity_gain_m_s_V
    if unit == WEIGHT:
        return settings.load_over_weight * max(abs(hold_N), 0.01 * force) / GRAVITY_m_s2, 1.0
    if unit == HELD:
        return max(abs(hold_N), 0.02 * force), 1.0
    # as on the 600 kg machine: 1e-12 m3/s/Pa with 1.257e-3 m2 and 0.15 m/s/V, 3.5e7 N/m with 8800 N
    if unit == LEAKS:
        return 1e-12 * settings.area_bottom_m2 / 1.257e-3 * settings.velocity_gain_m_s_V / 0.15, 1.0
    if unit == PER_FLOW:
        return settings.supply_pressure_Pa, settings.velocity_gain_m_s_V * settings.area_bottom_m2
    if unit == GIVES:
        return 8800.0 / 3.5e7, force
    if unit == STRIBECK:
        return settings.stribeck_velocity_m_s, 1.0
    return 1.0, 1.0


@compiled
def fill_prior(fit, settings, hold_N):
    """hold_N: force that the pressures held on the mean of up and down."""
    fit.mass_over_hold = settings.load_over_weight / GRAVITY_m_s2
    for i in range(N_NUMBERS):
        k, is_log = int(TABLE[i, 0]), TABLE[i, 6] == 1.0
        over, under = unit_of(int(TABLE[i, 5]), settings, hold_N)
        mean, sd, low, high = (
            TABLE[i, 1] * over / under,
            TABLE[i, 2] if is_log else TABLE[i, 2] * over / under,
            TABLE[i, 3] * over / under,
            TABLE[i, 4] * over / under,
        )
        if is_log:
            mean, low, high = log(mean), log(low), log(high)
        fit.mean[k], fit.sd[k], fit.low[k], fit.high[k] = mean, sd, low, high
    fit.mean[HOLD], fit.high[DELAY] = hold_N, (MOST_DELAY - 0.1) * settings.tick_s
    fit.low[LN_STRIBECK], fit.high[LN_STRIBECK] = log(5e-4), log(0.08)  # [m/s]
    if settings.spool_frequency_Hz > 0.0:
        fit.mean[LN_SPOOL], fit.sd[LN_SPOOL] = log(settings.spool_frequency_Hz), 0.25
    copy(fit.mean, fit.kind_mean)
    copy(fit.sd, fit.kind_sd)
    for k in range(N_NUMBERS):
        fit.scale[k] = fit.sd[k]
    for k in range(N_STATE):
        fit.scale[N_NUMBERS + k] = STATE_SCALE[k]


@compiled
def add_prior(fit, numbers, H, g):
    """The prior's information, what older windows said, and what other legs told, into H (lower) and g, in prior units; returns its
    cost."""
    cost = 0.0
    for k in range(N_NUMBERS):
        d = (numbers[k] - fit.mean[k]) / fit.sd[k]
        cost += d * d
        H[k, k] += 1.0
        g[k] -= d
        e = d - fit.told[k]
        cost += fit.told_weight[k] * e * e
        H[k, k] += fit.told_weight[k]
        g[k] -= fit.told_weight[k] * e
    for p in range(len(PAIRS) + 1):
        if p < len(PAIRS):
            a, b = int(PAIRS[p, 0]), int(PAIRS[p, 1])
            wide, by_a, by_b = PAIRS[p, 2] * fit.sd[a], 1.0, -1.0
        else:
            a, b = MASS, HOLD
            sign = 1.0 if fit.mean[HOLD] >= 0.0 else -1.0
            wide, by_a, by_b = MASS_PAIR * fit.mean[MASS], 1.0, -sign * fit.mass_over_hold
        e = (by_a * numbers[a] + by_b * numbers[b]) / wide
        ja, jb = by_a * fit.sd[a] / wide, by_b * fit.sd[b] / wide
        cost += e * e
        g[a] -= ja * e
        g[b] -= jb * e
        H[a, a] += ja * ja
        H[b, b] += jb * jb
        low, high = (a, b) if a < b else (b, a)
        H[high, low] += ja * jb
    for a in range(N_NUMBERS):
        pull = 0.0
        for b in range(N_NUMBERS):
            pull += fit.folded_H[a, b] * (numbers[b] - fit.mean[b]) / fit.sd[b]
            if b <= a:
                H[a, b] += fit.folded_H[a, b]
        g[a] += fit.folded_g[a] - pull
    return cost + folded_cost(fit, numbers)


@compiled
def folded_cost(fit, numbers):
    """What older windows cost at numbers, over what they cost where they were folded."""
    cost = fit.folded_cost
    for a in range(N_NUMBERS):
        pull = 0.0
        for b in range(N_NUMBERS):
            pull += fit.folded_H[a, b] * (numbers[b] - fit.mean[b]) / fit.sd[b]
        cost += (pull - 2.0 * fit.folded_g[a]) * (numbers[a] - fit.mean[a]) / fit.sd[a]
    return cost


@compiled
def restore_prior(fit, settings, numbers, sd):
    """The prior after an earlier run: what was found, with its standard deviations, and the bounds of before. A machine may have
    changed since: each number by BETWEEN_RUNS of what machines of its kind differ by. Numbers beyond the bounds are set to them."""
    fill_prior(fit, settings, numbers[HOLD])
    for k in range(N_NUMBERS):
        if k == DRIFT:  # of that run
            continue
        fit.mean[k] = numbers[k] = min(max(numbers[k], fit.low[k]), fit.high[k])
        fit.sd[k] = (sd[k] * sd[k] + (BETWEEN_RUNS * fit.sd[k]) ** 2) ** 0.5
        fit.scale[k] = fit.sd[k]
    fit.restored = 1
