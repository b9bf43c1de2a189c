"""The host's motion beyond its newest packet: curves through its packets, weighed by how well they have done.

A host knows no future. Most predictors are least-squares polynomials of some order through the last N setpoints on
the host's own clock, so that late, lost and rare packets leave no trace but their absence. As a packet comes, what each
predictor said of its time `horizon` before is known to be off by e_j:

    w_j ~ 1 / (e_j^2 + (T_e e_j')^2 + e_0^2),     p(t) = sum_j w_j p_j(t) / sum_j w_j

e_j^2 is a mean over the last packets, e_j' the change of e_j a second: a prediction that jumps is worse than a wrong one.

Beside the polynomials stand smooth motions (`host_process`): in a sine of 1 m/s2 at 3 Hz, 60 packets a second, they leave a
fiftieth of the jolt that polynomials put in.

Packets that carry velocity and acceleration have predictors of their own, through the last 1 to 4 of them: each packet
is three equations, p, T v and T^2 a, T being the packets' period. The others stay, for a host's derivatives may be wrong
or jump; their e_0 is larger then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import allocating, compiled
from hexsim.mechanics.kinematics import DOF_NAMES
from hexsim.motion_computer.host_process import FEWEST, POINTS, PROCESSES, TREND, add_process, fit_process, solve

Array = NDArray[np.float64]
AXES = len(DOF_NAMES)
KEPT = 64  # setpoints, and fits
ORDERS_AND_COUNTS = np.array(  # by the number of setpoints, so that sums over them go on from one to the next
    [(0, 1), (1, 2), (2, 3), (2, 4), (3, 4), (3, 5), (1, 6), (3, 6), (4, 6), (2, 8), (4, 8), (3, 12), (5, 12), (2, 16),
     (4, 16), (3, 24), (5, 24), (4, 32), (5, 48)]
)  # fmt: skip
PLAIN, TERMS = len(ORDERS_AND_COUNTS), 6  # first that uses derivatives; coefficients of a polynomial of order 5
ORDERS_AND_COUNTS = np.vstack([ORDERS_AND_COUNTS, [(2, 1), (3, 2), (4, 2), (3, 3), (4, 3), (5, 4)]])
POLYNOMIALS = len(ORDERS_AND_COUNTS)  # those from PLAIN on use derivatives
PREDICTORS = POLYNOMIALS + len(PROCESSES)  # those from POLYNOMIALS on are processes
# e_0 [m, rad] of the predictors without derivatives, where packets carry them. Translations of a washout are smooth; its tilt is
# behind a rate limit, and second derivatives change within a packet.
PLAIN_FLOOR = np.array([1e-4, 1e-4, 1e-4, 3e-6, 3e-6, 3e-6])


class Prediction(NamedTuple):
    """Memory of the predictors of six axes. Fits are a ring: coefficients of powers of (t - time)/period, and processes."""

    coefficients: Array  # (KEPT, POLYNOMIALS, TERMS, AXES)
    points: Array  # (KEPT, POINTS) times of the setpoints that a fit's processes go through, oldest first
    weights: Array  # (KEPT, processes, POINTS, AXES)
    trends: Array  # (KEPT, processes, TREND, AXES)
    times: Array  # (KEPT,) of the newest setpoint of each fit, on the host's clock
    periods: Array  # (KEPT,)
    counts: Array  # (KEPT, 2) setpoints of a fit; how many of them, the newest in a row, have derivatives
    squares: Array  # (PREDICTORS, AXES), means of the squared errors, 1 before the first
    errors: Array  # (PREDICTORS, AXES), last
    judged: Array  # (PREDICTORS,), how often
    state: Array  # (2,): place of the newest fit, time of the last judgement


def new_prediction() -> Prediction:
    """Nothing is known."""
    return Prediction(
        np.zeros((KEPT, POLYNOMIALS, TERMS, AXES)),
        np.zeros((KEPT, POINTS)),
        np.zeros((KEPT, len(PROCESSES), POINTS, AXES)),
        np.zeros((KEPT, len(PROCESSES), TREND, AXES)),
        np.full(KEPT, -np.inf),
        np.ones(KEPT),
        np.zeros((KEPT, 2)),
        np.ones((PREDICTORS, AXES)),
        np.zeros((PREDICTORS, AXES)),
        np.zeros(PREDICTORS),
        np.array([0.0, -np.inf]),
    )


@compiled
def add_setpoint(prediction, times, motions, period_s, horizon_s):
    """Setpoints with their derivatives (n, 3, AXES), NaN where there are none, at the host's times (n,), oldest first; the
    newest has just come."""
    _judge(prediction, times[-1], motions[-1, 0], horizon_s)
    place = (int(prediction.state[0]) + 1) % KEPT
    prediction.state[0] = place
    refit(prediction, times, motions, period_s)


@compiled
def refit(prediction, times, motions, period_s):
    """The newest fit anew: a setpoint from before has come late."""
    place = int(prediction.state[0])
    prediction.times[place], prediction.periods[place] = times[-1], period_s
    count = moving = len(times)
    for i in range(len(times)):
        if np.isnan(motions[i, 1, 0]):
            moving = len(times) - 1 - i
    prediction.counts[place, 0], prediction.counts[place, 1] = count, moving
    _fit(times, motions, period_s, prediction.coefficients[place], 0, count)
    _fit(times, motions, period_s, prediction.coefficients[place], PLAIN, moving)
    n = min(count, POINTS)
    if n >= FEWEST:
        for i in range(n):
            prediction.points[place, i] = times[count - n + i]
        for j in range(len(PROCESSES)):
            length_s, nugget = PROCESSES[j]
            fit_process(times, motions, n, length_s, nugget, prediction.weights[place, j], prediction.trends[place, j])


@compiled
def _can(j, counts):
    """Whether a fit of so many setpoints has predictor j."""
    if j >= POLYNOMIALS:
        return counts[0] >= FEWEST
    return ORDERS_AND_COUNTS[j, 1] <= counts[1 if j >= PLAIN else 0]


@allocating
def _fit(times, motions, period_s, out, first, usable):
    """Coefficients (POLYNOMIALS, TERMS, AXES) of the predictors from `first` on that have enough setpoints: those without
    derivatives, or from PLAIN on those with them."""
    derivatives = 3 if first == PLAIN else 1
    newest = len(times) - 1
    sums, products = np.zeros(2 * TERMS - 1), np.zeros((TERMS, AXES))
    gram, solved = np.zeros((TERMS, TERMS)), np.zeros((TERMS, AXES))
    reached = 0
    for j in range(first, POLYNOMIALS if first == PLAIN else PLAIN):
        n, wanted = ORDERS_AND_COUNTS[j, 0] + 1, ORDERS_AND_COUNTS[j, 1]
        if wanted > usable:
            break
        while reached < wanted:
            _add_equations(
                (times[newest - reached] - times[newest]) / period_s,
                motions[newest - reached],
                motions[newest, 0],
                period_s,
                derivatives,
                sums,
                products,
            )
            reached += 1
        scale = period_s / max(times[newest] - times[newest + 1 - wanted], period_s)
        for a in range(n):
            for b in range(n):
                total = sums[a + b]
                if derivatives == 3 and a > 0 and b > 0:
                    total += a * b * sums[a + b - 2]
                    if a > 1 and b > 1:
                        total += a * (a - 1) * b * (b - 1) * sums[a + b - 4]
                gram[a, b] = total * scale ** (a + b)
            for d in range(AXES):
                solved[a, d] = products[a, d] * scale**a
        solve(gram, solved, n)
        for a in range(TERMS):
            for d in range(AXES):
                out[j, a, d] = solved[a, d] * scale**a if a < n else 0.0
        for d in range(AXES):
            out[j, 0, d] += motions[newest, 0, d]


@compiled
def _add_equations(x, motion, origin, period_s, derivatives, sums, products):
    """One setpoint (3, AXES) at x periods, less the origin: sums of powers of x, and the right sides of its equations."""
    power = 1.0
    for k in range(2 * TERMS - 1):
        sums[k] += power
        power *= x
    for i in range(derivatives):
        power = period_s**i
        for k in range(i, TERMS):
            factor = 1.0 if i == 0 else float(k) if i == 1 else float(k * (k - 1))
            for d in range(AXES):
                products[k, d] += power * factor * (motion[i, d] - (origin[d] if i == 0 else 0.0))
            power *= x


@allocating
def _judge(prediction, time, value, horizon_s):
    """What the predictors said of this time and value `horizon_s` before."""
    then = -1
    for i in range(KEPT):
        if prediction.times[i] <= time - horizon_s and (then < 0 or prediction.times[i] > prediction.times[then]):
            then = i
    if then < 0 or prediction.counts[then, 0] == 0:
        return
    memory_s, rate_s = 0.2, 0.04  # of the squared errors; T_e, over which an error counts as one of the rate
    gap = min(max(time - prediction.state[1], 1e-3), 1.0)
    said, whole = np.zeros((3, AXES)), np.ones(AXES)
    for j in range(PREDICTORS):
        if not _can(j, prediction.counts[then]):
            continue
        prediction.judged[j] += 1.0
        share = max(min(1.0, gap / memory_s), 1.0 / prediction.judged[j])
        said[:] = 0.0
        _add(prediction, then, j, time, whole, said)
        for d in range(AXES):
            error = said[0, d] - value[d]
            jump = rate_s / gap * (error - prediction.errors[j, d])
            prediction.squares[j, d] += share * (error * error + jump * jump - prediction.squares[j, d])
            prediction.errors[j, d] = error
    prediction.state[1] = time


@compiled
def _add(prediction, place, j, time, share, out):
    """Add to out (3, AXES): share (AXES,) of position, velocity and acceleration by predictor j of a fit."""
    if j >= POLYNOMIALS:
        n, k = min(int(prediction.counts[place, 0]), POINTS), j - POLYNOMIALS
        add_process(
            prediction.points[place],
            n,
            prediction.weights[place, k],
            prediction.trends[place, k],
            PROCESSES[k, 0],
            time,
            share,
            out,
        )
        return
    period = prediction.periods[place]
    x = (time - prediction.times[place]) / period
    for d in range(AXES):
        p = v = a = 0.0
        for k in range(TERMS - 1, -1, -1):
            a = a * x + 2.0 * v
            v = v * x + p
            p = p * x + prediction.coefficients[place, j, k, d]
        out[0, d] += share[d] * p
        out[1, d] += share[d] * v / period
        out[2, d] += share[d] * a / period**2


@allocating
def predicted(prediction, time):
    """Position, velocity, acceleration (3, AXES) at a time of the host's clock."""
    place = int(prediction.state[0])
    out, total, weight = np.zeros((3, AXES)), np.zeros(AXES), np.zeros(AXES)
    moving = prediction.counts[place, 1] > 0
    for j in range(PREDICTORS):
        if not _can(j, prediction.counts[place]):
            continue
        for d in range(AXES):
            floor = PLAIN_FLOOR[d] if moving and (j < PLAIN or j >= POLYNOMIALS) else 2e-7  # e_0 [m, rad]
            weight[d] = 1.0 / (prediction.squares[j, d] + floor**2)
        total += weight
        _add(prediction, place, j, time, weight, out)
    return out / total
