"""The motion that the feed-forward asks for, looked at some ticks ahead, so that it may come in without a jerk.

    y_m' = g r' + s D(Kp (r - y_m)),   D(w) = w - (1 - g) delta w / sqrt(w^2 + (SOFT delta)^2);   by the midpoint rule

r the setpoint, delta the valve's half dead band, s its gain. With g = 0 this is the motion that the position loop
makes of the setpoint through the valve as it is, but for the pause at a reversal, which it glides through: taking
over from plain control in the midst of a stroke changes the motion hardly at all. g then rises slowly to 1, where
y_m = r: full velocity feed-forward, no dead band.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

CAUGHT_UP_M = 1e-9  # lag that counts as none once the feed-forward is all in
SOFT = 2.0  # half dead bands about zero within which D is softened


@dataclass(slots=True)
class Reference:
    """y_m at the tick boundary looked at last, with its velocity and acceleration."""

    tick_s: float
    loop_1_s: tuple[float, float] = (0.0, 0.0)  # s Kp of either direction, retracting first
    dead_m: tuple[float, float] = (0.0, 0.0)  # delta / Kp
    share: float = 0.0  # g
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0
    lag_m: float = 0.0  # r - y_m

    def advance(self, behind_m: float, here_m: float, ahead_m: float) -> None:
        """One tick on; setpoints at the boundary before, at the one asked for, and after."""
        tick, share, lag = self.tick_s, self.share, self.lag_m
        if share == 1.0 and -CAUGHT_UP_M < lag < CAUGHT_UP_M:
            lag = pull = 0.0
        else:
            moved = (1.0 - share) * (here_m - behind_m)
            half = lag + 0.5 * (moved - tick * self._pull(lag))
            lag += moved - tick * self._pull(half)
            pull = self._pull(lag)
        self.lag_m, self.position_m = lag, here_m - lag
        velocity = share * (ahead_m - behind_m) / (2 * tick) + pull
        self.acceleration_m_s2 = (velocity - self.velocity_m_s) / tick
        self.velocity_m_s = velocity

    def _pull(self, lag_m: float) -> float:
        """Velocity that the loop gives at a lag."""
        up = int(lag_m > 0.0)
        dead, left = self.dead_m[up], 1.0 - self.share
        if dead and left:
            soft = SOFT * dead
            lag_m *= 1.0 - left * dead / sqrt(lag_m * lag_m + soft * soft)
        return self.loop_1_s[up] * lag_m
