"""The estimator over time: windows of motion as they come, and passes of the fit spread over ticks.

Windows begin in motion, for near standstill a start state has local minima; each one that holds a reversal is taken, and every
second of the others. The fit begins with the noise thirty times as large as it is, so that the prior leads, and sharpens in stages;
at the last it goes on for as long as the machine moves, with the last `WINDOWS` windows. What an older one says of the numbers is kept
as a quadratic beside the prior (`_end_fold`) and fades within `MEMORY_S`. The last `KEPT` of them are looked at again in turn, so that
their quadratics are about the numbers of now.
"""

from __future__ import annotations

from math import exp, log, sqrt, tanh

import numpy as np

from ..arithmetic import copy, copy_rows, next_noise
from ..compensator import MEASURED_TICKS
from ..compiled import compiled
from .fit import (
    KNOT,
    KNOTS,
    LEAD,
    N_START,
    N_STATE,
    WINDOW,
    backward,
    begin_window,
    behind_backlash,
    cholesky,
    colour_of,
    eliminate,
    forward,
    read_tick,
    tick_window,
    variances,
)  # fmt: skip
from .layout import HISTORY, KEPT, OLDER, WAITING, WINDOWS
from .leg import (
    AMP_LAG,
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    DELAY,
    DRIFT,
    GIVE,
    HOLD,
    LN_SPOOL,
    LN_STRIBECK,
    MASS,
    N_NUMBERS,
    PLAY,
    REG,
    S_FOUR_WAY,
    SPREAD,
    STATIC_DN,
    STATIC_UP,
    VISCOUS_DN,
    VISCOUS_UP,
    ZETA,
    V,
    Z,
    valve_lag_s,
)  # fmt: skip
from .prior import LEGS_ALIKE, add_prior, fill_prior

HEATS = (30.0, 10.0, 3.0, 1.0)  # of the noise, by stages
LAST_STAGE = len(HEATS) - 1
MOST_STEPS = 8  # passes of a stage
MOST_STEP = 1.0  # of a number at once, in its prior's standard deviations: farther the derivatives say nothing
LEAST_GAIN = 0.1  # of the cost, by a step: a third of a standard deviation of one number
STAGE_GAIN = 1.0  # the same before the last stage: one standard deviation of one number, in a noise that is too large
FEWEST = 5  # windows with which it begins, two with a reversal among them
# of a stage's first step, over the diagonal: numbers that trade need nearly none, and before they are settled their doubt is no doubt
DAMPING, FIRST_DAMPING, MOST_DAMPING = 1e-4, 1e-3, 1e3
ROUNDS = 6  # of a step, in which numbers meet their bounds
# misfit from which the leg is not one that the model knows: what it lacks is as much as the noise. Below, doubt grows with it; of all
# windows but one, also that from which other minima are tried. With 4, legs of too slow a spool engaged with 15 times the bump
KNOWN_LEG = 2.0
CHANGED_LEG = 10.0  # misfit from which a known leg has changed: three times the noise throughout
BETTER = 0.8  # of the misfit beyond noise: from which another minimum is preferred
NOISE_MISFIT = 1.5  # of a fit to windows of the same leg: half as much beside the noise as noise
# Other minima that are tried about what was found, in turn: a stiffer bristle; a spool that has all of the valve's lag, which is known
# better than its parts; a faster one; a wider backlash: by ELSEWHERE of the prior's standard deviations
BRISTLE, ALL_SPOOL, FAST_SPOOL, WIDE = range(4)
TRIES, ELSEWHERE, SHORTEST_LAG_s = WIDE + 1, 1.5, 1e-4  # a lag far below a tick
STARTS = 2  # of `folding`: a pass over one window for its start
MEMORY_S = 30.0  # in which what older windows said fades: seals and oil warm up within some 20 s at the fastest
# window ticks a tick: while the doubt costs more than the inverse leaves, and when it does not. With 14, passes came too late: numbers
# were half found when the volts came in, and the curvature there is no doubt
WORK, CALM_WORK = 42, 8
HALF_SPAN = 8  # ticks on either side of a speed
FAST_m_s, FAST_SHARE = 0.02, 0.4  # speed in which windows begin; share of the fastest of late, of a slow motion
BACK = 60  # ticks by which a window may begin earlier to begin in motion
LATE = WINDOW + BACK + HALF_SPAN + LEAD
# [m, Pa] of the model's steps and of straight volts within them: what is left where nothing else is
STEP_ERROR = (1e-6, 2e3)
FORGET_TICKS = 2000.0  # of the fastest speed of late: two periods of a sine of 0.5 Hz
JITTER_s = 1e-4  # of a clock, before it is measured: a twentieth of a tick of 2 ms
# of another leg's dry friction, within a knot: by the steady law, and of its own fit, while this leg's misfit may come from there
FRICTION_ERROR, FITTED_ERROR = 0.2, 0.1
# when both fits are settled, measured against the plant's own, and where the leg turns by its own fit
SETTLED_ERROR, SETTLED_TURNING = 0.02, 0.05
SETTLED = 2  # of a leg that is heard: so is its fit; 1: it is not
TURNING_ERROR = 0.58  # of one that may stand, unfitted: evenly likely between friction down and up, 1/sqrt(3)
# orthonormal columns of a parabola through as many forces as a speed is measured from
ARC = np.linalg.qr(np.vander(np.arange(-MEASURED_TICKS, MEASURED_TICKS + 1.0), 3, increasing=True))[0]
# a parabola through nine readings: its value and slope [1/tick] at the first
START_Y_ROW, START_V_ROW = np.linalg.pinv(np.vander(np.arange(9.0), 3, increasing=True))[:2]


@compiled
def is_known_leg(chi2):
    """Whether misfits chi2 (2,) are those of a leg that the model knows."""
    return max(chi2[0], chi2[1]) <= KNOWN_LEG


