"""Stribeck friction near rest, identified from reversals.

The friction that the model lacks is, with P~ and y~ pressure and position less the demanded ones (Eq. 3.8),

    f = P~ - p1 y~''

It is projected on a smooth odd function phi over the reversal, which vanishes with its slope at both ends. The second
derivative goes over to phi, so that no measurement is differentiated (weak form):

    sum phi f = sum phi P~ - p1 sum phi'' y~,      driven to 0:  P_s += rate * (sum phi f) / (sum phi share)

P_s is the Stribeck pressure, `share` the signed share of it that was demanded at each tick. What is even or slow in
time drops out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from operator import mul

REACH = 16  # ticks on either side of a reversal
MIN_RATE = 0.1  # of the correction taken up at a reversal, from the tenth on
MIN_PROJECTION = 1.5  # sum phi share [1] below which a reversal is too quick to tell


def _test_function() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """phi and its second difference a tick squared, (2 REACH + 1,) each, newest first (the sign is the direction's)."""
    x = [i / (REACH + 1) for i in range(-REACH - 1, REACH + 2)]
    phi = [-math.sin(math.pi * v) * math.cos(0.5 * math.pi * v) ** 2 for v in x]
    second = [phi[i - 1] - 2.0 * phi[i] + phi[i + 1] for i in range(1, len(phi) - 1)]
    return tuple(phi[1:-1]), tuple(second)


PHI, PHI_SECOND = _test_function()


def _history() -> deque[float]:
    return deque([0.0] * (2 * REACH + 1), 2 * REACH + 1)


@dataclass(slots=True)
class StribeckEstimator:
    """The Stribeck pressure [Pa]: breakaway less Coulomb friction; and the ticks about the reversal, newest first."""

    tick_s: float
    pressure_Pa: float = 0.0
    reversals: int = 0
    direction: float = 0.0
    ticks: int = 0  # since the velocity changed sign
    deviation_Pa: deque[float] = field(default_factory=_history)
    position_error_m: deque[float] = field(default_factory=_history)
    share: deque[float] = field(default_factory=_history)

    def add(self, velocity_m_s: float, deviation_Pa: float, position_error_m: float, share: float) -> bool:
        """One tick: demanded velocity, pressure and position less the demanded ones, demanded share of P_s.

        True when a reversal lies in the middle of the history.
        """
        self.deviation_Pa.appendleft(deviation_Pa)
        self.position_error_m.appendleft(position_error_m)
        self.share.appendleft(share)
        if velocity_m_s * self.direction < 0.0:
            self.ticks = 0
        if velocity_m_s:
            self.direction = velocity_m_s
        self.ticks += 1
        return self.ticks == REACH + 1

    def update(self, inertia_Pa: float, highest_Pa: float) -> None:
        """The reversal in the history corrects P_s; `inertia_Pa` is p1, pressure per m/s2."""
        projected = sum(map(mul, PHI, self.share))
        if abs(projected) < MIN_PROJECTION:
            return
        missing = sum(map(mul, PHI, self.deviation_Pa))
        missing -= inertia_Pa * sum(map(mul, PHI_SECOND, self.position_error_m)) / self.tick_s**2
        self.reversals += 1
        self.pressure_Pa += max(MIN_RATE, 1.0 / self.reversals) * missing / projected
        self.pressure_Pa = min(max(self.pressure_Pa, 0.0), highest_Pa)
