"""The setpoint's future where nobody gives it: polynomials through its past, weighed by how well they have done.

A host knows no future, and a preview that is a straight line tells none. Each predictor is the least-squares
polynomial of some order through the last ticks, extended to the tick boundary asked for. Short ones follow a smooth
setpoint closely; long ones survive packets that come rarely or late. Their errors are known `look` ticks later:

    w_j ~ 1 / (e_j^2 + (e_j' T_e)^2 + e_0^2)^2,     r^(k + look) = sum_j w_j r^_j(k + look) / sum_j w_j

e_j is the mean-square error of late, e_j' its rate, for a jumping prediction jerks more than a wrong one.

Packets that are late or lost make setpoints jump. A jump is taken off and comes in later. What is given follows the
prediction with the predicted acceleration, and a bounded one more.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .arithmetic import clip
from .compiled import compiled
from .records import record

# of the polynomials: from 16 ms, where packets are even, to 0.2 s, where they come rarely
ORDERS_AND_TICKS = ((1, 8), (2, 12), (2, 24), (2, 48), (2, 96), (3, 24), (3, 48), (3, 96), (4, 48), (4, 96))
PREDICTORS, PAST = len(ORDERS_AND_TICKS), 97  # setpoints that are kept
PREVIEW_TICKS, MAX_LOOK = 9, 13  # least and most that is looked ahead


class Following(NamedTuple):
    """How setpoints are predicted, and how what is given follows the prediction."""

    rate_ticks: float = 20.0  # T_e
    share: float = 0.01  # low-pass of the squared errors, a tick
    floor_m: float = 2e-7  # e_0
    step_errors: float = 4.0  # of one tick, over the usual error, that are a step
    step_m: float = 3e-6  # besides
    steady_ticks: int = 4  # between two steps
    max_offset_m: float = 5e-4  # bound of all of them
    offset_share: float = 0.006  # of a step that comes in, a tick
    acceleration_share: float = 0.2  # low-pass of the predicted acceleration, a tick
    rate: float = 0.016  # rate with which what is given follows what is predicted, a tick
    max_change_m: float = 4e-7  # a tick squared: 0.1 m/s2 at 500 Hz, the most that following may add
    lost_m: float = 0.02  # from what is predicted, from which following begins anew
    straight_m: float = 1e-9  # second difference of a preview that is a straight line
    straight_ticks: int = 25  # for which a preview must be straight, and the motion not, until it counts as none
    step_ticks: int = 12  # of the parabola that a step is told from


FOLLOWING = Following()


PREDICTION = record(  # state
    look="i8",
    past_m=("f8", (2 * PAST,)),  # ring, twice, so that a stretch is in order
    place="i8",
    predicted_m=("f8", (MAX_LOOK, PREDICTORS)),
    error_m=("f8", (PREDICTORS,)),
    squares_m2=("f8", (PREDICTORS,)),
    ahead_m=("f8", (3 * PREDICTORS,)),
    ticks="i8",
    straight_ticks="i8",
    active="i8",
    offset_m="f8",  # by which packets made the setpoint jump, less what has come in since
    steady_ticks="i8",  # since it jumped
    usual_m="f8",  # mean size of the error of one tick
    started="i8",
    last_m="f8",  # given at the tick before
    moved_m="f8",  # in the last tick
    acceleration_m="f8",  # a tick squared, low-pass
)


def _row(order: int, ticks: int, look: float, derivative: int = 0) -> np.ndarray:
    """Weights on the newest `ticks` setpoints, oldest first, of a derivative [1/tick^n] of the fit `look` ticks on."""
    t = np.arange(-ticks + 1.0, 1.0) / ticks
    powers = [
        math.perm(n, derivative) * (look / ticks) ** (n - derivative) if n >= derivative else 0.0
        for n in range(order, -1, -1)
    ]
    return np.linalg.pinv(np.vander(t, order + 1)).T @ np.array(powers) / ticks**derivative


@lru_cache(maxsize=1)
def prediction_table() -> np.ndarray:
    """Weights (looks, PAST, 3 predictors) on the setpoints, oldest first, for looks of PREVIEW_TICKS to MAX_LOOK ticks:
    position `look` and look + 1 ticks on, acceleration."""
    table = np.zeros((MAX_LOOK - PREVIEW_TICKS + 1, PAST, 3 * PREDICTORS))
    for n, weights in enumerate(table):
        look = PREVIEW_TICKS + n
        for i, (order, ticks) in enumerate(ORDERS_AND_TICKS):
            for kind, (ahead, derivative) in enumerate(((look, 0), (look + 1, 0), (look, 2))):
                weights[PAST - ticks :, i + kind * PREDICTORS] = _row(order, ticks, ahead, derivative)
    return table


STEP_ROW = _row(2, FOLLOWING.step_ticks, 1)


@compiled
def start_prediction(p):
    """Nothing is known of the setpoint."""
    p.usual_m = 1e-5


@compiled
def watch_setpoint(p, count, bend, setpoint_m):
    """One tick: whether the future must be predicted. count: setpoints of the preview, 1 is the present alone; bend:
    second difference of its first, middle and last."""
    if p.ticks == 0:
        for i in range(2 * PAST):
            p.past_m[i] = setpoint_m
    p.ticks += 1
    if p.active:
        setpoint_m = _without_steps(p, setpoint_m)
    place = p.place + 1 if p.place + 1 < PAST else 0
    p.past_m[place] = p.past_m[place + PAST] = setpoint_m
    p.place = place
    if count < 3:
        p.active = True
    elif not -FOLLOWING.straight_m < bend < FOLLOWING.straight_m:
        p.straight_ticks, p.active = 0, False
    else:
        before, older = p.past_m[place + PAST - 12], p.past_m[place + PAST - 24]
        if abs(setpoint_m - 2.0 * before + older) > 10.0 * FOLLOWING.straight_m:
            p.straight_ticks += 1
        p.active = p.straight_ticks > FOLLOWING.straight_ticks
    return p.active != 0


@compiled
def _without_steps(p, setpoint_m):
    """The setpoint less what packets made it jump by; that comes in later, with time."""
    start, expected = p.place + PAST - FOLLOWING.step_ticks + 1, 0.0
    for i in range(FOLLOWING.step_ticks):
        expected += STEP_ROW[i] * p.past_m[start + i]
    p.offset_m -= FOLLOWING.offset_share * p.offset_m
    error = setpoint_m - p.offset_m - expected
    size = abs(error)
    limit = FOLLOWING.step_errors * p.usual_m + FOLLOWING.step_m
    p.steady_ticks += 1
    if size > limit and p.steady_ticks > FOLLOWING.steady_ticks:
        p.offset_m = clip(p.offset_m + error, -FOLLOWING.max_offset_m, FOLLOWING.max_offset_m)
        p.steady_ticks = 0
    p.usual_m += FOLLOWING.share * (min(size, limit) - p.usual_m)
    return setpoint_m - p.offset_m


@compiled
def predict(p, table, look, setpoint_m):
    """Setpoints at the boundary before the one `look` ticks ahead, at it, and after it."""
    setpoint_m -= p.offset_m
    if look != p.look:
        p.look = look
        for i in range(MAX_LOOK):
            for j in range(PREDICTORS):
                p.predicted_m[i, j] = setpoint_m
    here, after, acceleration = _weighed(p, table[look - PREVIEW_TICKS], p.ticks % look, setpoint_m)
    p.acceleration_m += FOLLOWING.acceleration_share * (acceleration - p.acceleration_m)
    if not p.started or abs(here - p.last_m) > FOLLOWING.lost_m:
        p.started, p.last_m, p.moved_m = True, 2.0 * here - after, after - here
    off = here - p.last_m - p.moved_m
    change = 2.0 * FOLLOWING.rate * (after - here - acceleration - p.moved_m) + FOLLOWING.rate * FOLLOWING.rate * off
    p.moved_m += p.acceleration_m + clip(change, -FOLLOWING.max_change_m, FOLLOWING.max_change_m)
    before = p.last_m
    p.last_m += p.moved_m
    return before, p.last_m, p.last_m + p.moved_m + p.acceleration_m


@compiled
def _weighed(p, weights, slot, setpoint_m):
    """Position `look` ticks on, one tick later, and acceleration: of all predictors, by their errors of late."""
    ahead = p.ahead_m
    for j in range(3 * PREDICTORS):
        ahead[j] = 0.0
    for i in range(PAST):
        past = p.past_m[p.place + 1 + i]
        for j in range(3 * PREDICTORS):
            ahead[j] += weights[i, j] * past
    total = here = after = acceleration = 0.0
    for j in range(PREDICTORS):
        error = p.predicted_m[slot, j] - setpoint_m
        jump = FOLLOWING.rate_ticks * (error - p.error_m[j])
        p.error_m[j], p.predicted_m[slot, j] = error, ahead[j]
        p.squares_m2[j] += FOLLOWING.share * (error * error + jump * jump - p.squares_m2[j])
        weight = (p.squares_m2[j] + FOLLOWING.floor_m**2) ** -2
        total += weight
        here += weight * ahead[j]
        after += weight * ahead[j + PREDICTORS]
        acceleration += weight * ahead[j + 2 * PREDICTORS]
    return here / total, after / total, acceleration / total
