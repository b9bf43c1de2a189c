"""A hydraulic leg written apart from hexsim: one cylinder under a vertical load, on a three-way or a four-way valve.

States: y, v, P1, P2, Ps, spool [V] and its rate, amplifier [V], two bristles [m], speed that friction remembers. Fourth-order
Runge-Kutta at a constant step, a fraction of the 2 ms tick. The volts of a step are the mean of the held volts over it, so that
delays are exact for anything slower than a step. Pressures are above tank; nothing of hexsim or compensation is used.

Edge: an opening h(x) with rounded corners; a slot of land length L, an orifice and a laminar return line in series,
dp = (12 mu L/(w h^3) + R) q + (q/(K h))^2, solved for q.
Chamber: dP/dt = inflow / (V (1/E + air (p0/p)^(1/n)/(n p)) + V_hose/E_hose), polytropic free air.
Friction: two bristles side by side (LuGre each; together Maxwell slip with memory of past turns), or without bristles a smooth
sign; level Fc + Fs exp(-|w|/v_s), with w the speed, late by `friction_lag_s`; Fc grows with P1, falls as it warms.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

compiled = njit(cache=True, error_model="numpy", nogil=True)
TICK_S, OUT_S = 2e-3, 1e-4
LIMIT_V = 10.0
GRAVITY, ATMOSPHERE = 9.8, 1e5
SPOOL_DIAMETER_m, TRAVEL_m_V, DISCHARGE = 0.01, 1.1e-4, 0.611
RIPPLE_m = 2e-3  # period of a transducer's interpolation error
PIECES = (
    20,
    40,
    60,
    80,
    120,
    160,
    240,
    320,
    480,
)  # steps a tick; multiples of 20: the acceleration is kept every OUT_S
ACCURATE, STABLE = (
    0.75,
    2.0,
)  # largest step times the fastest rate: of what shapes a reversal; of what only has to stay stable
FASTEST_m_s = 0.3  # twice the speed of the motions; RK4 itself is stable to 2.8 in place of STABLE
Y, V, P1, P2, PS, X, XR, AMP, Z1, Z2, W = range(11)
N_STATES = 11


@compiled
def opening(t, s, tail):
    """Flow height [m] of an edge t past its corner; s: rounding. tail 0: closes exponentially, 1: as two round corners do."""
    if tail > 0.5:
        half = 1.39 * s  # the same opening at the corner, s ln 2
        return 0.5 * (t + math.sqrt(t * t + half * half))
    a = t / s
    if a > 20.0:
        return t
    return s * math.log1p(math.exp(a)) if a > -25.0 else 0.0


@compiled
def edge_flow(h, dp, c, back):
    """q [m3/s] through an opening h at dp; back: laminar resistance in series [Pa s/m3]."""
    if h < 1e-11:
        return 0.0
    k = DISCHARGE * math.sqrt(2.0 / c.density) * math.pi * SPOOL_DIAMETER_m * h
    b = math.sqrt(c.laminar_Pa) + k * back
    if c.land_m > 0.0:
        b += k * 12.0 * c.viscosity * c.land_m / (math.pi * SPOOL_DIAMETER_m * h * h * h)
    return 2.0 * k * dp / (b + math.sqrt(b * b + 4.0 * abs(dp)))


@compiled
def capacity(volume, p, c):
    """dV/dP [m3/Pa] of a chamber's oil, its free air and its hose."""
    softness = (1.0 - c.air) / c.bulk_Pa
    if c.air > 0.0:
        absolute = max(p + ATMOSPHERE, 2e4)
        softness += c.air * (ATMOSPHERE / absolute) ** (1.0 / c.polytropic) / (c.polytropic * absolute)
    return volume * softness + c.hose_m3 / c.hose_Pa


@compiled
def level_of(v, slow, pressure, c, warm):
    """Friction level [N] that a steady motion of this direction has, without its viscous part."""
    up = v >= 0.0
    dry = c.coulomb_up_N if up else c.coulomb_down_N
    stick = c.static_up_N if up else c.static_down_N
    return warm * (dry + c.seal_N_Pa * max(pressure, 0.0) + stick * math.exp(-slow / c.stribeck_m_s))