@compiled
def is_settled(s):
    """Whether the fit has been known to be the leg's, and is."""
    return s.fit.was_known != 0 and is_known_leg(s.fit.chi2)


@compiled
def _watch_noise(past, a, b, c, d, e, tick_s):
    """One more reading, a to e the last five: the position's noise where it stands, and the clock's jitter by that where it moves."""
    moved = past.jitter_s * (a - e) / (4.0 * tick_s)
    total = sqrt(past.noise_m * past.noise_m + moved * moved)
    grows = next_noise(total, a, b, c, d, e) / total - 1.0
    share = moved * moved / (total * total)
    past.noise_m *= 1.0 + (1.0 - share) * grows
    past.jitter_s *= 1.0 + share * grows


@compiled
def watch(past, position_m, bottom_Pa, top_Pa, supply_Pa, volts_before, tick_s):
    """One tick into the history. volts_before: what was sent at the tick before."""
    k = past.ticks & (HISTORY - 1)
    if past.ticks == 0:
        past.supply_mean_Pa = supply_Pa
        past.jitter_s = JITTER_s
        for j in range(HISTORY):
            past.volts[j] = volts_before
    past.supply_mean_Pa += 0.1 * (supply_Pa - past.supply_mean_Pa)
    past.position_m[k], past.bottom_Pa[k], past.top_Pa[k] = position_m, bottom_Pa, top_Pa
    past.supply_Pa[k] = supply_Pa
    past.volts[(past.ticks - 1) & (HISTORY - 1)] = volts_before
    past.ticks += 1
    if past.ticks > 8:
        m, y, p = HISTORY - 1, past.position_m, past.bottom_Pa
        i, j, n, o = (k - 1) & m, (k - 2) & m, (k - 3) & m, (k - 4) & m
        _watch_noise(past, y[k], y[i], y[j], y[n], y[o], tick_s)
        past.noise_Pa = next_noise(past.noise_Pa, p[k], p[i], p[j], p[n], p[o])


@compiled
def watch_legs(past, pose_m_s2, mobility, forces_N, speeds_m_s):
    """The platform's legs MEASURED_TICKS before this tick into the history."""
    k = (past.ticks - 1 - MEASURED_TICKS) & (HISTORY - 1)
    past.pose_m_s2[k] = pose_m_s2
    for i in range(len(forces_N)):
        past.forces_N[k, i], past.speeds_m_s[k, i], past.mobility[k, i] = forces_N[i], speeds_m_s[i], mobility[i]


@compiled
def _speed(past, k, tick_s):
    m = HISTORY - 1
    return (past.position_m[(k + HALF_SPAN) & m] - past.position_m[(k - HALF_SPAN) & m]) / (2.0 * HALF_SPAN * tick_s)


@compiled
def slowest_m_s(past, tick_s):
    """Speed whose sign is certain: four standard deviations of one measured over half a span, and more."""
    return 4.0 * past.noise_m / (HALF_SPAN * tick_s)


@compiled
def _force_noise2(s):
    """Variance of a leg's measured force [N2]: transducers of all legs are taken to be alike."""
    top = s.settings.area_top_m2 if s.sheet[S_FOUR_WAY] != 0.0 else 0.0
    return (s.settings.area_bottom_m2**2 + top**2) * s.past.noise_Pa**2


@compiled
def _quiet_force(past, k, i, noise2):
    """Leg i's force at tick k [N]: a parabola's, and of what that leaves the share that is not noise of variance noise2 [N2]
    (the local filter of Lee, 1980). Noise of a force moves the model, and the fit takes numbers that let less of it through; a parabola
    alone would blur the jump of friction where the leg turns."""
    middle, n = past.forces_N[k, i], len(ARC)
    flat = slope = bend = total = 0.0
    for j in range(n):
        force = past.forces_N[(k + j - MEASURED_TICKS) & (HISTORY - 1), i] - middle
        flat += ARC[j, 0] * force
        slope += ARC[j, 1] * force
        bend += ARC[j, 2] * force
        total += force * force
    found = ARC[MEASURED_TICKS, 0] * flat + ARC[MEASURED_TICKS, 1] * slope + ARC[MEASURED_TICKS, 2] * bend
    left2 = (total - flat * flat - slope * slope - bend * bend) / (n - 3)
    return middle + min(noise2 / left2, 1.0) * found if left2 > 0.0 else middle


