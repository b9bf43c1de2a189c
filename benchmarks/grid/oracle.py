"""The perfect inverse: volts that make the true leg, with its true numbers, follow the setpoint; what is left with them.

The volts minimise, from tick to tick on the leg's own equations (hysteresis and delays undone exactly),

    (60 Hz low pass of the acceleration error / 0.01 m/s2)^2 + (speed error / 1 mm/s)^2 + (position error / 0.1 mm)^2
    + (second difference of the volts / 30 mV)^2

by Gauss-Newton steps of the whole run at once: a backward Riccati recursion, a forward run of the equations with its feedback
(differential dynamic programming). Far from the answer the derivatives are taken with blunt edges, for a shut valve has none.
The volts, less what the position loop makes of the model's own reading, are then added to the loop of the true leg with its noise,
counts and tick, faded in over a second. Transducers' noise, the volts' counts and the jitter of the tick are what it cannot undo.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter

from benchmarks.grid import plant
from benchmarks.grid.legs import Leg
from benchmarks.grid.loop import COLUMNS, RATE_HZ, Bench, Run, run_of
from benchmarks.grid.motions import Motion
from benchmarks.grid.plant import AMP, GRAVITY, N_STATES, P1, P2, PS, TICK_S, XR, Z1, Z2, V, W, X, Y, compiled

B_LOW, A_LOW = map(np.asarray, butter(2, 60.0, fs=RATE_HZ) or ())
WEIGHTS = np.array([0.01, 1e-3, 1e-4, 0.03])  # m/s2 in the band, m/s, m, V of the second difference
SCALES = np.array([1e-4, 1e-3, 1e4, 1e4, 1e4, 1e-2, 1.0, 1e-2, 1e-6, 1e-6, 1e-3])  # of the states, for differences
BEFORE_S, FADE_S = 2.5, 1.0  # it begins so long before the second half, and is faded in
ROUNDS, ENOUGH, GOOD = (
    16,
    0.02,
    0.02,
)  # Gauss-Newton steps of a block; relative decrease, and cost a tick, that end them
BAD = 0.5  # cost a tick of a block that is tried again from another begin
BLOCK, KEEP = 100, 50  # ticks
DIFFERENCE_V = 1e-3
BLUNT = 0.5  # rounding of the blunt edges, over the overlap


@compiled
def tick(numbers, s, volts, time_s, pieces, k, mid):
    """A control tick of the leg, in place, with volts that arrive at its begin."""
    h = TICK_S / pieces
    for i in range(pieces):
        plant.step(s, volts, numbers[0], time_s + i * h, h, k, mid)


@compiled
def residual(before, after, wanted, k, filters, u, u1, u2, weights, b, a, r):
    """(4,) weighted residuals of tick k into r, the filter moved on. wanted (2, n): positions and speeds at the ticks."""
    error = (after[V] - before[V] - wanted[1, k + 1] + wanted[1, k]) / TICK_S
    out = b[0] * error + filters[0]
    filters[0], filters[1] = b[1] * error - a[1] * out + filters[1], b[2] * error - a[2] * out
    r[0], r[1] = out / weights[0], (after[V] - wanted[1, k + 1]) / weights[1]
    r[2], r[3] = (after[Y] - wanted[0, k + 1]) / weights[2], (u - 2.0 * u1 + u2) / weights[3]


@compiled
def roll(numbers, start, volts, states, gains, steps, share, wanted, begin_s, pieces, fixed, made, trail):
    """Runs the leg with volts + share steps + gains (state - states) from the extended state `start`: a leg's states, two of the filter,
    the last two volts. The new volts and states into `made` (n,) and `trail` (n + 1, ..). Returns the cost."""
    weights, b, a, active, scales = fixed
    n, m, cost = len(volts), len(active), 0.0
    s, filters, r = start[:N_STATES].copy(), start[N_STATES : N_STATES + 2].copy(), np.empty(4)
    k4, mid, before = np.empty((4, N_STATES)), np.empty(N_STATES), np.empty(N_STATES)
    u1, u2 = start[N_STATES + 2], start[N_STATES + 3]
    for k in range(n + 1):
        trail[k, :N_STATES] = s
        trail[k, N_STATES], trail[k, N_STATES + 1], trail[k, N_STATES + 2], trail[k, N_STATES + 3] = (
            filters[0],
            filters[1],
            u1,
            u2,
        )
        if k == n:
            break
        u = volts[k] + share * steps[k]
        for j in range(m):
            u += gains[k, j] * (s[active[j]] - states[k, active[j]]) / scales[active[j]]
        for j in range(4):
            u += gains[k, m + j] * (trail[k, N_STATES + j] - states[k, N_STATES + j])
        u = min(max(u, -plant.LIMIT_V), plant.LIMIT_V)
        made[k] = u
        before[:] = s
        tick(numbers, s, u, begin_s + k * TICK_S, pieces, k4, mid)
        residual(before, s, wanted, k, filters, u, u1, u2, weights, b, a, r)
        u2, u1 = u1, u
        cost += r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]
        if not cost < 1e12:
            return np.inf
    return cost


@compiled
def derivatives(blunt, s, u, time_s, pieces, fixed, F, J, room):
    """Of the extended state after a tick, and of its residuals, in units of the states' scales and in volts, into F and J; the last
    column is of the volts. blunt: the leg, its edges rounded."""
    weights, b, a, active, scales = fixed
    m = len(active)
    size, base, moved, k4, mid = m + 4, room[0], room[1], room[2:6], room[6]
    F[:], J[:] = 0.0, 0.0
    base[:] = s
    tick(blunt, base, u, time_s, pieces, k4, mid)
    for j in range(m + 1):
        moved[:] = s
        column, unit, more = (j, 1.0, 0.0) if j < m else (size, DIFFERENCE_V, DIFFERENCE_V)
        if j < m:
            moved[active[j]] += scales[active[j]]
        before = moved[V]
        tick(blunt, moved, u + more, time_s, pieces, k4, mid)
        for i in range(m):
            F[i, column] = (moved[active[i]] - base[active[i]]) / scales[active[i]] / unit
        error = ((moved[V] - base[V]) - (before - s[V])) / TICK_S / unit
        J[0, column] = b[0] * error / weights[0]
        J[1, column] = (moved[V] - base[V]) / unit / weights[1]
        J[2, column] = (moved[Y] - base[Y]) / unit / weights[2]
        F[m, column], F[m + 1, column] = (b[1] - a[1] * b[0]) * error, (b[2] - a[2] * b[0]) * error
    J[0, m] = 1.0 / weights[0]
    F[m, m], F[m, m + 1], F[m + 1, m] = -a[1], 1.0, -a[2]
    J[3, size], J[3, m + 2], J[3, m + 3] = 1.0 / weights[3], -2.0 / weights[3], 1.0 / weights[3]
    F[m + 2, size], F[m + 3, m + 2] = 1.0, 1.0


@compiled
def backward(blunt, volts, states, wanted, begin_s, pieces, fixed, damping, gains, steps):
    """Riccati recursion: feedback into gains (n, m + 4) and steps (n,)."""
    weights, b, a, active, _ = fixed
    n, size = len(volts), len(active) + 4
    value, slope = np.zeros((size, size)), np.zeros(size)
    F, J, filters, r, room = (
        np.zeros((size, size + 1)),
        np.zeros((4, size + 1)),
        np.empty(2),
        np.empty(4),
        np.empty((7, N_STATES)),
    )
    for k in range(n - 1, -1, -1):
        s = states[k, :N_STATES]
        derivatives(blunt, s, volts[k], begin_s + k * TICK_S, pieces, fixed, F, J, room)
        filters[0], filters[1] = states[k, N_STATES], states[k, N_STATES + 1]
        u1, u2 = states[k, N_STATES + 2], states[k, N_STATES + 3]
        residual(s, states[k + 1, :N_STATES], wanted, k, filters, volts[k], u1, u2, weights, b, a, r)
        H = J.T @ J + F.T @ (value @ F)
        g = J.T @ r + F.T @ slope
        h = H[size, size] * (1.0 + damping) + 1e-9
        gains[k] = -H[size, :size] / h
        steps[k] = -g[size] / h
        for i in range(size):
            slope[i] = g[i] + gains[k, i] * g[size] + steps[k] * (H[i, size] + gains[k, i] * H[size, size])
            for j in range(size):
                value[i, j] = (
                    H[i, j] + gains[k, i] * H[size, j] + gains[k, j] * (H[i, size] + gains[k, i] * H[size, size])
                )
        for i in range(size):
            for j in range(i):
                value[i, j] = value[j, i] = 0.5 * (value[i, j] + value[j, i])


@compiled
def improved(numbers, start, volts, wanted, begin_s, pieces, rough, blunt_m, fixed, volts2, states):
    """Gauss-Newton steps of a block until it is good or no step helps; the volts (n,) in place, states (n + 1, ..) filled. The cost."""
    active = fixed[3]
    n, size = len(volts), len(active) + 4
    trail, gains, steps = np.zeros((n + 1, N_STATES + 4)), np.zeros((n, size)), np.zeros(n)
    cost = roll(numbers, start, volts, states, gains, steps, 0.0, wanted, begin_s, pieces, fixed, volts2, trail)
    states[:] = trail
    blunt, sharp_m, damping = numbers.copy(), numbers[0].rounding_m, 1e-3
    for _ in range(ROUNDS):
        if cost < GOOD * n:
            break
        blunt[0].rounding_m = max(blunt_m, sharp_m)
        backward(blunt, volts, states, wanted, begin_s, rough, fixed, damping, gains, steps)
        found = np.inf
        for share in (1.0, 0.5, 0.2):
            found = roll(
                numbers, start, volts, states, gains, steps, share, wanted, begin_s, pieces, fixed, volts2, trail
            )
            if found < cost:
                break
        gone = 1.0 - found / cost
        if found < cost:
            volts[:], states[:], cost = volts2, trail, found
            damping = max(damping * 0.3, 1e-4)
        if gone < ENOUGH:
            if blunt_m <= sharp_m and damping > 10.0:
                break
            if blunt_m <= sharp_m and gone >= 0.0:
                break
            if blunt_m <= sharp_m:
                damping *= 30.0
            blunt_m = max(0.3 * blunt_m, sharp_m)
    return cost


@compiled
def receding(numbers, start, volts, wanted, begin_s, pieces, rough, blunt_m, fixed, states):
    """The whole run block after block, each begun where the last one's kept part ended. Returns the cost a tick."""
    n, at, total = len(volts), 0, 0.0
    now = start.copy()
    while at < n:
        stop = min(at + BLOCK, n)
        size = stop - at + 1, N_STATES + 4
        trail, trail2, volts2 = np.zeros(size), np.zeros(size), np.zeros(stop - at)
        time_s, cost = begin_s + at * TICK_S, np.inf
        guess = volts[at:stop].copy()
        for blunted in (blunt_m, 3.0 * blunt_m, 0.0):  # what one begin does not find another does
            block = guess.copy()
            found = improved(numbers, now, block, wanted[:, at:], time_s, pieces, rough, blunted, fixed, volts2, trail2)
            if found < cost:
                volts[at:stop], trail[:], cost = block, trail2, found
            if cost < BAD * (stop - at):
                break
        total += cost
        kept = min(KEEP, n - at)
        states[at : at + kept + 1] = trail[: kept + 1]
        now[:] = trail[kept]
        at += kept
    return total / n * KEEP / BLOCK


