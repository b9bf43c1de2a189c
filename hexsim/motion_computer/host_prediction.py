"""The host's motion beyond its newest packet: polynomials through its packets, weighed by how well they have done.

A host knows no future. Each predictor is the least-squares polynomial of some order through the last N setpoints on
the host's own clock, so that late, lost and rare packets leave no trace but their absence. As a packet comes, what each
predictor said of its time `horizon` before is known to be off by e_j:

    w_j ~ 1 / (e_j^2 + (T_e e_j')^2 + e_0^2),     p(t) = sum_j w_j p_j(t) / sum_j w_j

e_j^2 is a mean over the last packets, e_j' the change of e_j a second: a prediction that jumps is worse than a wrong one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled

Array = NDArray[np.float64]
KEPT = 64  # setpoints, and fits
AXES = 6
ORDERS_AND_COUNTS = np.array(  # by the number of setpoints, so that sums over them go on from one to the next
    [(0, 1), (1, 2), (2, 3), (2, 4), (3, 4), (3, 5), (1, 6), (3, 6), (4, 6), (2, 8), (4, 8), (3, 12), (5, 12), (2, 16),
     (4, 16), (3, 24), (5, 24), (4, 32), (5, 48)]
)  # fmt: skip
PREDICTORS, TERMS = len(ORDERS_AND_COUNTS), 6
MEMORY_S = 0.2  # of the squared errors
RATE_S = 0.04  # T_e
FLOOR = 2e-7  # e_0 [m or rad]


class Prediction(NamedTuple):
    """Memory of the predictors of six axes. Fits are a ring: coefficients of powers of (t - time)/period."""

    coefficients: Array  # (KEPT, PREDICTORS, TERMS, AXES)
    times: Array  # (KEPT,) of the newest setpoint of each fit, on the host's clock
    periods: Array  # (KEPT,)
    counts: Array  # (KEPT,) setpoints that a fit was made of
    squares: Array  # (PREDICTORS, AXES), means of the squared errors, 1 before the first
    errors: Array  # (PREDICTORS, AXES), last
    judged: Array  # (PREDICTORS,), how often
    state: Array  # (2,): place of the newest fit, time of the last judgement


def new_prediction() -> Prediction:
    """Nothing is known."""
    return Prediction(
        np.zeros((KEPT, PREDICTORS, TERMS, AXES)), np.full(KEPT, -np.inf), np.ones(KEPT), np.zeros(KEPT),
        np.ones((PREDICTORS, AXES)), np.zeros((PREDICTORS, AXES)), np.zeros(PREDICTORS), np.array([0.0, -np.inf]),
    )  # fmt: skip


@compiled
def add_setpoint(prediction, times, values, period_s, horizon_s):
    """Setpoints (n, AXES) at the host's times (n,), oldest first; the newest has just come."""
    _judge(prediction, times[-1], values[-1], horizon_s)
    place = (int(prediction.state[0]) + 1) % KEPT
    prediction.state[0] = place
    refit(prediction, times, values, period_s)


@compiled
def refit(prediction, times, values, period_s):
    """The newest fit anew: a setpoint from before has come late."""
    place = int(prediction.state[0])
    prediction.times[place], prediction.periods[place] = times[-1], period_s
    prediction.counts[place] = len(times)
    _fit(times, values, period_s, prediction.coefficients[place])


@compiled
def _fit(times, values, period_s, out):
    """Coefficients (PREDICTORS, TERMS, AXES) of all predictors that have enough setpoints."""
    count = len(times)
    sums, products = np.zeros(2 * TERMS - 1), np.zeros((TERMS, AXES))
    gram, solved = np.zeros((TERMS, TERMS)), np.zeros((TERMS, AXES))
    reached = 0
    for j in range(PREDICTORS):
        n, wanted = ORDERS_AND_COUNTS[j, 0] + 1, ORDERS_AND_COUNTS[j, 1]
        if wanted > count:
            break
        while reached < wanted:
            reached += 1
            x, power = (times[count - reached] - times[count - 1]) / period_s, 1.0
            for k in range(2 * TERMS - 1):
                sums[k] += power
                if k < TERMS:
                    for d in range(AXES):
                        products[k, d] += power * (values[count - reached, d] - values[count - 1, d])
                power *= x
        scale = period_s / max(times[count - 1] - times[count - wanted], period_s)
        for a in range(n):
            for b in range(n):
                gram[a, b] = sums[a + b] * scale ** (a + b)
            for d in range(AXES):
                solved[a, d] = products[a, d] * scale**a
        _solve(gram, solved, n)
        for a in range(TERMS):
            for d in range(AXES):
                out[j, a, d] = solved[a, d] * scale**a if a < n else 0.0
        for d in range(AXES):
            out[j, 0, d] += values[count - 1, d]


@compiled
def _solve(gram, right, n):
    """right <- gram^-1 right, by Cholesky's factors, in place."""
    for a in range(n):
        for b in range(a + 1):
            value = gram[a, b]
            for k in range(b):
                value -= gram[a, k] * gram[b, k]
            gram[a, b] = np.sqrt(max(value, 1e-30)) if a == b else value / gram[b, b]
    for d in range(right.shape[1]):
        for a in range(n):
            for k in range(a):
                right[a, d] -= gram[a, k] * right[k, d]
            right[a, d] /= gram[a, a]
        for a in range(n - 1, -1, -1):
            for k in range(a + 1, n):
                right[a, d] -= gram[k, a] * right[k, d]
            right[a, d] /= gram[a, a]


@compiled
def _judge(prediction, time, value, horizon_s):
    """What the predictors said of this time and value `horizon_s` before."""
    then = -1
    for i in range(KEPT):
        if prediction.times[i] <= time - horizon_s and (then < 0 or prediction.times[i] > prediction.times[then]):
            then = i
    if then < 0 or prediction.counts[then] == 0:
        return
    x = (time - prediction.times[then]) / prediction.periods[then]
    gap = min(max(time - prediction.state[1], 1e-3), 1.0)
    for j in range(PREDICTORS):
        if ORDERS_AND_COUNTS[j, 1] > prediction.counts[then]:
            break
        prediction.judged[j] += 1.0
        share = max(min(1.0, gap / MEMORY_S), 1.0 / prediction.judged[j])
        for d in range(AXES):
            said = 0.0
            for k in range(TERMS - 1, -1, -1):
                said = said * x + prediction.coefficients[then, j, k, d]
            error = said - value[d]
            jump = RATE_S / gap * (error - prediction.errors[j, d])
            prediction.squares[j, d] += share * (error * error + jump * jump - prediction.squares[j, d])
            prediction.errors[j, d] = error
    prediction.state[1] = time


@compiled
def predicted(prediction, time):
    """Position, velocity, acceleration (3, AXES) at a time of the host's clock."""
    place = int(prediction.state[0])
    out, period = np.zeros((3, AXES)), prediction.periods[place]
    x = (time - prediction.times[place]) / period
    for d in range(AXES):
        total = 0.0
        for j in range(PREDICTORS):
            if ORDERS_AND_COUNTS[j, 1] > prediction.counts[place]:
                break
            p = v = a = 0.0
            for k in range(TERMS - 1, -1, -1):
                a = a * x + 2.0 * v
                v = v * x + p
                p = p * x + prediction.coefficients[place, j, k, d]
            weight = 1.0 / (prediction.squares[j, d] + FLOOR**2)
            total += weight
            out[0, d] += weight * p
            out[1, d] += weight * v / period
            out[2, d] += weight * a / period**2
        out[:, d] /= total
    return out
