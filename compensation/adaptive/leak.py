"""Leak of the valve: oil that flows into the chamber while both edges are closed, from passages over the overlap."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .valve import ValveEstimator

LEAK_PRIOR_M_S = 8e-3  # standard deviation before anything is known
MAX_LEAK_M_S = 2e-2  # a passage with more is something else
LEAK_TOLERANCE_M_S = 2e-4  # a smaller one, or a smaller change, is not taken into account
LEAK_NOISE_M = 7e-6  # of a passage: two positions, and the residual of the identified edges
LEAK_MEMORY, LEAK_PASSAGES = 15.0, 2  # passages; and how many must have been seen
LEAK_ERRORS = 4.0  # standard errors from which there is a leak; half of them to stay
MISFIT_SHARE = 0.2  # low-pass of the misfit


@dataclass(slots=True)
class LeakEstimator:
    """Oil that flows into the chamber though the valve is closed [m/s], from passages over the whole overlap.

    A leak shifts the edges that the windows see, in volts, as a null offset does. Only while the valve is closed do the
    two part: with the edges as the windows see them, a passage moves q T more oil than it should, T the time between
    the edges, whatever the speed.
    """

    leak_m_s: float = 0.0
    variance: float = LEAK_PRIOR_M_S**2
    passages: int = 0
    misfit: float = 1.0
    positive: bool = False  # the passage came from there
    excess_m: float = math.nan
    closed_s: float = 0.0

    @property
    def known(self) -> bool:
        """Whether it is known well enough to look at what else a passage tells."""
        return self.passages >= LEAK_PASSAGES

    def restore(self, leak_m_s: float) -> None:
        """Start with what was identified before."""
        self.leak_m_s, self.variance, self.passages = leak_m_s, 0.01 * LEAK_PRIOR_M_S**2, LEAK_PASSAGES

    def start(self, positive: bool) -> None:
        """The spool is on the straight part of an edge."""
        self.positive, self.excess_m, self.closed_s = positive, 0.0, 0.0

    def add(self, excess_m: float, closed_s: float) -> None:
        """Oil beyond what sharp edges let through, in a part of the passage."""
        self.excess_m += excess_m
        self.closed_s += closed_s

    def finish(self, positive: bool, taken_m_s: float) -> bool:
        """The spool is on a straight part again; `taken_m_s` is the leak taken off already. True if that must change."""
        excess_m, closed_s, across = self.excess_m, self.closed_s, positive != self.positive
        self.start(positive)
        if not across or closed_s <= 0.0 or not abs(excess_m) < MAX_LEAK_M_S * closed_s:
            return False
        error = excess_m / closed_s + taken_m_s - self.leak_m_s
        expected = (LEAK_NOISE_M / closed_s) ** 2
        total = expected + self.variance
        self.passages += 1
        self.misfit += MISFIT_SHARE * (error * error / total - self.misfit)
        share = self.variance / total
        self.leak_m_s += share * error
        self.variance = min(self.variance * (1.0 - share) * (1.0 + share / LEAK_MEMORY), LEAK_PRIOR_M_S**2)
        found = self.used_m_s(taken_m_s)
        return self.known and abs(found - taken_m_s) > LEAK_TOLERANCE_M_S

    def tell(self, valve: ValveEstimator) -> None:
        """Has the valve's identification take the leak off."""
        valve.leak_known, leak_m_s = self.known, self.used_m_s(valve.leak_m_s)
        if self.known and abs(leak_m_s - valve.leak_m_s) > LEAK_TOLERANCE_M_S:
            valve.set_leak(leak_m_s)

    def used_m_s(self, taken_m_s: float) -> float:
        """The leak to take off [m/s]: 0 where there may be none."""
        errors = LEAK_ERRORS if taken_m_s == 0.0 else 0.5 * LEAK_ERRORS
        sure = abs(self.leak_m_s) > errors * math.sqrt(self.variance * max(1.0, self.misfit)) + LEAK_TOLERANCE_M_S
        return self.leak_m_s if sure else 0.0
