"""Reference of the feed-forward, PREVIEW_TICKS ahead: it lets the feed-forward come in without a jerk.

    y_m' = g r' + s D(Kp (r - y_m) - (1 - g) n) + (1 - g) q
    D(w) = w - (1 - g) delta w / sqrt(w^2 + (SOFTNESS delta)^2);   midpoint rule

r is the setpoint, n the valve's null, q the velocity that a leak gives, delta the valve's half dead band, s its gain,
g the share of the feed-forward. With g = 0 this is the motion that the position loop makes of the setpoint through the
uncompensated valve, but for the standstill at a reversal, which it passes smoothly. So engaging in the midst of a
stroke hardly changes the motion. g then rises to 1, where y_m = r: full velocity feed-forward, no dead band.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

NO_LAG_M = 1e-9  # lag that counts as none once the feed-forward is all in
SOFTNESS = 2.0  # half dead bands about zero within which D is softened


@dataclass(slots=True)
class Reference:
    """y_m at the tick boundary looked at last, with its velocity and acceleration."""

    tick_s: float
    loop_1_s: tuple[float, float] = (0.0, 0.0)  # s Kp of either direction, retracting first
    dead_band_m: tuple[float, float] = (0.0, 0.0)  # delta / Kp
    null_m: float = 0.0  # null / Kp
    leak_m_s: float = 0.0  # velocity that a leak gives at closed valve
    feed_forward: float = 0.0  # g
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0
    lag_m: float = 0.0  # r - y_m

    def advance(self, behind_m: float, here_m: float, ahead_m: float) -> None:
        """One tick on; setpoints at the boundary before, at the one asked for, and after."""
        tick, share, lag = self.tick_s, self.feed_forward, self.lag_m
        if share == 1.0 and -NO_LAG_M < lag < NO_LAG_M:
            lag = loop_m_s = 0.0
        else:
            moved = (1.0 - share) * (here_m - behind_m)
            half = lag + 0.5 * (moved - tick * self._loop_m_s(lag))
            lag += moved - tick * self._loop_m_s(half)
            loop_m_s = self._loop_m_s(lag)
        self.lag_m, self.position_m = lag, here_m - lag
        velocity = share * (ahead_m - behind_m) / (2 * tick) + loop_m_s
        self.acceleration_m_s2 = (velocity - self.velocity_m_s) / tick
        self.velocity_m_s = velocity

    def _loop_m_s(self, lag_m: float) -> float:
        """Velocity that the position loop gives at a lag."""
        left = 1.0 - self.feed_forward
        lag_m -= left * self.null_m
        up = 1 if lag_m > 0.0 else 0
        dead_band = self.dead_band_m[up]
        if dead_band and left:
            soft = SOFTNESS * dead_band
            lag_m *= 1.0 - left * dead_band / sqrt(lag_m * lag_m + soft * soft)
        return self.loop_1_s[up] * lag_m + left * self.leak_m_s
