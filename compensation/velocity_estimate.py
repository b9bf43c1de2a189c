"""Velocity from a noisy position, and the volts that belong to it.

A difference of two positions is the mean velocity between two ticks, driven by the volts sent at the first of them.
Where it is filtered, the volts pass the same filter, so that a flow curve drawn of both keeps its phase (report 4.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(slots=True)
class VelocityEstimate:
    """First-order low-pass, twice, of the position's difference, of the valve's volts and of the control volts."""

    rate_Hz: float
    bandwidth_Hz: float | None
    position_m: float = math.nan
    control_V: float = 0.0
    passes: list[float] = field(default_factory=lambda: [0.0] * 6)

    def numbers(self) -> tuple[float, ...]:
        """All that changes."""
        return self.position_m, self.control_V, *self.passes

    def update(self, position_m: float, valve_V: float, control_V: float) -> tuple[float, float, float] | None:
        """Velocity [m/s], valve and control volts that belong together, or None at the first tick and at a lost
        sample.

        `valve_V` is what was sent at the previous tick; `control_V` that of this tick, kept for the next call.
        """
        previous, control = self.position_m, self.control_V
        self.position_m, self.control_V = position_m, control_V
        velocity = (position_m - previous) * self.rate_Hz
        if not math.isfinite(velocity):
            return None
        if self.bandwidth_Hz is None:
            return velocity, valve_V, control
        k = 1.0 - math.exp(-2 * math.pi * self.bandwidth_Hz / self.rate_Hz)
        p = self.passes
        p[0] += k * (velocity - p[0])
        p[1] += k * (valve_V - p[1])
        p[2] += k * (control - p[2])
        p[3] += k * (p[0] - p[3])
        p[4] += k * (p[1] - p[4])
        p[5] += k * (p[2] - p[5])
        return p[3], p[4], p[5]
