"""The motion that the feed-forward asks for, looked at some ticks ahead, so that it may come in without a jerk.

    y_m' = g r' + s Kp (r - y_m),     r the setpoint;  by the trapezium rule

With g = 0 this is what the position loop makes of the setpoint with a straight valve of gain s: taking over from
plain control changes the phase of the motion hardly at all. g then rises slowly to 1, where y_m = r: full velocity
feed-forward.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Reference:
    """y_m at the tick boundary looked at last, with its velocity and acceleration."""

    tick_s: float
    loop_1_s: float = 0.0  # s Kp
    share: float = 0.0  # g
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0
    lag_m: float = 0.0  # r - y_m

    def advance(self, behind_m: float, here_m: float, ahead_m: float) -> None:
        """One tick on; setpoints at the boundary before, at the one asked for, and after."""
        tick = self.tick_s
        pull = 0.5 * tick * self.loop_1_s
        moved = here_m - behind_m
        self.lag_m = ((1.0 - pull) * self.lag_m + (1.0 - self.share) * moved) / (1.0 + pull)
        self.position_m = here_m - self.lag_m
        velocity = self.share * (ahead_m - behind_m) / (2 * tick) + self.loop_1_s * self.lag_m
        self.acceleration_m_s2 = (velocity - self.velocity_m_s) / tick
        self.velocity_m_s = velocity