@compiled
def collect(s):
    """Takes a window where one is due. Returns whether it did."""
    past, settings, m = s.past, s.settings, HISTORY - 1
    tick_s, now = settings.tick_s, past.ticks - 1
    if now < LATE:
        past.begin = now
        return False
    speed = abs(_speed(past, now - HALF_SPAN, tick_s))
    past.fastest_m_s = max(speed, past.fastest_m_s * (1.0 - 1.0 / FORGET_TICKS))
    if past.begin < now - (HISTORY - LEAD - HALF_SPAN - 4) + BACK:
        past.begin = now - WINDOW - HALF_SPAN - 1
    if now < past.begin + WINDOW + HALF_SPAN + 1:
        return False
    limit = min(FAST_m_s, FAST_SHARE * past.fastest_m_s)
    if limit < slowest_m_s(past, tick_s):
        past.begin += HALF_SPAN
        return False
    at = past.begin
    while abs(_speed(past, at, tick_s)) <= limit and at > past.begin - BACK:
        at -= 2
    if abs(_speed(past, at, tick_s)) <= limit:
        past.begin += HALF_SPAN
        return False
    first = _speed(past, at, tick_s)
    slowest, turned = abs(first), False
    for j in range(at, at + WINDOW, 4):
        speed = _speed(past, j, tick_s)
        slowest = min(slowest, abs(speed))
        turned = turned or speed * first < 0.0
    past.begin, past.odd = at + WINDOW, 1 - past.odd
    if not (slowest < limit or past.odd) or s.fit.waiting >= WAITING:
        return False
    window = s.windows[OLDER + 1 + s.fit.waiting]
    s.fit.waiting += 1
    mean, noise2 = 0.0, _force_noise2(s)
    for j in range(WINDOW):
        k = (at + j) & m
        window.position_m[j], window.bottom_Pa[j], window.top_Pa[j] = (
            past.position_m[k],
            past.bottom_Pa[k],
            past.top_Pa[k],
        )
        window.supply_Pa[j], window.pose_m_s2[j] = 0.0, past.pose_m_s2[k]
        for i in range(-HALF_SPAN, HALF_SPAN + 1):
            window.supply_Pa[j] += past.supply_Pa[(at + j + i) & m] / (2 * HALF_SPAN + 1)
        if s.platform:
            for i in range(settings.legs):
                window.forces_N[j, i] = _quiet_force(past, k, i, noise2)
            copy(past.speeds_m_s[k], window.speeds_m_s[j])
            copy(past.mobility[k], window.mobility[j])
            window.fitted[j] = 0
        mean += past.bottom_Pa[k] * settings.area_bottom_m2 - past.top_Pa[k] * settings.area_top_m2
    for j in range(LEAD + WINDOW):
        window.volts[j] = past.volts[(at - LEAD + j) & m]
    window.first, window.tells, window.begun = at, 0, 0
    window.measured[:] = 0.0
    for j in range(9):
        window.measured[0] += START_Y_ROW[j] * window.position_m[j]
        window.measured[1] += START_V_ROW[j] * window.position_m[j] / tick_s
    for j in range(3):
        window.measured[2] += window.bottom_Pa[j] / 3.0
        window.measured[3] += window.top_Pa[j] / 3.0
    copy(window.measured, window.start)
    window.reversal = 1.0 if turned or slowest < limit else 0.0
    past.force_ticks = min(past.force_ticks + 1.0, 40.0)
    past.force_N += (mean / WINDOW - past.force_N) / past.force_ticks
    return True


@compiled
def _take_waiting(s):
    """Windows that waited for the end of a pass come in; the oldest go."""
    fit = s.fit
    for n in range(fit.waiting):
        s.windows[fit.seen % WINDOWS] = s.windows[OLDER + 1 + n]
        fit.seen += 1
        fit.count = min(fit.count + 1, WINDOWS)
    taken = fit.waiting > 0
    fit.waiting = fit.to_fold = 0
    return taken


@compiled
def _begin_fold(s):
    """A pass over one of the windows that are about to go, at the settled numbers, for what it says of them. Returns whether there is
    one: not while the fit is in search, nor of a leg that was never the model's."""
    fit = s.fit
    if not fit.settled or not fit.has_best or not (fit.was_known or is_known_leg(fit.chi2)):
        return False
    while fit.to_fold < fit.waiting:
        place = fit.seen + fit.to_fold
        fit.to_fold += 1
        if place >= WINDOWS:
            _start_pass(s, fit.best.numbers, False)
            copy(fit.best.start[place % WINDOWS], fit.trial.start[place % WINDOWS])
            fit.at_window, fit.folding = place % WINDOWS, 1
            return True
    return False


@compiled
def _copy_window(source, target):
    """What was measured in a window, and what is known of it."""
    copy(source.position_m, target.position_m)
    copy(source.bottom_Pa, target.bottom_Pa)
    copy(source.top_Pa, target.top_Pa)
    copy(source.supply_Pa, target.supply_Pa)
    copy(source.load_N, target.load_N)
    copy(source.volts, target.volts)
    copy(source.measured, target.measured)
    copy(source.doubt_N, target.doubt_N)
    target.first = source.first


@compiled
def _begin_look(s):
    """A pass over an older window at the settled numbers: what it said was in the linearisation at those of that time. In turn, as
    many between two fits as a pass sees. Returns whether there is one."""
    fit, window = s.fit, s.windows[OLDER]
    if not fit.settled or not fit.has_best or fit.looked >= min(WINDOWS, fit.kept):
        return False
    fit.looked += 1
    fit.again = (fit.again + 1) % min(fit.kept, KEPT)
    kept = s.older[fit.again]
    _copy_window(kept, window)
    _start_pass(s, fit.best.numbers, False)
    copy(kept.start, fit.trial.start[OLDER])
    fit.at_window, fit.folding = OLDER, 1
    return True


@compiled
def _begin_start(s):
    """A pass over a window that came in, for where it starts by the numbers as they are: as it was measured it would cost more than what
    a step of the numbers gains. Returns whether there is one."""
    fit = s.fit
    if not fit.has_best:
        return False
    for n in range(fit.count):
        window = s.windows[n]
        if not window.begun:
            window.begun = 1
            if s.platform:
                _load_windows(s, fit.best.numbers, n, n + 1)
            _start_pass(s, fit.best.numbers, False)
            copy(window.start, fit.trial.start[n])
            fit.at_window, fit.folding = n, STARTS
            return True
    return False


@compiled
def _best_start(fit, n, start):
    """Where window n starts best at the numbers of the pass, into start (N_START,)."""
    for j in range(fit.starts):
        start[j] = fit.trial.start[n, j] + fit.trial.kb[n, j] * fit.scale[N_NUMBERS + j]


@compiled
def _keep_window(s, n):
    """A place for a window that goes, instead of the oldest one, whose quadratic stays as it is."""
    fit, window = s.fit, s.windows[n]
    kept = s.older[fit.kept % KEPT]
    fit.kept += 1
    _copy_window(window, kept)
    fade = exp(-(window.first - fit.folded_until) * s.settings.tick_s / MEMORY_S)
    fit.folded_until = window.first
    fit.folded_H *= fade
    fit.folded_g *= fade
    fit.folded_cost *= fade