@compiled
def rates(s, volts, c, time_s, out):
    """Rates of the states into `out`; out[V] is the true acceleration [m/s2]."""
    y, v, p1, p2, supply = s[Y], s[V], s[P1], s[P2], s[PS]
    four = c.four_way > 0.5
    w = 2.0 * math.pi * c.spool_Hz
    if c.amplifier_s > 0.0:
        out[AMP], asked = (volts - s[AMP]) / c.amplifier_s, s[AMP]
    else:
        out[AMP], asked = 0.0, volts
    speed = min(max(s[XR], -c.slew_V_s), c.slew_V_s)
    out[X], out[XR] = speed, w * (w * (asked - s[X]) - 2.0 * c.damping * speed)
    z = s[X] - c.null_V - c.null_drift_V_s * time_s
    z *= 1.0 + 2.0 * c.bend * abs(z) / (1.0 + abs(z))
    spool = z * TRAVEL_m_V
    lap, skew, tail = c.overlap_m, c.edge_skew_m, c.edge_tail
    feed, drain = 1.0 + c.port_skew, 1.0 - c.port_skew
    return_line = c.return_Pa_s_m3
    into = edge_flow(feed * opening(spool - lap - skew, c.rounding_m, tail), supply - p1, c, 0.0)
    away = edge_flow(drain * opening(-spool - lap + skew, c.rounding_m * c.rounding_ratio, tail), p1, c, return_line)
    piston = c.leak_piston * (p1 - p2) if four else 0.0
    q1 = into - away + c.leak_supply_1 * (supply - p1) - c.leak_1_tank * p1 - piston
    drawn = into + c.leak_supply_1 * (supply - p1)
    if four:
        into2 = edge_flow(
            drain * opening(-spool - lap - skew, c.rounding_m * c.rounding_ratio, tail), supply - p2, c, 0.0
        )
        away2 = edge_flow(feed * opening(spool - lap + skew, c.rounding_m, tail), p2, c, return_line)
        q2 = into2 - away2 + piston + c.leak_supply_2 * (supply - p2) - c.leak_2_tank * p2
        out[P2] = (q2 + c.area_top_m2 * v) / capacity(max(c.stroke_m - y, 1e-3) * c.area_top_m2 + c.dead_top_m3, p2, c)
        drawn += into2 + c.leak_supply_2 * (supply - p2)
        top = p2
    else:
        out[P2] = 0.0
        top = supply
        drawn -= c.area_top_m2 * v
    out[P1] = (q1 - c.area_bottom_m2 * v) / capacity(max(y, 1e-3) * c.area_bottom_m2 + c.dead_m3, p1, c)
    if c.line_Pa_s_m3 > 0.0:
        out[PS] = ((c.supply_Pa - supply) / c.line_Pa_s_m3 - drawn) / c.accumulator_m3_Pa
    else:
        out[PS] = 0.0
    warm = c.friction
    if c.warming > 0.0:
        warm *= 1.0 - c.warming * (1.0 - math.exp(-time_s / 20.0))
    slow = abs(v)
    if c.friction_lag_s > 0.0:
        out[W], slow = (slow - s[W]) / c.friction_lag_s, max(s[W], 0.0)
    else:
        out[W] = 0.0
    level = level_of(v, slow, p1, c, warm)
    if c.tight_spot > 0.0:
        spot = (y - 0.5 * c.stroke_m) / 0.02
        level *= 1.0 + c.tight_spot * math.exp(-spot * spot)
    viscous = c.friction * (c.viscous_up_N_s_m if v >= 0.0 else c.viscous_down_N_s_m)
    if c.bristle_N_m > 0.0:
        half = 0.5 * level
        out[Z1] = v - c.bristle_N_m * abs(v) * s[Z1] / half
        out[Z2] = v - c.bristle_N_m / c.bristle_ratio * abs(v) * s[Z2] / half
        dry = c.bristle_N_m * (s[Z1] + s[Z2] / c.bristle_ratio) + c.bristle_N_s_m * 0.5 * (out[Z1] + out[Z2])
    else:
        out[Z1] = out[Z2] = 0.0
        dry = level * math.tanh(v / c.sharpness_m_s)
    force = p1 * c.area_bottom_m2 - top * c.area_top_m2 - dry - viscous * v - c.spring_N_m * (y - 0.5 * c.stroke_m)
    out[Y], out[V] = v, force / c.mass_kg - GRAVITY


