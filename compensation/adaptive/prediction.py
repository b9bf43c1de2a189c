"""The setpoint's future where nobody gives it: polynomials through its past, weighed by how well they have done.

A host knows no future, and a preview that is a straight line tells none. Each predictor is the least-squares
polynomial of some order through the last ticks, extended to the tick boundary asked for. Short ones follow a smooth
setpoint closely; long ones survive packets that come rarely or late. Their errors are known `look` ticks later:

    w_j ~ 1 / (e_j^2 + (e_j' T_e)^2 + e_0^2)^2,     r^(k + look) = sum_j w_j r^_j(k + look) / sum_j w_j

e_j is the mean-square error of late, e_j' its rate, for a jumping prediction jerks more than a wrong one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

PREDICTORS = ((1, 8), (2, 12), (2, 24), (2, 48), (3, 24), (3, 48), (4, 48))  # order and ticks of each
PAST = 49
RATE_TICKS = 20.0  # T_e
SHARE = 0.01  # low-pass of the squared errors, a tick
FLOOR_M = 2e-7  # e_0
MAX_LOOK = 20
STRAIGHT_M = 1e-9  # second difference of a preview that is a straight line
STRAIGHT_TICKS = 25  # for which a preview must be straight, and the motion not, until it counts as none


def _rows(look: int) -> np.ndarray:
    """Weights (predictors, PAST) on the newest setpoints, oldest first, that extend each polynomial by `look` ticks."""
    rows = np.zeros((len(PREDICTORS), PAST))
    for row, (order, ticks) in zip(rows, PREDICTORS, strict=True):
        t = np.arange(-ticks + 1.0, 1.0) / ticks
        row[PAST - ticks :] = np.linalg.pinv(np.vander(t, order + 1)).T @ np.vander([look / ticks], order + 1)[0]
    return rows


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
    last_m: float = np.nan  # predicted at the tick before

    def watch(self, preview_m: np.ndarray, setpoint_m: float) -> bool:
        """One tick: whether the future must be predicted. preview_m may hold the present setpoint alone."""
        past, place = self.past_m, self.place
        if self.ticks == 0:
            past[:] = setpoint_m
        self.ticks += 1
        place = self.place = place + 1 if place + 1 < PAST else 0
        past[place] = past[place + PAST] = setpoint_m
        count = len(preview_m)
        if count < 3:
            self.active = True
        else:
            middle = count // 2
            bend = preview_m.item(0) - 2.0 * preview_m.item(middle) + preview_m.item(2 * middle)
            if not -STRAIGHT_M < bend < STRAIGHT_M:
                self.straight_ticks, self.active = 0, False
            else:
                before, older = past.item(place + PAST - 12), past.item(place + PAST - 24)
                if abs(setpoint_m - 2.0 * before + older) > 10.0 * STRAIGHT_M:
                    self.straight_ticks += 1
                self.active = self.straight_ticks > STRAIGHT_TICKS
        return self.active

    def predict(self, look: int, setpoint_m: float) -> tuple[float, float, float]:
        """Setpoints at the boundary before the one `look` ticks ahead, at it, and after it."""
        if look != self.look:
            self.look, self.rows = look, np.vstack([_rows(look), _rows(look + 1)])
            self.last_m = np.nan
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
        here, after = float(weights @ ahead[:n]), float(weights @ ahead[n:])
        before = self.last_m if self.last_m == self.last_m else 2.0 * here - after
        self.last_m = here
        return before, here, after