@compiled
def _count_in(fit, kept, times):
    """The quadratic of an older window into the sum of all, or out of it."""
    place = 0
    for a in range(N_NUMBERS):
        for b in range(a + 1):
            each = times * kept.H[place]
            fit.folded_H[a, b] += each
            if b < a:
                fit.folded_H[b, a] += each
            place += 1
        fit.folded_g[a] += times * kept.g[a]
    fit.folded_cost += times * kept.cost


@compiled
def _end_fold(s, n):
    """What window n says of the numbers is kept as a quadratic about the settled ones, its noise as large as its misfit; what was kept
    before fades."""
    fit, trial = s.fit, s.fit.trial
    if n == OLDER:
        kept = s.older[fit.again]
    else:
        _keep_window(s, n)
        kept = s.older[(fit.kept - 1) % KEPT]
    faded = exp(-(fit.folded_until - kept.first) * s.settings.tick_s / MEMORY_S)
    if n == OLDER:
        _count_in(fit, kept, -faded * kept.weight)
    rows = 2.0 * WINDOW if s.sheet[S_FOUR_WAY] != 0.0 else 1.0 * WINDOW
    misfit = max(1.0, trial.chi[n, 0] / WINDOW, trial.chi[n, 1] / rows)
    kept.weight = 1.0 / misfit if misfit <= CHANGED_LEG else 0.0  # of a leg that it was before
    _best_start(fit, n, kept.start)
    for a in range(N_NUMBERS):
        fit.a[a] = (trial.numbers[a] - fit.mean[a]) / fit.sd[a]
    kept.cost, place = 0.0, 0
    for a in range(N_NUMBERS):
        pull = 0.0
        for b in range(N_NUMBERS):
            pull += (trial.H[a, b] if b <= a else trial.H[b, a]) * fit.a[b]
            if b <= a:
                kept.H[place] = trial.H[a, b]
                place += 1
        kept.g[a] = trial.g[a] + pull
        kept.cost += (2.0 * trial.g[a] + pull) * fit.a[a]
    _count_in(fit, kept, faded * kept.weight)


@compiled
def _forget_folded(fit):
    """What older windows said is no longer true."""
    fit.folded_H[:, :] = 0.0
    fit.folded_g[:] = 0.0
    fit.folded_cost = 0.0
    fit.kept = fit.again = 0


@compiled
def friction(n, v, noise_m_s):
    """Steady friction [N] of numbers n (N_NUMBERS,) at a speed v that is measured with an error: what its sign is known as."""
    up = v >= 0.0
    dry = n[COULOMB_UP if up else COULOMB_DN] + n[STATIC_UP if up else STATIC_DN] * exp(-abs(v) / exp(n[LN_STRIBECK]))
    return dry * tanh(v / (n[REG] + noise_m_s)) + n[VISCOUS_UP if up else VISCOUS_DN] * v


@compiled
def speed_error(s):
    """Four standard deviations of a measured speed [m/s]."""
    return 4.0 * s.past.noise_m / (2.0**0.5 * HALF_SPAN * s.settings.tick_s)


@compiled
def _turns(window, i, k, noise_m_s):
    """Whether leg i may stand or turn at tick k: its speed, measured over a span, is less than how it changes within half of it."""
    a, b = max(k - HALF_SPAN, 0), min(k + HALF_SPAN, WINDOW - 1)
    changes = abs(window.speeds_m_s[b, i] - window.speeds_m_s[a, i])
    return abs(window.speeds_m_s[k, i]) < 0.5 * changes + noise_m_s


@compiled
def _doubt_loads(s, window, noise_m_s):
    """How uncertain the mean of what the other legs give is in each knot [N]: by the noise of their forces and by their friction."""
    settings, passed = s.settings, 0.0
    settled = is_settled(s)
    for i in range(settings.legs):
        if i != settings.leg:
            passed += s.mobility[i] * s.mobility[i]
    window.doubt_N[:] = passed * _force_noise2(s) / KNOT
    for i in range(settings.legs):
        if i == settings.leg:
            continue
        n = s.others[i]
        dry = s.mobility[i] * 0.5 * (n[COULOMB_UP] + n[COULOMB_DN] + n[STATIC_UP] + n[STATIC_DN])
        sure = settled and s.heard[i] == SETTLED
        for q in range(KNOTS):
            share = SETTLED_ERROR if sure else FITTED_ERROR
            for k in range(q * KNOT, (q + 1) * KNOT):
                fitted = window.fitted[k, i] != 0
                if _turns(window, i, k, noise_m_s):
                    share = max(share, SETTLED_TURNING if fitted else TURNING_ERROR)
                elif not (fitted or sure):
                    share = max(share, FRICTION_ERROR)
            window.doubt_N[q] += (share * dry) ** 2
    for q in range(KNOTS):
        window.doubt_N[q] = sqrt(window.doubt_N[q])


@compiled
def _load_windows(s, numbers, first, last):
    """What the other legs give this one in the windows first to last - 1 [N], by their measured forces less their friction, and how
    uncertain that is.

    y'' = N/m (f - F0 - F - K y), N the mobility: of the others' motion only their friction is not measured. A leg of which nothing is
    known yet is taken to be like this one, its F0 the mean of its forces.
    """
    fit, settings = s.fit, s.settings
    for i in range(settings.legs):
        if i != settings.leg and not s.heard[i]:
            copy(numbers, s.others[i])
            s.mean_N[i] = 0.0
            for w in range(fit.count):
                for k in range(WINDOW):
                    s.mean_N[i] += s.windows[w].forces_N[k, i] / (WINDOW * fit.count)
    noise = speed_error(s)
    for w in range(first, last):
        window = s.windows[w]
        before = 0.0
        _doubt_loads(s, window, noise)
        for k in range(WINDOW):
            load = numbers[MASS] * window.pose_m_s2[k]
            for i in range(settings.legs):
                if i != settings.leg:
                    if window.fitted[k, i] == 0:
                        window.others_N[k, i] = friction(s.others[i], window.speeds_m_s[k, i], noise)
                    hold = s.others[i, HOLD] if s.heard[i] else s.mean_N[i]
                    load -= window.mobility[k, i] * (window.forces_N[k, i] - hold - window.others_N[k, i])
            window.load_N[k] = load
            if k > 0:
                window.load_N[k - 1] = 0.5 * (before + load)  # it acts between two ticks
            before = load