@compiled
def step(s, volts, c, time_s, h, k, mid):
    """A step of RK4. k (4, n), mid (n,): room. k[0, V] is then the acceleration at its begin."""
    rates(s, volts, c, time_s, k[0])
    for j in range(N_STATES):
        mid[j] = s[j] + 0.5 * h * k[0, j]
    rates(mid, volts, c, time_s, k[1])
    for j in range(N_STATES):
        mid[j] = s[j] + 0.5 * h * k[1, j]
    rates(mid, volts, c, time_s, k[2])
    for j in range(N_STATES):
        mid[j] = s[j] + h * k[2, j]
    rates(mid, volts, c, time_s, k[3])
    for j in range(N_STATES):
        s[j] += h / 6.0 * (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j])
    s[XR] = min(max(s[XR], -c.slew_V_s), c.slew_V_s)
    s[P1], s[P2] = max(s[P1], -0.9 * ATMOSPHERE), max(s[P2], -0.9 * ATMOSPHERE)


@compiled
def passed_plays(plays, volts, c):
    """Volts behind the valve's hysteresis: a play of half width `backlash_V`, and a share of a narrower one."""
    plays[0] = min(max(plays[0], volts - c.backlash_V), volts + c.backlash_V)
    narrow = 0.3 * c.backlash_V
    plays[1] = min(max(plays[1], volts - narrow), volts + narrow)
    return (1.0 - c.backlash_spread) * plays[0] + c.backlash_spread * plays[1]


