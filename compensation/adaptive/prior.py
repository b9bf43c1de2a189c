"""What is believed of a leg before anything is measured: mean and standard deviation of each number, and bounds.

Sizes follow the data sheet: volts the half dead band that is possible (edge_V), forces the supply's force on the piston. They are
wide: a standard deviation is the spread between machines of one kind, not the doubt about one of them.
"""

from __future__ import annotations

from math import log, pi, tan

from ..compiled import compiled
from .fit import N_STATE, STATE_SCALE
from .inverse import FELT_HZ
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
    HOLD,
    LAMINAR,
    LEAK,
    LEAK_SUPPLY,
    LEAK_SUPPLY_TOP,
    LEAK_TANK,
    LEAK_TANK_TOP,
    LN_BRISTLE,
    LN_REG,
    LN_ROUND,
    LN_ROUND_RATIO,
    LN_SPOOL,
    LN_STRIBECK,
    MASS,
    N_NUMBERS,
    NOTCH,
    PLAY,
    POSITION_LAG,
    PRESSURE_LAG,
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
    SPRING,
    STATIC_DN,
    STATIC_UP,
    TURBULENT,
    VISCOUS_DN,
    VISCOUS_UP,
    ZETA,
)  # fmt: skip

GRAVITY_m_s2 = 9.81
USUAL_SPOOL_HZ = 65.0
# friction up and down are alike within this share of their own standard deviation, gains too; mass and held force by gravity
PAIRS = ((COULOMB_UP, COULOMB_DN), (STATIC_UP, STATIC_DN), (VISCOUS_UP, VISCOUS_DN), (GAIN_UP, GAIN_DN))
PAIR_SD = (0.3, 0.3, 0.3, 0.25)
# standard deviations between the legs of one machine, over that between machines: equally likely before they are measured
LEGS_ALIKE = (0.01, 0.03, 0.1, 0.3)
BETWEEN_RUNS = 0.1  # of a number's prior, between two runs: oil's temperature, wear
HOLD_SHARE, MASS_SHARE, MASS_PAIR = (
    0.05,
    0.25,
    0.1,
)  # of the held force, of the mass; mass beside held force over gravity


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
def one(fit, k, mean, sd, low, high):
    """A number's prior and its bounds."""
    fit.mean[k], fit.sd[k], fit.low[k], fit.high[k] = mean, sd, low, high


@compiled
def fill_prior(fit, settings, hold_N):
    """hold_N: force that the pressures held on the mean of up and down."""
    force = settings.area_bottom_m2 * settings.supply_pressure_Pa
    volts = settings.edge_V / 0.5
    viscous = 0.035 * force / settings.velocity_gain_m_s_V  # at the speed that a volt gives
    mass = settings.load_over_weight * max(abs(hold_N), 0.01 * force) / GRAVITY_m_s2
    fit.mass_over_hold = settings.load_over_weight / GRAVITY_m_s2
    none = 1e300
    one(fit, GAIN_UP, 1.0, 0.2, 0.3, 3.0)
    one(fit, GAIN_DN, 1.0, 0.2, 0.3, 3.0)
    one(fit, DEAD_UP, 0.06 * volts, 0.12 * volts, -0.6 * volts, 2.0 * volts)
    one(fit, DEAD_DN, 0.06 * volts, 0.12 * volts, -0.6 * volts, 2.0 * volts)
    one(fit, LN_ROUND, log(0.012 * volts), 0.9, log(1e-3 * volts), log(0.2 * volts))
    one(fit, NOTCH, 0.0, 0.1, 0.0, 1.0)
    one(fit, BEND, 0.0, 0.2 / volts, -0.6 / volts, 2.0 / volts)
    one(fit, BEND2, 0.0, 0.1 / volts**2, -0.3 / volts**2, 0.5 / volts**2)
    if settings.spool_frequency_Hz > 0.0:
        one(fit, LN_SPOOL, log(settings.spool_frequency_Hz), 0.25, log(10.0), log(500.0))
    else:
        one(fit, LN_SPOOL, log(USUAL_SPOOL_HZ), 0.6, log(10.0), log(500.0))
    one(fit, ZETA, 0.75, 0.3, 0.15, 2.5)
    one(fit, AMP_LAG, 5e-4, 8e-4, 0.0, 6e-3)
    one(fit, DELAY, 1e-3, 3e-3, 0.0, 5.9 * settings.tick_s)
    one(fit, PLAY, 0.01 * volts, 0.015 * volts, 0.0, 0.2 * volts)
    one(fit, TURBULENT, 6e4, 2e5, 10.0, 3e6)
    one(fit, LAMINAR, 20.0 * volts**2, 2e3 * volts**2, 20.0 * volts**2, 1e6 * volts**2)
    leak = 1e-12 * settings.area_bottom_m2 / 1.257e-3 * settings.velocity_gain_m_s_V / 0.15
    for k in (LEAK, LEAK_TANK, LEAK_SUPPLY, LEAK_SUPPLY_TOP, LEAK_TANK_TOP):
        one(fit, k, 0.0, leak, -20.0 * leak, 20.0 * leak)
    back = (
        0.01 * settings.supply_pressure_Pa / (settings.velocity_gain_m_s_V * settings.area_bottom_m2)
    )  # at the flow of a volt
    one(fit, RETURN, 0.0, back, 0.0, 10.0 * back)
    for k in (SKEW_UP, SKEW_DN):
        one(fit, k, 0.0, 0.02 * volts, -0.2 * volts, 0.2 * volts)
    one(fit, DRIFT, 0.0, 1e-3 * volts, -0.02 * volts, 0.02 * volts)
    one(fit, LN_ROUND_RATIO, 0.0, 0.3, -1.5, 1.5)
    one(fit, SOFT, 0.25, 0.4, -0.5, 5.0)
    one(fit, AIR, 0.002, 0.005, 0.0, 0.1)
    one(fit, MASS, mass, MASS_SHARE * mass, 0.3 * mass, 4.0 * mass)
    one(fit, HOLD, hold_N, HOLD_SHARE * max(abs(hold_N), 0.02 * force), -none, none)
    one(fit, SPRING, 0.0, 0.1 * force / settings.stroke_m, -none, none)
    for k in (COULOMB_UP, COULOMB_DN):
        one(fit, k, 0.01 * force, 0.008 * force, 1e-4 * force, none)
    for k in (STATIC_UP, STATIC_DN):
        one(fit, k, 0.0035 * force, 0.0035 * force, 0.0, none)
    for k in (VISCOUS_UP, VISCOUS_DN):
        one(fit, k, viscous, 0.5 * viscous, 0.0, none)
    one(fit, LN_STRIBECK, log(settings.stribeck_velocity_m_s), 0.8, log(5e-4), log(0.08))
    one(fit, LN_REG, log(2.5e-4), 1.0, log(2e-5), log(5e-2))
    bristle = 3.5e7 * force / 8800.0
    one(fit, LN_BRISTLE, log(bristle), 1.5, log(0.015 * bristle), log(1000.0 * bristle))
    one(fit, PRESSURE_LAG, 4e-4, 1e-3, 0.0, 0.01)
    one(fit, POSITION_LAG, 2e-4, 7e-4, 0.0, 0.01)
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
    for p in range(5):
        if p < 4:
            a, b = PAIRS[p]
            wide, by_a, by_b = PAIR_SD[p] * fit.sd[a], 1.0, -1.0
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