@compiled
def _start_pass(s, numbers, fresh):
    """A pass at numbers; fresh: windows start from what they have, and nothing is known to compare with."""
    fit = s.fit
    if fresh:
        fit.has_best = 0
        fit.noise[0] = max(s.past.noise_m, STEP_ERROR[0])  # as it was for all passes that are compared
        fit.noise[1] = max(s.past.noise_Pa, STEP_ERROR[1])
        fit.jitter_s = s.past.jitter_s
        fit.colour, fit.new = colour_of(fit.rough_before)
        for w in range(fit.count):
            copy(s.windows[w].start, fit.trial.start[w])
    copy(numbers, fit.trial.numbers)
    fit.rough[:] = 0.0
    fit.trial.H[:, :] = 0.0
    fit.trial.g[:] = 0.0
    fit.trial.cost = 0.0
    fit.starts = N_STATE
    if s.platform:
        fit.starts = N_START
        if fresh:
            _load_windows(s, numbers, 0, fit.count)
            _take_told(s)
    fit.at_window = fit.at_tick = 0
    fit.running = 1


@compiled
def _drift(numbers, time_s):
    """Numbers (N_NUMBERS,) whose edges are those of the first tick become those of time_s later."""
    numbers[DEAD_UP] += numbers[DRIFT] * time_s
    numbers[DEAD_DN] -= numbers[DRIFT] * time_s


@compiled
def _noise_m(s, window, k):
    """Of the position read at tick k of a window: a clock that jitters reads a moving piston elsewhere."""
    first, last = max(k - HALF_SPAN, 0), min(k + HALF_SPAN, WINDOW - 1)
    speed = (window.position_m[last] - window.position_m[first]) / ((last - first) * s.settings.tick_s)
    return sqrt(s.fit.noise[0] ** 2 + (s.fit.jitter_s * speed) ** 2)


@compiled
def _work_tick(s):
    """One window tick of the pass."""
    fit, trial = s.fit, s.fit.trial
    n, k = fit.at_window, fit.at_tick
    window, heat = s.windows[n], HEATS[fit.stage]
    age_s = window.first * s.settings.tick_s
    if k == 0:
        copy(trial.numbers, fit.of_window)
        _drift(fit.of_window, age_s)
        copy(window.doubt_N, fit.scale[N_NUMBERS + N_STATE :])
        behind_backlash(
            window.volts, trial.numbers[PLAY], trial.numbers[SPREAD], fit.arriving, fit.by_half, fit.by_spread
        )
        begin_window(
            fit.x,
            fit.S,
            fit.of_window,
            s.sheet,
            trial.start[n],
            fit.arriving,
            fit.by_half,
            fit.by_spread,
            fit.d_now,
            fit.d_before,
        )
        fit.A[:, :] = 0.0
        fit.B[:, :] = 0.0
        fit.C[:, :] = 0.0
        fit.a[:] = 0.0
        fit.b[:] = 0.0
        trial.chi[n, 0] = trial.chi[n, 1] = 0.0
    trial.friction_N[n, k] = (
        fit.x[Z] / trial.numbers[GIVE] + fit.x[V] * trial.numbers[VISCOUS_UP if fit.x[V] >= 0.0 else VISCOUS_DN]
    )
    read_tick(
        fit, k, age_s, s.sheet, window.position_m[k], window.bottom_Pa[k], window.top_Pa[k], _noise_m(s, window, k) * heat,
        fit.noise[1] * heat, trial.chi[n],
    )  # fmt: skip
    fit.at_tick += 1
    if fit.at_tick < WINDOW:
        tick_window(
            fit.x, fit.S, k, fit.d_now, fit.d_before, fit.of_window, s.sheet, trial.start[n], fit.starts,
            fit.arriving, fit.by_half, fit.by_spread, window.supply_Pa[k],
            window.load_N[k], fit.w,
        )  # fmt: skip
        return
    trial.cost += trial.chi[n, 0] + trial.chi[n, 1]
    for j in range(fit.starts):
        d = (window.measured[j] - trial.start[n, j]) / fit.scale[N_NUMBERS + j]
        fit.C[j, j] += 1.0
        fit.b[j] += d
        trial.cost += d * d
    # cost: where the start is the best one for these numbers, not the one that the last ones asked for
    trial.cost -= eliminate(fit.starts, fit.A, fit.B, fit.C, fit.a, fit.b, trial.H, trial.g, trial.KB[n], trial.kb[n])
    fit.at_tick = 0
    fit.at_window += 1


