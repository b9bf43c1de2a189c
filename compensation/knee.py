"""The curve near zero flow, where rounded or leaking edges leave the straight line beyond the overlap.

A rounded edge opens as s log(1 + exp((x - delta)/s)); its inverse at a speed v needs less than the line by

    c(v) = s log(1 - exp(-v / (k s))),     never below -delta

s, the rounding in volts, is first what plain control's reversals told (rounding.py), and then trimmed: too large a jump
across the overlap moves too much oil on both sides of the reversal, too small a one too little.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from .base import clip

REACH_TICKS = 8  # on either side of the reversal
RATE_V_M = 200.0  # volts of rounding per metre of surplus oil displacement at one reversal: 1 mV for 5 um
LEAK_M = 1e-6  # taken off each surplus, so that noise does not add up to a rounding
SMALLEST_V = 4e-3  # rounding below which edges are taken as sharp
TRUST_M = 3e-5  # a surplus beyond this is something else


@dataclass(slots=True)
class Knee:
    """Rounding s of both edges [V], and the reversal being watched."""

    rounding_V: float = 0.0
    least_V: float = 0.0  # no less is thought of now
    sign: float = 0.0
    ticks: int = 0
    at_m: float = 0.0  # oil displacement less the wanted one, at the reversal
    before_m: float = 0.0  # how much it had grown before, against the new direction

    def value(self, speed_m_s: float, gain_m_s_V: float, dead_band_V: float) -> float:
        """c [V] at a speed."""
        s = max(self.rounding_V, self.least_V)
        if s < SMALLEST_V or speed_m_s > 6.0 * s * gain_m_s_V:
            return 0.0
        share = 1.0 - math.exp(-speed_m_s / (s * gain_m_s_V))
        return max(s * math.log(share), -dead_band_V) if share > 0.0 else -dead_band_V

    def watch(self, surplus_m: deque[float], flow_m_s: float, highest_V: float) -> None:
        """One tick. surplus_m: oil displacement less the wanted one, of the last ticks, newest last; flow: wanted
        now."""
        sign = 1.0 if flow_m_s > 0 else -1.0
        if sign != self.sign:
            self.sign, self.ticks = sign, 0
            self.at_m = surplus_m[-1]
            self.before_m = -sign * (self.at_m - surplus_m[0])
        self.ticks += 1
        if self.ticks == REACH_TICKS:
            surplus = 0.5 * (sign * (surplus_m[-1] - self.at_m) + self.before_m)
            if abs(surplus) < TRUST_M:
                self.rounding_V = clip(self.rounding_V + RATE_V_M * (surplus - LEAK_M), 0.0, highest_V)