def active_states(c: Any) -> np.ndarray:
    """Indices of the states that this leg has."""
    found = [Y, V, P1, X, XR]
    found += [P2] if c.four_way > 0.5 else []
    found += [PS] if c.line_Pa_s_m3 > 0.0 else []
    found += [AMP] if c.amplifier_s > 0.0 else []
    found += [Z1, Z2] if c.bristle_N_m > 0.0 else []
    found += [W] if c.friction_lag_s > 0.0 else []
    return np.array(sorted(found))


@compiled
def shut_to_open(numbers, flow, p1, supply, time_s):
    """Spool [V] at which the valve's bottom side gives a flow."""
    c, s, out = numbers[0], np.zeros(N_STATES), np.empty(N_STATES)
    s[Y], s[P1], s[PS], s[P2] = 0.5 * c.stroke_m, p1, supply, 0.5 * supply
    volume = plant.capacity(s[Y] * c.area_bottom_m2 + c.dead_m3, p1, c)
    low, high = -plant.LIMIT_V, plant.LIMIT_V
    for _ in range(50):
        s[X] = 0.5 * (low + high)
        plant.rates(s, 0.0, c, time_s, out)
        if out[P1] * volume < flow:
            low = s[X]
        else:
            high = s[X]
    return 0.5 * (low + high)