@compiled
def _propose(s):
    """A step from the best pass into `trial`, damped; False where it promises none. A number that would leave its bounds stays on the
    bound, and the others are solved for again."""
    fit, best = s.fit, s.fit.best
    fit.held[:] = 0.0
    for _ in range(ROUNDS):
        for a in range(N_NUMBERS):
            fit.a[a] = best.g[a]
        for a in range(N_NUMBERS):
            for b in range(a + 1):
                fit.L[a, b] = best.H[a, b]
                if a != b:
                    fit.a[a] -= best.H[a, b] * fit.held[b] * fit.step_to[b]
                    fit.a[b] -= best.H[a, b] * fit.held[a] * fit.step_to[a]
                    if fit.held[a] + fit.held[b] > 0.0:
                        fit.L[a, b] = 0.0
            fit.L[a, a] *= 1.0 + fit.damping
        for a in range(N_NUMBERS):
            if fit.held[a] > 0.0:
                fit.L[a, a], fit.a[a] = 1.0, fit.step_to[a]
        if not cholesky(fit.L, N_NUMBERS):
            return False
        forward(fit.L, N_NUMBERS, fit.a)
        backward(fit.L, N_NUMBERS, fit.a)
        more = False
        for k in range(N_NUMBERS):
            low = max((fit.low[k] - best.numbers[k]) / fit.sd[k], -MOST_STEP)
            high = min((fit.high[k] - best.numbers[k]) / fit.sd[k], MOST_STEP)
            if fit.held[k] == 0.0 and (fit.a[k] < low or fit.a[k] > high):
                fit.held[k], fit.step_to[k], more = 1.0, low if fit.a[k] < low else high, True
        if not more:
            break
    for k in range(N_NUMBERS):
        value = min(max(best.numbers[k] + fit.a[k] * fit.sd[k], fit.low[k]), fit.high[k])
        fit.a[k] = (value - best.numbers[k]) / fit.sd[k]
        fit.proposed[k] = value
    fit.gain = 0.0
    for a in range(N_NUMBERS):
        pull = best.H[a, a] * fit.a[a]
        for b in range(a):
            pull += 2.0 * best.H[a, b] * fit.a[b]
        fit.gain += (2.0 * best.g[a] - pull) * fit.a[a]
    if fit.gain < 0.0:  # what numbers held on bounds ask of the others
        return False
    for n in range(fit.count):
        copy(s.windows[n].doubt_N, fit.scale[N_NUMBERS + N_STATE :])
        for j in range(fit.starts):
            step = best.kb[n, j]
            for k in range(N_NUMBERS):
                step -= best.KB[n, j, k] * fit.a[k]
            fit.trial.start[n, j] = best.start[n, j] + step * fit.scale[N_NUMBERS + j] / (1.0 + fit.damping)
    return True


@compiled
def _misfit(fit, four_way, chi2):
    """Mean squared residuals of position and pressures of the best pass, in units of the noise: chi2 (2,)."""
    rows = fit.count * WINDOW
    chi2[0] = chi2[1] = 0.0
    for n in range(fit.count):
        chi2[0] += fit.best.chi[n, 0] / rows
        chi2[1] += fit.best.chi[n, 1] / (2.0 * rows if four_way else rows)


@compiled
def _misfit_throughout(fit, four_way, chi2):
    """The larger misfit of position and pressures without its worst window: what another leg or another minimum shows in all of them.
    chi2 (2,): as `_misfit`."""
    largest = 0.0
    for channel in range(2):
        worst = 0.0
        for n in range(fit.count):
            worst = max(worst, fit.best.chi[n, channel])
        worst /= WINDOW * (2.0 if channel == 1 and four_way else 1.0)
        largest = max(
            largest, (fit.count * chi2[channel] - worst) / (fit.count - 1) if fit.count > 1 else chi2[channel]
        )
    return largest


@compiled
def _take_along(H, k, m, times):
    """Information H (lower) of numbers of which m has become m + times k: k's row less `times` m's, in both directions."""
    for j in range(N_NUMBERS):
        if j != k:
            H[max(j, k), min(j, k)] -= times * H[max(j, m), min(j, m)]
    H[k, k] -= times * (2.0 * H[max(k, m), min(k, m)] + times * H[m, m])


@compiled
def _keep_known(s):
    """What the last stage has found, with its covariance's factor and the misfit just taken (`_misfit`); edges as they are now."""
    fit, best, known = s.fit, s.fit.best, s.known
    now_s = s.past.ticks * s.settings.tick_s
    for a in range(N_NUMBERS):
        for b in range(a + 1):
            fit.L[a, b] = best.H[a, b]
    _take_along(fit.L, DRIFT, DEAD_UP, now_s * fit.sd[DRIFT] / fit.sd[DEAD_UP])
    _take_along(fit.L, DRIFT, DEAD_DN, -now_s * fit.sd[DRIFT] / fit.sd[DEAD_DN])
    if not cholesky(fit.L, N_NUMBERS):
        return
    copy_rows(fit.L, known.factor)
    copy(best.numbers, known.numbers)
    _drift(known.numbers, now_s)
    copy(fit.sd, known.sd)
    copy(fit.chi2, known.chi2)
    known.valid = 1
    if s.platform:
        _keep_alone(fit, known)


@compiled
def _keep_alone(fit, known):
    """What is known without the other legs, within the bounds: nobody is told what it has told."""
    for a in range(N_NUMBERS):
        for b in range(a + 1):
            fit.L[a, b] = fit.best.H[a, b]
        fit.L[a, a] -= fit.told_weight[a]
    if not cholesky(fit.L, N_NUMBERS):
        return
    for a in range(N_NUMBERS):
        fit.a[a] = fit.best.g[a] + fit.told_weight[a] * ((fit.best.numbers[a] - fit.mean[a]) / fit.sd[a] - fit.told[a])
    forward(fit.L, N_NUMBERS, fit.a)
    backward(fit.L, N_NUMBERS, fit.a)
    spread = max(1.0, known.chi2[0], known.chi2[1])
    for k in range(N_NUMBERS):
        alone = min(max(fit.best.numbers[k] + fit.a[k] * fit.sd[k], fit.low[k]), fit.high[k])
        known.alone[k] = (alone - fit.kind_mean[k]) / fit.kind_sd[k]
    variances(fit.L, spread, known.alone_variance, fit.a)
    for k in range(N_NUMBERS):
        known.alone_variance[k] *= (fit.sd[k] / fit.kind_sd[k]) ** 2


