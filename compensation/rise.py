"""Stribeck's rise of friction close to rest, learned from what reversals do.

What friction has more than the model says is, with P~ and y~ pressure and position less the wanted ones (Eq. 3.8),

    f = P~ - p1 y~''

Weighed over a reversal by a smooth odd function phi that vanishes with its slope at both ends, the second derivative
goes over to phi, so that no measurement is differentiated:

    sum phi f = sum phi P~ - p1 sum phi'' y~,      to be 0:  rise += rate * (sum phi f) / (sum phi part)

`part` is the share of the rise that was wanted at each tick, with its sign. What is even or slow in time drops out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from operator import mul

REACH = 16  # ticks on either side of a reversal
RATE_LOW = 0.1  # of the correction taken up at a reversal, from the tenth on
SEEN_LOW = 1.5  # sum phi part below which a reversal is too quick to tell


def _weights() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """phi and its second difference a tick squared, (2 REACH + 1,) each, newest first (the sign is the direction's)."""
    x = [i / (REACH + 1) for i in range(-REACH - 1, REACH + 2)]
    phi = [-math.sin(math.pi * v) * math.cos(0.5 * math.pi * v) ** 2 for v in x]
    second = [phi[i - 1] - 2.0 * phi[i] + phi[i + 1] for i in range(1, len(phi) - 1)]
    return tuple(phi[1:-1]), tuple(second)


PHI, PHI_SECOND = _weights()


def _kept() -> deque[float]:
    return deque([0.0] * (2 * REACH + 1), 2 * REACH + 1)


@dataclass(slots=True)
class Rise:
    """The rise [Pa], and the ticks about the reversal being watched, newest first."""

    tick_s: float
    rise_Pa: float = 0.0
    reversals: int = 0
    sign: float = 0.0
    since: int = 0
    surplus_Pa: deque[float] = field(default_factory=_kept)
    ahead_m: deque[float] = field(default_factory=_kept)
    part: deque[float] = field(default_factory=_kept)

    def watch(self, velocity_m_s: float, surplus_Pa: float, ahead_m: float, part: float) -> bool:
        """One tick: wanted velocity, pressure and position above the wanted ones, wanted share of the rise. True when
        a reversal lies in the middle of what is kept."""
        self.surplus_Pa.appendleft(surplus_Pa)
        self.ahead_m.appendleft(ahead_m)
        self.part.appendleft(part)
        if velocity_m_s * self.sign < 0.0:
            self.since = 0
        if velocity_m_s:
            self.sign = velocity_m_s
        self.since += 1
        return self.since == REACH + 1

    def learn(self, inertia_Pa: float, highest_Pa: float) -> None:
        """Take the reversal in; `inertia_Pa` is p1, pressure per m/s2."""
        seen = sum(map(mul, PHI, self.part))
        if abs(seen) < SEEN_LOW:
            return
        missing = sum(map(mul, PHI, self.surplus_Pa))
        missing -= inertia_Pa * sum(map(mul, PHI_SECOND, self.ahead_m)) / self.tick_s**2
        self.reversals += 1
        self.rise_Pa += max(RATE_LOW, 1.0 / self.reversals) * missing / seen
        self.rise_Pa = min(max(self.rise_Pa, 0.0), highest_Pa)