@compiled
def advance(numbers, s, plays, arriving, reads, accelerations, first, last, pieces):
    """Steps first .. last - 1 of the grid h = TICK_S / pieces. arriving (n,): mean volts of each step. reads (4, n + 1): y, P1, P2,
    Ps behind the transducers' lags at each step's begin; accelerations: every OUT_S."""
    c, h = numbers[0], TICK_S / pieces
    k, mid, every = np.empty((4, N_STATES)), np.empty(N_STATES), pieces // 20
    lags = (c.position_lag_s, c.pressure_lag_s, c.pressure_lag_s, c.supply_lag_s)
    places = (Y, P1, P2, PS)
    before = np.empty(4)
    for i in range(first, last):
        for j in range(4):
            before[j] = s[places[j]]
        step(s, passed_plays(plays, arriving[i], c), c, i * h, h, k, mid)
        if i % every == 0:
            accelerations[i // every] = k[0, V]
        for j in range(4):
            now = s[places[j]]
            if lags[j] > 0.0:  # exact for a signal that runs straight over the step
                fade, slope = math.exp(-h / lags[j]), (now - before[j]) / h
                off = reads[j, i] - before[j] + slope * lags[j]
                reads[j, i + 1] = now - slope * lags[j] + off * fade
            else:
                reads[j, i + 1] = now


@compiled
def read(numbers, reads, noise, time_s, pieces, out):
    """Readings (y, P1, P2, Ps) at an instant, into `out`: behind lag and delay, with noise (4,) and counts. The grid is known up to the
    step before the instant; over the rest of it the signal is taken to run on straight."""
    c, h = numbers[0], TICK_S / pieces
    known = int(time_s / h + 1e-6)
    delays = (c.position_delay_s, c.pressure_delay_s, c.pressure_delay_s, c.supply_delay_s)
    for j in range(4):
        at = max((time_s - delays[j]) / h, 0.0)
        i = max(min(int(at + 1e-6), known - 1), 0)
        out[j] = reads[j, i] + (at - i) * (reads[j, i + 1] - reads[j, i]) if known > 0 else reads[j, 0]
    out[0] += c.ripple_m * math.sin(2.0 * math.pi / RIPPLE_m * out[0])
    for j in range(4):
        out[j] = counted(out[j] + noise[j], c.position_resolution_m if j == 0 else c.pressure_resolution_Pa)


@compiled
def counted(value, count):
    return count * round(value / count) if count > 0.0 else value


@compiled
def hold(arriving, volts, time_s, pieces):
    """Hold `volts` at the valve from an instant on; the step in which it comes gets the mean of before and after."""
    at = time_s / (TICK_S / pieces)
    i = int(at + 1e-6)
    share = max(at - i, 0.0)
    if i < len(arriving):
        arriving[i] = share * arriving[i] + (1.0 - share) * volts
        for j in range(i + 1, min(i + 1 + 3 * pieces, len(arriving))):
            arriving[j] = volts


@compiled
def exchange(numbers, s, plays, arriving, reads, accelerations, instants, noise, pieces, k, volts, out):
    """A tick of the computer: send `volts` at instant k, run to instant k + 1 (or the end), read there into `out`. Returns what was
    sent, in range and counts."""
    c, h = numbers[0], TICK_S / pieces
    sent = (
        counted(min(max(volts, -LIMIT_V), LIMIT_V), 2.0 * LIMIT_V / 2.0**c.volts_bits) if volts - volts == 0.0 else 0.0
    )
    hold(arriving, sent, instants[k] + c.computer_delay_s + c.valve_delay_s, pieces)
    last = k + 1 == len(instants)
    until = len(arriving) if last else int(instants[k + 1] / h + 1e-6)
    advance(numbers, s, plays, arriving, reads, accelerations, int(instants[k] / h + 1e-6), until, pieces)
    if not last:
        read(numbers, reads, noise[k + 1], instants[k + 1], pieces, out)
    return sent


@compiled
def driven(numbers, s, plays, arriving, reads, accelerations, instants, noise, pieces, setpoints, added, log):
    """All ticks under proportional control and volts (ticks,) added to it. log (12, ticks): position, P1, P2, Ps as read, volts sent,
    volts added, then y, v, P1, P2, Ps and spool, true."""
    out, c = np.empty(4), numbers[0]
    read(numbers, reads, noise[0], instants[0], pieces, out)
    for k in range(len(setpoints)):
        log[:4, k] = out
        log[5, k] = added[k]
        log[6:12, k] = s[:6]  # Y to X
        volts = c.gain_V_m * (setpoints[k] - out[0]) + added[k]
        log[4, k] = exchange(numbers, s, plays, arriving, reads, accelerations, instants, noise, pieces, k, volts, out)


def pieces_of(c: Any) -> int:
    """Steps a tick: a step is at most ACCURATE over the rates of sign, amplifier, spool and memory, and STABLE over the bristles'."""
    level = c.friction * (max(c.coulomb_up_N + c.static_up_N, c.coulomb_down_N + c.static_down_N) + 5e6 * c.seal_N_Pa)
    stiff = 0.0
    if c.bristle_N_m > 0.0:
        least = c.friction * (1.0 - c.warming) * min(c.coulomb_up_N, c.coulomb_down_N)
        stiff = 2.0 * c.bristle_N_m * FASTEST_m_s / least
        sign = (c.bristle_N_s_m + c.friction * c.viscous_up_N_s_m) / c.mass_kg
    else:
        sign = (level / c.sharpness_m_s + c.friction * c.viscous_up_N_s_m) / c.mass_kg
    amplifier = 1.0 / c.amplifier_s if c.amplifier_s > 0.0 else 0.0
    lag = 1.0 / c.friction_lag_s if c.friction_lag_s > 0.0 else 0.0
    spool = 2.0 * math.pi * c.spool_Hz * (c.damping + math.sqrt(max(c.damping**2 - 1.0, 0.0)))
    needed = TICK_S * max(max(sign, amplifier, spool, lag) / ACCURATE, stiff / STABLE)
    return next((n for n in PIECES if n >= needed), PIECES[-1])


def balanced(c: Any, position_m: float) -> np.ndarray:
    """States (n,) at rest with the valve shut: the bottom pressure carries the load."""
    s = np.zeros(N_STATES)
    s[Y], s[PS], s[X], s[AMP] = position_m, c.supply_Pa, c.null_V, c.null_V
    spring = c.spring_N_m * (position_m - 0.5 * c.stroke_m)
    carried = (c.mass_kg * GRAVITY + spring) / c.area_bottom_m2
    ratio = c.area_top_m2 / c.area_bottom_m2
    if c.four_way > 0.5:
        s[P2] = max((c.supply_Pa - carried) / (1.0 + ratio), 0.0)  # P1 + P2 = Ps of an even valve
        s[P1] = carried + ratio * s[P2]
    else:
        s[P1] = carried + ratio * c.supply_Pa
    return s