@compiled
def _take_told(s):
    """What the other legs know of the numbers: legs differ about a mean that is uncertain itself, by a spread that is uncertain too."""
    for k in range(N_NUMBERS):
        if k != HOLD:
            _tell_number(s, k)


@compiled
def _tell_number(s, k):
    """Mean and variance of number k of this leg by the others', over the spreads that all legs' numbers leave likely."""
    fit, legs, own = s.fit, s.settings.legs, s.settings.leg
    odds, means, variances = fit.w[0:4], fit.w[4:8], fit.w[8:12]
    fit.told[k] = fit.told_weight[k] = 0.0
    most = -1e300
    for t in range(len(LEGS_ALIKE)):
        between = LEGS_ALIKE[t] * LEGS_ALIKE[t]
        total = mean = square = log_total = 0.0
        for i in range(legs):
            if s.heard[i] and i != own:
                weight = 1.0 / (between + s.alone_variance[i, k])
                total += weight
                mean += weight * s.alone[i, k]
                square += weight * s.alone[i, k] * s.alone[i, k]
                log_total += log(weight)
        if total == 0.0:
            return
        means[t], variances[t] = mean / total, between + 1.0 / total
        if s.known.valid:
            weight, value = 1.0 / (between + s.known.alone_variance[k]), s.known.alone[k]
            total += weight
            mean += weight * value
            square += weight * value * value
            log_total += log(weight)
        odds[t] = 0.5 * (log_total - log(total) - square + mean * mean / total)
        most = max(most, odds[t])
    total = 0.0
    for t in range(len(LEGS_ALIKE)):
        odds[t] = exp(odds[t] - most)
        total += odds[t]
        fit.told[k] += odds[t] * means[t]
    fit.told[k] /= total
    variance = 0.0
    for t in range(len(LEGS_ALIKE)):
        away = means[t] - fit.told[k]
        variance += odds[t] / total * (variances[t] + away * away)
    fit.told[k] = (fit.kind_mean[k] + fit.told[k] * fit.kind_sd[k] - fit.mean[k]) / fit.sd[k]
    fit.told_weight[k] = (fit.sd[k] / fit.kind_sd[k]) ** 2 / variance


@compiled
def _begin_again(s, numbers):
    """The next pass begins at numbers, and every window where it was measured."""
    copy(numbers, s.fit.best.numbers)
    for n in range(s.fit.count):
        copy(s.windows[n].measured, s.windows[n].start)


@compiled
def _elsewhere(fit, which):
    """Numbers near another minimum into fit.proposed: the valve's lag stays."""
    n = fit.proposed
    copy(fit.best.numbers, n)
    late_s = valve_lag_s(n)
    if which == BRISTLE:
        n[GIVE] -= ELSEWHERE * fit.sd[GIVE]
    elif which == WIDE:
        n[PLAY] += ELSEWHERE * fit.sd[PLAY]
    elif which == FAST_SPOOL:
        n[LN_SPOOL] += ELSEWHERE * fit.sd[LN_SPOOL]
        n[DELAY] += late_s - valve_lag_s(n)
    else:
        n[AMP_LAG] = n[DELAY] = 0.0
        n[ZETA] = fit.mean[ZETA]
        n[LN_SPOOL] += log(valve_lag_s(n) / max(late_s, SHORTEST_LAG_s))
    for k in (GIVE, LN_SPOOL, DELAY, PLAY):
        n[k] = min(max(n[k], fit.low[k]), fit.high[k])


@compiled
def _begin_try(s):
    """The fit begins near another minimum, beside what was found, with the noise large again. What older windows said is set aside: it
    was said in the linearisation at this minimum."""
    fit = s.fit
    copy(fit.best.numbers, fit.before)
    copy(fit.chi2, fit.chi2_before)
    fit.throughout_before = fit.throughout
    copy_rows(fit.folded_H, fit.aside_H)
    copy(fit.folded_g, fit.aside_g)
    fit.aside_cost, fit.aside_kept = fit.folded_cost, fit.kept
    _forget_folded(fit)
    _elsewhere(fit, (fit.tries + (0 if s.share == 0.0 else 1)) % TRIES)  # compensated reversals show the spool
    _begin_again(s, fit.proposed)
    fit.trying, fit.stage = 1, 1
    fit.tries += 1


@compiled
def _end_try(s):
    """The lower misfit stays."""
    fit = s.fit
    fit.trying = 0
    if fit.throughout < 1.0 + BETTER * (fit.throughout_before - 1.0):
        _keep_known(s)
        return
    _begin_again(s, fit.before)
    copy(fit.chi2_before, fit.chi2)
    copy_rows(fit.aside_H, fit.folded_H)
    copy(fit.aside_g, fit.folded_g)
    fit.folded_cost, fit.kept = fit.aside_cost, fit.aside_kept


@compiled
def _settle(s):
    """The last stage is over. Where it has gained little and much is left in all windows but one, the fit may sit in a local minimum:
    it is tried again from beside it, and the lower misfit stays."""
    fit = s.fit
    four_way = s.sheet[S_FOUR_WAY] != 0.0
    _misfit(fit, four_way, fit.chi2)
    fit.throughout = _misfit_throughout(fit, four_way, fit.chi2)
    fit.settled = 1
    if fit.trying:
        _end_try(s)
        return  # to the windows that came meanwhile, before another try
    _keep_known(s)
    s.known.changed = 1 if fit.throughout > CHANGED_LEG else 0
    if is_known_leg(fit.chi2):
        fit.was_known = 1
    elif (fit.was_known or fit.restored) and s.known.changed:  # what it was, or began with, is another leg's
        _forget_folded(fit)
        fill_prior(fit, s.settings, s.past.force_N)
        fit.restored = 0
        fit.was_known = fit.count = fit.seen = fit.tries = fit.tries_seen = fit.stage = 0
        return
    if fit.seen > fit.tries_seen + WINDOWS and BETTER * (fit.throughout - 1.0) > fit.tried - 1.0:
        fit.tries, fit.tries_seen = 0, fit.seen
    stays = fit.best.cost > BETTER * fit.first_cost
    if fit.throughout > KNOWN_LEG and stays and fit.count == WINDOWS and fit.tries < TRIES:
        fit.settled, fit.tried = 0, fit.throughout
        _begin_try(s)