def first_guess(leg: Leg, wanted: np.ndarray, begin_s: float) -> tuple[np.ndarray, np.ndarray]:
    """(n,) volts and bottom pressures of steady motion at each tick's speed, the spool's and the amplifier's lag undone."""
    c, v = leg.c, wanted[1]
    acceleration = np.gradient(v, TICK_S)
    share = 0.5 + 0.5 * np.tanh(v / 2e-3)
    level = np.where(v >= 0, c.coulomb_up_N, c.coulomb_down_N) * np.tanh(v / 5e-4)
    viscous = np.where(v >= 0, c.viscous_up_N_s_m, c.viscous_down_N_s_m) * v
    load = (c.mass_kg * (acceleration + GRAVITY) + c.friction * (level + viscous)) / c.area_bottom_m2
    load += c.spring_N_m * (wanted[0] - 0.5 * c.stroke_m) / c.area_bottom_m2
    r, supply = c.area_top_m2 / c.area_bottom_m2, c.supply_Pa
    if c.four_way > 0.5:  # equal edges: P2 = r^2 (Ps - P1) on the way out, Ps - P2 = r^2 P1 on the way in
        p1 = (load + supply * (share * r**3 + (1.0 - share) * r)) / (1.0 + r**3)
    else:
        p1 = load + r * supply
    p1 = np.clip(p1, 0.02 * supply, 0.98 * supply)
    numbers = leg.numbers
    z = np.array([shut_to_open(numbers, c.area_bottom_m2 * x, p, supply, begin_s) for x, p in zip(v, p1, strict=True)])
    z, w = gaussian_filter1d(z, 1.5), 2.0 * math.pi * c.spool_Hz
    u = z + 2.0 * c.damping / w * np.gradient(z, TICK_S) + np.gradient(np.gradient(z, TICK_S), TICK_S) / w**2
    return (u + c.amplifier_s * np.gradient(u, TICK_S))[:-1], p1


