"""Whether compensation makes reversals worse than plain control did, seen from the position transducer alone.

Acceleration from positions, block after block of BLOCK ticks, and what stands out of it within APART blocks:

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

BLOCK = 5  # ticks
APART = 4  # blocks
WORSE, WORSE_UNLIKE = 1.05, 1.5  # times plain control's bump that is still no harm, at a turn like that one or another
NOISES = 4.0  # standard errors of h that are allowed beyond
ALIKE = 0.05  # share by which turns of one kind differ in acceleration
PLAIN_SHARE = 0.5  # low-pass of plain control's bump, a reversal


@dataclass(slots=True)
class BumpWatch:
    """The reversal being watched, and plain control's bumps: retracting after it first, then extending."""

    tick_s: float
    noise_m: float  # standard deviation of a position
    ticks: int = 0  # of the block being gathered
    sum_m: float = 0.0  # of its positions
    sums_m: tuple[float, float] = (0.0, 0.0)  # of the two blocks before, the older first
    accelerations: deque[float] = field(default_factory=lambda: deque([0.0] * (2 * APART + 1), 2 * APART + 1))
    blocks: int = 0  # seen, as far as it matters
    low_m_s2: float = math.inf
    high_m_s2: float = -math.inf
    plain_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])
    turn_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])  # accelerations of those turns

    def add(self, position_m: float) -> None:
        """One tick."""
        self.sum_m += position_m
        self.ticks += 1
        if self.ticks == BLOCK:
            self._finish()

    def _finish(self) -> None:
        kept, (oldest, older) = self.accelerations, self.sums_m
        kept.appendleft((self.sum_m - 2.0 * older + oldest) / (BLOCK * (BLOCK * self.tick_s) ** 2))
        self.sums_m = (older, self.sum_m)
        self.ticks, self.sum_m = 0, 0.0
        if self.blocks < 2 * APART + 3:
            self.blocks += 1
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