@compiled
def _least_gain(fit):
    """Of the cost, by which a stage goes on: promised by a step, and made by the last one."""
    return LEAST_GAIN if fit.stage == LAST_STAGE else STAGE_GAIN


@compiled
def _damp_more(fit):
    """A shorter step is tried next. Returns whether it is one at all."""
    fit.damping = max(8.0 * fit.damping, FIRST_DAMPING)
    return fit.damping <= MOST_DAMPING


@compiled
def _end_alone(s):
    """A pass over one window is over."""
    fit, n, starts = s.fit, s.fit.at_window - 1, s.fit.folding == STARTS
    fit.running = fit.folding = 0
    if starts:
        _best_start(fit, n, s.windows[n].start)
    else:
        _end_fold(s, n)


@compiled
def _end_pass(s):
    """A pass is over: keep it or not, and what comes next."""
    fit, trial = s.fit, s.fit.trial
    fit.passes += 1
    fit.running = 0
    trial.cost += add_prior(fit, trial.numbers, trial.H, trial.g)
    fit.step += 1
    done, fresh = fit.step >= MOST_STEPS, not fit.has_best
    if fresh:
        fit.first_cost = trial.cost
    if fresh or trial.cost < fit.best.cost:
        if not fresh:
            done = done or fit.best.cost - trial.cost < _least_gain(fit)
            held = 2.0 * (fit.best.cost - trial.cost) / max(fit.gain, 1e-30) - 1.0
            fit.damping *= max(1.0 / 3.0, 1.0 - held * held * held)
        fit.best = trial
        copy(fit.rough, fit.rough_before)
        fit.has_best = 1
        for n in range(fit.count):
            copy(trial.start[n], s.windows[n].start)
            copy(trial.chi[n], s.windows[n].chi)
            if fit.stage == LAST_STAGE and not fit.trying:
                copy(trial.friction_N[n], s.windows[n].friction_N)
                s.windows[n].tells = 1
        if fit.stage == LAST_STAGE and not fit.trying:
            _misfit(fit, s.sheet[S_FOUR_WAY] != 0.0, fit.chi2)
            if is_known_leg(fit.chi2):  # otherwise not before it has settled
                _keep_known(s)
    else:
        done = not _damp_more(fit) or done
    if done:
        _end_stage(s)


@compiled
def _end_stage(s):
    """The next stage, or what the last one has found."""
    fit = s.fit
    fit.step, fit.damping = 0, DAMPING
    if fit.stage < LAST_STAGE:
        fit.stage += 1
    else:
        _settle(s)


@compiled
def is_calm(s):
    """Whether the inverse leaves more than the doubt does, and the windows are still those of the leg that is known."""
    fit, expected = s.fit, s.expected
    rows = fit.count * WINDOW * (3 if s.sheet[S_FOUR_WAY] != 0.0 else 2)
    found = fit.stage == LAST_STAGE and fit.best.cost < NOISE_MISFIT * rows
    return found and s.linear == 1.0 and expected.sigma2 < expected.left2


@compiled
def work(s):
    """The fit's share of a tick."""
    fit = s.fit
    for _ in range(CALM_WORK if is_calm(s) else WORK):
        if not fit.running:
            begins = fit.settled or fit.step == 0
            folds = begins and (_begin_fold(s) or _begin_look(s))
            came = begins and not folds and _take_waiting(s)
            if fit.count < FEWEST:
                return
            if came:
                fit.settled = fit.looked = 0
            if folds or (begins and not fit.settled and _begin_start(s)):
                pass
            elif fit.passes == 0:
                if not fit.restored:
                    fill_prior(fit, s.settings, s.past.force_N)
                fit.damping = FIRST_DAMPING
                _start_pass(s, fit.mean, True)
            elif fit.settled:
                return
            elif begins:
                copy(fit.best.numbers, fit.proposed)
                _start_pass(s, fit.proposed, True)
            else:
                if not _propose(s):
                    if not _damp_more(fit):
                        _end_stage(s)
                    return
                if fit.step > 1 and fit.gain < _least_gain(fit):
                    _end_stage(s)
                    continue
                _start_pass(s, fit.proposed, False)
        _work_tick(s)
        if fit.folding:
            if fit.at_tick == 0:
                _end_alone(s)
        elif fit.at_window >= fit.count:
            _end_pass(s)


@compiled
def hear_windows(s, other):
    """What another leg has fitted of its friction, into the windows that both have seen. One may have begun later: ages are compared."""
    i = other.settings.leg
    s.heard[i] = SETTLED if other.known.valid and is_settled(other) else other.known.valid
    copy(other.known.numbers, s.others[i])
    copy(other.known.alone, s.alone[i])
    copy(other.known.alone_variance, s.alone_variance[i])
    if not other.known.valid:
        return
    begun_later = other.past.ticks - s.past.ticks
    for w in range(s.fit.count):
        for u in range(other.fit.count):
            window, its = s.windows[w], other.windows[u]
            shift = window.first + begun_later - its.first if its.tells else WINDOW
            for k in range(max(0, -shift), min(WINDOW, WINDOW - shift)):
                window.others_N[k, i] = its.friction_N[k + shift]
                window.fitted[k, i] = 1
