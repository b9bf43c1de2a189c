"""Performance monitor: is a compensated reversal worse than plain control's? From the position transducer alone.

Acceleration from positions, over blocks of BLOCK ticks, high-passed over APART ticks:

    a = (m_0 - 2 m_1 + m_2) / (BLOCK T)^2,     h = a_k - (a_{k - APART} + a_{k + APART}) / 2

m_i are means of successive blocks. h passes about 3 to 40 Hz, so that it hardly holds the motion itself. Its range
over a reversal is the bump. The baseline is plain control's last bump of either direction, with the acceleration asked
for at that reversal. A compensated bump beyond it by more than noise is worse, whatever its cause. Of two unlike
reversals, the one with more acceleration may have the larger bump, and more is allowed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

BLOCK, APART = 5, 20  # ticks
FIRST, SECOND, THIRD = BLOCK - 1, 2 * BLOCK - 1, 3 * BLOCK - 1  # oldest position of each block
FILLED = 3 * BLOCK + 2 * APART  # ticks until the filter is filled
RATIO_ALIKE, RATIO_UNLIKE = 1.05, 1.5  # allowed bump over the baseline, at a reversal like the baseline's or unlike it
STANDARD_ERRORS = 3.0  # of h, allowed beyond
ALIKE = 0.05  # relative difference in acceleration up to which reversals are alike
BASELINE_SHARE = 0.5  # low-pass of the baseline, a reversal


@dataclass(slots=True)
class PerformanceMonitor:
    """The reversal in progress, and the baseline of either direction: retracting after it first, then extending."""

    tick_s: float
    noise_m: float  # standard deviation of a position
    positions_m: deque[float] = field(default_factory=lambda: deque([0.0] * (3 * BLOCK), 3 * BLOCK))
    blocks_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # sums, newest first
    accelerations: deque[float] = field(default_factory=lambda: deque([0.0] * (2 * APART + 1), 2 * APART + 1))
    count: int = 0  # ticks, up to FILLED
    divisor_s2: float = field(init=False)  # of the sums' second difference
    low_m_s2: float = math.inf
    high_m_s2: float = -math.inf
    baseline_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])
    reversal_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0])  # accelerations of the baseline's reversals

    def __post_init__(self) -> None:
        self.divisor_s2 = BLOCK * (BLOCK * self.tick_s) ** 2

    def add(self, position_m: float) -> None:
        """One tick."""
        positions, sums = self.positions_m, self.blocks_m
        first, second, third = positions[FIRST], positions[SECOND], positions[THIRD]
        sums[0] += position_m - first
        sums[1] += first - second
        sums[2] += second - third
        positions.appendleft(position_m)
        kept = self.accelerations
        kept.appendleft((sums[0] - 2.0 * sums[1] + sums[2]) / self.divisor_s2)
        if self.count < FILLED:
            self.count += 1
            return
        h = kept[APART] - 0.5 * (kept[0] + kept[-1])
        if h < self.low_m_s2:
            self.low_m_s2 = h
        if h > self.high_m_s2:
            self.high_m_s2 = h

    def worse_than_baseline(self, extending: bool, reversal_m_s2: float, ramp: float) -> bool:
        """Closes a reversal, between it and the next; whether its bump was worse than the baseline.

        reversal_m_s2: acceleration asked for at it; ramp: 0 plain control, whose bump becomes the baseline.
        """
        bump, self.low_m_s2, self.high_m_s2 = self.high_m_s2 - self.low_m_s2, math.inf, -math.inf
        if not bump >= 0.0:
            return False
        baseline, reversal = self.baseline_m_s2[extending], self.reversal_m_s2[extending]
        alike = abs(reversal_m_s2 - reversal) < ALIKE * reversal_m_s2
        if ramp == 0.0:
            self.baseline_m_s2[extending] = baseline + BASELINE_SHARE * (bump - baseline) if alike else bump
            self.reversal_m_s2[extending] = reversal_m_s2
            return False
        unlike = RATIO_UNLIKE * baseline * max(1.0, reversal_m_s2 / max(reversal, 1e-9))
        allowed = RATIO_ALIKE * baseline if alike else unlike
        return baseline > 0.0 and bump > allowed + STANDARD_ERRORS * self.noise_m_s2

    @property
    def ready(self) -> bool:
        """Whether both directions have a baseline."""
        return self.baseline_m_s2[0] > 0.0 and self.baseline_m_s2[1] > 0.0

    @property
    def noise_m_s2(self) -> float:
        """Standard deviation of h from that of a position."""
        return math.sqrt(1.5 * 6.0 / BLOCK) * self.noise_m / (BLOCK * self.tick_s) ** 2