def begun(c: Any, wanted: np.ndarray, volts: float) -> np.ndarray:
    """States in steady motion at the demanded position and speed."""
    s, v = plant.balanced(c, float(wanted[0, 0])), float(wanted[1, 0])
    s[V], s[W], s[X], s[AMP] = v, abs(v), volts, volts
    up = v >= 0
    dry = (c.coulomb_up_N if up else c.coulomb_down_N) * (1.0 if up else -1.0)
    viscous = c.viscous_up_N_s_m if up else c.viscous_down_N_s_m
    s[P1] += c.friction * (dry + viscous * v) / c.area_bottom_m2
    if c.bristle_N_m > 0.0:
        s[Z1], s[Z2] = c.friction * dry * 0.5 / c.bristle_N_m, c.friction * dry * 0.5 * c.bristle_ratio / c.bristle_N_m
    return s


def inverted(leg: Leg, motion: Motion, begin_s: float, ticks: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Volts (ticks,) behind the hysteresis that follow the setpoint from an instant on, states (ticks + 1, ..) and the cost a tick."""
    c = leg.c
    t, h = begin_s + np.arange(ticks + 1) * TICK_S, 1e-4
    wanted = np.stack([motion.path(t), (motion.path(t + h) - motion.path(t - h)) / (2.0 * h)])
    volts, p1 = first_guess(leg, wanted, begin_s)
    start = np.r_[begun(c, wanted, float(volts[0])), 0.0, 0.0, volts[0], volts[0]]
    start[P1] = p1[0]
    fixed = (WEIGHTS, B_LOW, A_LOW, active_states(c), SCALES)
    states = np.zeros((ticks + 1, N_STATES + 4))
    rough = leg.pieces if c.bristle_N_m > 0.0 else leg.pieces // 2
    blunt_m = max(BLUNT * abs(c.overlap_m), 2.0 * c.rounding_m)
    cost = receding(leg.numbers, start, volts, wanted, begin_s, leg.pieces, rough, blunt_m, fixed, states)
    return volts, states, cost


@compiled
def undone(volts, c, plays, made):
    """Volts (n,) whose hysteresis gives `volts`; plays (2,): where it begins."""
    last = volts[0]
    for k in range(len(volts)):
        room, target = np.empty(2), volts[k]
        room[:] = plays
        if abs(plant.passed_plays(room, last, c) - target) > 1e-9:
            low, high = target - c.backlash_V - 0.1, target + c.backlash_V + 0.1
            for _ in range(40):
                last = 0.5 * (low + high)
                room[:] = plays
                if plant.passed_plays(room, last, c) < target:
                    low = last
                else:
                    high = last
            last = low if low > made[k - 1] else high  # at the near end of where it does not matter
        made[k] = last
        plant.passed_plays(plays, last, c)


def perfect(leg: Leg, motion: Motion, *, noise: int = 0) -> Run:
    """The true leg with the volts of the inverse, from BEFORE_S ahead of the second half on."""
    c, ticks = leg.c, round(motion.duration_s * RATE_HZ)
    first = round((motion.duration_s / 2 - BEFORE_S) * RATE_HZ)
    late_s = (
        c.computer_delay_s + c.valve_delay_s
    )  # volts sent at a tick act so much later: the inverse's ticks are those instants
    volts, states, cost = inverted(leg, motion, first / RATE_HZ + late_s, ticks - first)
    sent = np.empty(len(volts))
    undone(volts, leg.numbers[0], np.full(2, volts[0]), sent)
    at = (first + np.arange(len(volts))) / RATE_HZ
    seen = CubicSpline(first / RATE_HZ + late_s + np.arange(len(states)) * TICK_S, states[:, Y])(
        at - c.position_delay_s - c.position_lag_s
    )
    fade = np.clip((at - at[0]) / FADE_S, 0.0, 1.0)
    wanted = motion.sampled(ticks)
    added = np.zeros(ticks)
    added[first:] = fade * (sent - c.gain_V_m * (wanted[first:] - seen))
    bench, log = Bench(leg, motion, ticks, noise), np.zeros((len(COLUMNS), ticks))
    plant.driven(*bench.parts, wanted, added, log)
    return run_of(bench, motion, log, wanted, None, [], f"the perfect inverse, cost {cost:.3g} a tick")
