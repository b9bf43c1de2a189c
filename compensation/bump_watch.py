"""Whether compensation makes reversals worse than plain control did, seen from the position transducer alone.

Acceleration from positions, over blocks of BLOCK ticks, and what stands out of it within APART ticks:

    a = (m_0 - 2 m_1 + m_2) / (BLOCK T)^2,     h = a_k - (a_{k - APART} + a_{k + APART}) / 2

m_i means of successive blocks. h passes some 3 to 40 Hz, so that the motion itself is hardly in it. Its range over a
reversal is the bump. Plain control's last one is remembered for either direction, with the acceleration asked for at the
turn; a compensated one beyond it by more than noise is harm, whatever its cause. Of turns that are unlike, a livelier one
may have the larger bump, and more is allowed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

BLOCK, APART = 5, 20  # ticks
WORSE, WORSE_UNLIKE = 1.05, 1.5  # times plain control's bump that is still no harm, at a turn like that one or another
NOISES = 3.0  # standard errors of h that are allowed beyond
ALIKE = 0.05  # share by which turns of one kind differ in acceleration
PLAIN_SHARE = 0.5  # low-pass of plain control's bump, a reversal


@dataclass(slots=True)
class BumpWatch:
    """The reversal being watched, and plain control's bumps: retracting after it first, then extending."""

    tick_s: float
    noise_m: float  # standard deviation of a position
    positions_m: deque[float] = field(default_factory=lambda: deque([0.0] * (3 * BLOCK), 3 * BLOCK))
    blocks_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # sums, newest first
    accelerations: deque[float] = field(default_factory=lambda: deque([0.0] * (2 * APART + 1), 2 * APART + 1))
    seen: int = 0  # ticks
    low_m_s2: float = math.inf
    high_m_s2: float = -math.inf
    plain_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])
    turn_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])  # accelerations of those turns

    def add(self, position_m: float) -> None:
        """One tick."""
        old, sums = self.positions_m, self.blocks_m
        sums[0] += position_m - old[BLOCK - 1]
        sums[1] += old[BLOCK - 1] - old[2 * BLOCK - 1]
        sums[2] += old[2 * BLOCK - 1] - old[3 * BLOCK - 1]
        old.appendleft(position_m)
        kept = self.accelerations
        kept.appendleft((sums[0] - 2.0 * sums[1] + sums[2]) / (BLOCK * (BLOCK * self.tick_s) ** 2))
        if self.seen < 3 * BLOCK + 2 * APART:
            self.seen += 1
            return
        h = kept[APART] - 0.5 * (kept[0] + kept[-1])
        if h < self.low_m_s2:
            self.low_m_s2 = h
        if h > self.high_m_s2:
            self.high_m_s2 = h

    def harms(self, extending: bool, turn_m_s2: float, gain: float) -> bool:
        """Between two reversals: takes the last one in, made with so much compensation (0 .. 1), and tells whether it
        was worse than plain control's. turn_m_s2: acceleration asked for at it."""
        bump, self.low_m_s2, self.high_m_s2 = self.high_m_s2 - self.low_m_s2, math.inf, -math.inf
        if not bump >= 0.0:
            return False
        plain, turn = self.plain_m_s2[extending], self.turn_m_s2[extending]
        alike = abs(turn_m_s2 - turn) < ALIKE * turn_m_s2
        if gain == 0.0:
            self.plain_m_s2[extending] = plain + PLAIN_SHARE * (bump - plain) if alike else bump
            self.turn_m_s2[extending] = turn_m_s2
            return False
        allowed = WORSE * plain if alike else WORSE_UNLIKE * plain * max(1.0, turn_m_s2 / max(turn, 1e-9))
        return plain > 0.0 and bump > allowed + NOISES * self.noise_m_s2

    @property
    def ready(self) -> bool:
        """Whether plain control has been seen turning both ways."""
        return self.plain_m_s2[0] > 0.0 and self.plain_m_s2[1] > 0.0

    @property
    def noise_m_s2(self) -> float:
        """Standard deviation of h from that of a position."""
        return math.sqrt(1.5 * 6.0 / BLOCK) * self.noise_m / (BLOCK * self.tick_s) ** 2
