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
from dataclasses import dataclass, field

import numpy as np

from ..compensator import clip

PREDICTORS = (
    (1, 8),
    (2, 12),
    (2, 24),
    (2, 48),
    (2, 96),
    (3, 24),
    (3, 48),
    (3, 96),
    (4, 48),
    (4, 96),
)  # order and ticks of each
PAST = 97
RATE_TICKS = 20.0  # T_e
SHARE = 0.01  # low-pass of the squared errors, a tick
FLOOR_M = 2e-7  # e_0
STEP_ERRORS, STEP_M = 4.0, 3e-6  # error of one tick, over the usual one, that is a step
STEADY_TICKS, MAX_OFFSET_M = 4, 5e-4  # between two steps; bound of all of them
OFFSET_SHARE = 0.006  # of a step that comes in, a tick
MAX_LOOK = 20
ACCELERATION_SHARE = 0.2  # low-pass of the predicted acceleration, a tick
FOLLOW = 0.016  # rate with which what is given follows what is predicted, a tick
MAX_CHANGE_M = 4e-7  # a tick squared: 0.1 m/s2 at 500 Hz, the most that following may add
LOST_M = 0.02  # from what is predicted, from which following begins anew
STRAIGHT_M = 1e-9  # second difference of a preview that is a straight line
STRAIGHT_TICKS = 25  # for which a preview must be straight, and the motion not, until it counts as none


def _row(order: int, ticks: int, look: float, derivative: int = 0) -> np.ndarray:
    """Weights on the newest `ticks` setpoints, oldest first, of a derivative [1/tick^n] of the fit `look` ticks on."""
    t = np.arange(-ticks + 1.0, 1.0) / ticks
    powers = [
        math.perm(n, derivative) * (look / ticks) ** (n - derivative) if n >= derivative else 0.0
        for n in range(order, -1, -1)
    ]
    return np.linalg.pinv(np.vander(t, order + 1)).T @ np.array(powers) / ticks**derivative


def _rows(look: int) -> np.ndarray:
    """Weights (3 predictors, PAST) on the newest setpoints: position `look` and look + 1 ticks on, acceleration."""
    rows = np.zeros((3 * len(PREDICTORS), PAST))
    for i, (order, ticks) in enumerate(PREDICTORS * 3):
        kind = i // len(PREDICTORS)
        rows[i, PAST - ticks :] = _row(order, ticks, look + (kind == 1), 2 if kind == 2 else 0)
    return rows


STEP_TICKS = 12
STEP_ROW = _row(2, STEP_TICKS, 1)


@dataclass(slots=True)
class SetpointPredictor:
    """The last setpoints, the predictions whose time has not come, and their errors."""

    look: int = 0
    rows: np.ndarray = field(default_factory=lambda: np.zeros((0, PAST)))
    past_m: np.ndarray = field(default_factory=lambda: np.full(2 * PAST, np.nan))  # twice, so that a slice is in order
    place: int = 0
    predicted_m: np.ndarray = field(default_factory=lambda: np.zeros((MAX_LOOK, len(PREDICTORS))))
    error_m: np.ndarray = field(default_factory=lambda: np.zeros(len(PREDICTORS)))
    squares_m2: np.ndarray = field(default_factory=lambda: np.zeros(len(PREDICTORS)))
    ticks: int = 0
    straight_ticks: int = 0
    active: bool = False
    offset_m: float = 0.0  # by which packets made the setpoint jump, less what has come in since
    steady_ticks: int = 0  # since it jumped
    usual_m: float = 1e-5  # mean size of the error of one tick
    last_m: float = np.nan  # given at the tick before
    moved_m: float = 0.0  # in the last tick
    acceleration_m: float = 0.0  # a tick squared, low-pass

    def watch(self, preview_m: np.ndarray, setpoint_m: float) -> bool:
        """One tick: whether the future must be predicted. preview_m may hold the present setpoint alone."""
        if self.ticks == 0:
            self.past_m[:] = setpoint_m
        self.ticks += 1
        if self.active:
            setpoint_m = self._without_steps(setpoint_m)
        past, place = self.past_m, self.place + 1 if self.place + 1 < PAST else 0
        past[place] = past[place + PAST] = setpoint_m
        self.place = place
        middle = (len(preview_m) - 1) // 2
        if middle == 0:
            self.active = True
            return True
        bend = preview_m.item(0) - 2.0 * preview_m.item(middle) + preview_m.item(2 * middle)
        if not -STRAIGHT_M < bend < STRAIGHT_M:
            self.straight_ticks, self.active = 0, False
            return False
        before, older = past.item(place + PAST - 12), past.item(place + PAST - 24)
        if abs(setpoint_m - 2.0 * before + older) > 10.0 * STRAIGHT_M:
            self.straight_ticks += 1
        self.active = self.straight_ticks > STRAIGHT_TICKS
        return self.active

    def _without_steps(self, setpoint_m: float) -> float:
        """The setpoint less what packets made it jump by; that comes in later, with time."""
        start = self.place + PAST - STEP_TICKS + 1
        expected = float(STEP_ROW @ self.past_m[start : start + STEP_TICKS])
        self.offset_m -= OFFSET_SHARE * self.offset_m
        error = setpoint_m - self.offset_m - expected
        size = abs(error)
        limit = STEP_ERRORS * self.usual_m + STEP_M
        self.steady_ticks += 1
        if size > limit and self.steady_ticks > STEADY_TICKS:
            self.offset_m = clip(self.offset_m + error, -MAX_OFFSET_M, MAX_OFFSET_M)
            self.steady_ticks = 0
        self.usual_m += SHARE * (min(size, limit) - self.usual_m)
        return setpoint_m - self.offset_m

    def predict(self, look: int, setpoint_m: float) -> tuple[float, float, float]:
        """Setpoints at the boundary before the one `look` ticks ahead, at it, and after it."""
        setpoint_m -= self.offset_m
        if look != self.look:
            self.look, self.rows = look, _rows(look)
            self.predicted_m[:] = setpoint_m
        ahead = self.rows @ self.past_m[self.place + 1 : self.place + 1 + PAST]
        n, slot = len(PREDICTORS), self.ticks % look
        error = self.predicted_m[slot] - setpoint_m
        jump = RATE_TICKS * (error - self.error_m)
        self.error_m = error
        self.squares_m2 += SHARE * (error * error + jump * jump - self.squares_m2)
        self.predicted_m[slot] = ahead[:n]
        weights = (self.squares_m2 + FLOOR_M**2) ** -2
        weights /= weights.sum()
        here, after, acceleration = (ahead.reshape(3, n) @ weights).tolist()
        self.acceleration_m += ACCELERATION_SHARE * (acceleration - self.acceleration_m)
        if self.last_m != self.last_m or abs(here - self.last_m) > LOST_M:
            self.last_m, self.moved_m = 2.0 * here - after, after - here
        off = here - self.last_m - self.moved_m
        change = 2.0 * FOLLOW * (after - here - acceleration - self.moved_m) + FOLLOW * FOLLOW * off
        self.moved_m += self.acceleration_m + clip(change, -MAX_CHANGE_M, MAX_CHANGE_M)
        before, self.last_m = self.last_m, self.last_m + self.moved_m
        return before, self.last_m, self.last_m + self.moved_m + self.acceleration_m
