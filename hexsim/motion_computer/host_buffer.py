"""A smooth target at each control tick from packets that are late, lost, duplicated or out of order.

Setpoints are played `delay` after the host's clock. With a declared latency, which may be 0, what has not come yet is
predicted (`host_prediction`). Without one the delay is two packet periods, so that as a rule a later setpoint is already
there. In between a cubic through the neighbouring setpoints (Catmull-Rom on their own times) gives position, velocity
and acceleration; where nothing later has come, the target continues with its velocity for `coast_s` and stands still.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.motion_computer.host_packet import HostCommand
from hexsim.motion_computer.host_prediction import AXES, KEPT, add_setpoint, new_prediction, predicted, refit

Array = NDArray[np.float64]
HISTORY = KEPT  # setpoints


class Playing(NamedTuple):
    """Constants of how a host's setpoints are played."""

    coast_s: float = 0.03  # and the longer of both where the future is predicted
    # in which what is played follows the offset: a packet that comes earlier than all before moves nothing at once
    clock_s: float = 0.5
    shortest_gap_s: float = 1.0e-4  # between two setpoints
    new_session_s: float = 1.0  # of silence; then the next packet begins a session
    fastest_Hz: float = 2000.0  # no host sends faster


PLAYING = Playing()


def _ahead(
    sequence: int,
    command: HostCommand,
    *,
    half: int = 2**31,  # of the sequence's range: what is ahead by more is behind
) -> int:
    """By how much the sequence of a packet is ahead of another; it wraps."""
    return (command.sequence - sequence + half) % 2**32 - half


def _follows(before: HostCommand, command: HostCommand) -> bool:
    """Whether a packet continues another: sequence a few ahead, time later by less than a new session's."""
    return (
        0 < _ahead(before.sequence, command) <= HISTORY
        and PLAYING.shortest_gap_s <= command.time_s - before.time_s < PLAYING.new_session_s
    )


def _sample(command: HostCommand) -> tuple[float, int, Array]:
    """Time, sequence, and the setpoints with their derivatives (3, AXES), NaN where the host does not give them."""
    motion = np.full((3, AXES), np.nan)
    motion[0] = command.setpoints
    if command.derivatives is not None:
        motion[1:] = command.derivatives
    return command.time_s, command.sequence, motion


class HostBuffer:
    """Setpoints of one host. counts: accepted, duplicate, late (too late to be played), inconsistent (clock or
    sequence contradict the newest packet), resynchronised (the newest was the inconsistent one).

    latency_s: how long after the host's clock a setpoint is played; what is then missing is predicted, as far ahead as
    ahead_s. None: two packet periods, and nothing is predicted.
    """

    def __init__(self, latency_s: float | None = None, ahead_s: float = 0.0) -> None:
        self.latency_s, self.ahead_s = latency_s, ahead_s
        self.counts = {"accepted": 0, "duplicate": 0, "late": 0, "inconsistent": 0, "sessions": 0, "resynchronised": 0}
        self._clear()

    def _clear(self) -> None:
        self._samples: list[tuple[float, int, Array]] = []  # (host time, sequence, setpoints and derivatives (3, AXES))
        self._offset = self._smooth = 0.0
        self._period = 0.0
        self.newest: HostCommand | None = None
        self._inconsistent: list[HostCommand] = []  # the last packets that contradict the newest one
        self.last_packet_s = -np.inf
        self._played = -np.inf
        self._prediction = new_prediction()

    def add(
        self,
        command: HostCommand,
        now_s: float,
        *,
        drift: float = 1.0e-3,  # how fast the clock offset may grow when packets come later and later
        earliest_s: float = 0.1,  # ahead of the host's clock as known; no network is faster than its fastest packet by more
        latest_s: float = 0.25,  # behind it; whatever comes later is too late to be played
    ) -> bool:
        """Take a command that arrived at machine time now_s; False when it is not used. Any input is allowed."""
        newest = self.newest
        if newest is not None and now_s - self.last_packet_s > PLAYING.new_session_s:
            self._clear()
            newest = None
        if newest is None:
            self.counts["sessions"] += 1
            self._offset = self._smooth = now_s - command.time_s
        else:
            ahead = _ahead(newest.sequence, command)
            same = [time for time, sequence, _ in self._samples if sequence == command.sequence]
            if command.time_s in same or (ahead == 0 and command.time_s == newest.time_s):
                self.counts["duplicate"] += 1
                return False
            early = command.time_s + self._offset - now_s
            missed = ahead > HISTORY + PLAYING.fastest_Hz * (now_s - self.last_packet_s)
            if (
                ahead == 0
                or same
                or missed
                or not -latest_s < early < earliest_s
                or (ahead > 0) != (command.time_s > newest.time_s)
            ):
                return self._resynchronise(command, now_s)
            if any(abs(time - command.time_s) < PLAYING.shortest_gap_s for time, _, _ in self._samples):
                self.counts["inconsistent"] += 1
                return False
            if ahead < 0 and command.time_s <= self._played:
                self.counts["late"] += 1
                return False
            self._inconsistent.clear()
            if ahead > 0:
                gap = (command.time_s - newest.time_s) / ahead
                self._period += 0.1 * (gap - self._period) if self._period else gap
            gap = max(now_s - self.last_packet_s, 0.0)
            self._offset = min(self._offset + drift * gap, now_s - command.time_s)
            self._smooth += (1.0 - math.exp(-gap / PLAYING.clock_s)) * (self._offset - self._smooth)
        is_newer = newest is None or command.time_s > newest.time_s
        if is_newer:
            self.newest = command
        self.last_packet_s = now_s
        insort(self._samples, _sample(command), key=lambda sample: sample[:2])
        del self._samples[:-HISTORY]
        self._predict(add_setpoint if is_newer else refit)
        self.counts["accepted"] += 1
        return True

    def _predict(
        self,
        fit: Callable[..., None],
        *,
        least_horizon_s: float = 0.03,  # at which predictors are judged: over less, straight lines would do, which have no acceleration
    ) -> None:
        """Fit the predictors to the setpoints there are."""
        if self.latency_s is None:
            return
        times, motions = np.array([one[0] for one in self._samples]), np.array([one[2] for one in self._samples])
        period = self._period or PLAYING.coast_s
        horizon = (max(self.ahead_s + 0.5 * period - self.latency_s, least_horizon_s),) if fit is add_setpoint else ()
        fit(self._prediction, times, motions, period, *horizon)

    def _resynchronise(
        self,
        command: HostCommand,
        now_s: float,
        *,
        n_consistent: int = 3,  # so many packets in a row that continue each other outweigh all that came before
    ) -> bool:
        """Refuse a packet that contradicts what is known of the host's clock and sequence, until n_consistent in a row
        continue each other: then the newest packet was the wrong one, and the session goes on with these."""
        follows = bool(self._inconsistent) and _follows(self._inconsistent[-1], command)
        self._inconsistent = [*self._inconsistent, command] if follows else [command]
        if len(self._inconsistent) < n_consistent:
            self.counts["inconsistent"] += 1
            return False
        first = self._inconsistent[0]
        before = [sample for sample in self._samples if sample[0] < first.time_s and _ahead(sample[1], first) > 0]
        self._samples = [*before, *(_sample(one) for one in self._inconsistent)][-HISTORY:]
        self._period = (command.time_s - first.time_s) / _ahead(first.sequence, command)
        self._offset = self._smooth = now_s - command.time_s
        self._played = min(self._played, command.time_s)
        self.newest, self.last_packet_s, self._inconsistent = command, now_s, []
        self._prediction = new_prediction()
        self._predict(add_setpoint)
        self.counts["accepted"] += 1
        self.counts["resynchronised"] += 1
        return True

    @property
    def delay_s(self) -> float:
        """How long after the host's clock a setpoint is played: as declared, else two packet periods, 4 to 60 ms."""
        if self.latency_s is not None:
            return self.latency_s
        return min(max(2.0 * self._period, 0.004), 0.06)

    def target(self, now_s: float) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration (6,) to be followed at machine time now_s; `ahead_s` later with a latency."""
        zero = np.zeros(6)
        if not self._samples:
            return zero, zero, zero
        if self.latency_s is not None:
            return self._predicted(now_s + self.ahead_s - self._smooth - self.latency_s, self.latency_s)
        time = max(now_s - self._smooth - self.delay_s, self._played)
        self._played = time
        place = bisect_right(self._samples, time, key=lambda sample: sample[0])
        if place == 0:
            return self._samples[0][2][0], zero, zero
        if place == len(self._samples):
            return self._coast(time)
        return self._cubic(place, time)

    def _predicted(
        self,
        time: float,
        latency_s: float,
        *,
        coast_periods: float = 4.0,  # and the longer of both where the future is predicted
    ) -> tuple[Array, Array, Array]:
        """The target at a time of the host's clock, by its setpoints so far; beyond the longest coasting at rest."""
        newest = self._samples[-1][0]
        longest = max(self.ahead_s - latency_s, 0.0) + max(PLAYING.coast_s, coast_periods * self._period)
        position, velocity, acceleration = predicted(self._prediction, min(time, newest + longest))
        moving = float(time <= newest + longest)
        return position, moving * velocity, moving * acceleration

    def _slope(self, place: int) -> Array:
        """Velocity at a setpoint: the parabola through it and its neighbours; one-sided at the ends."""
        samples = self._samples
        here, given = samples[place][2][:2]
        if np.isfinite(given[0]):
            return given
        before = place - 1 if place > 0 else place
        after = place + 1 if place + 1 < len(samples) else place
        t0, t1, t2 = samples[before][0], samples[place][0], samples[after][0]
        left = (here - samples[before][2][0]) / (t1 - t0) if before != place else None
        right = (samples[after][2][0] - here) / (t2 - t1) if after != place else None
        if left is None:
            return np.zeros(6) if right is None else right
        if right is None:
            return left
        return (left * (t2 - t1) + right * (t1 - t0)) / (t2 - t0)

    def _cubic(self, place: int, time: float) -> tuple[Array, Array, Array]:
        t0, _, p0 = self._samples[place - 1]
        t1, _, p1 = self._samples[place]
        h, r = t1 - t0, (time - t0) / (t1 - t0)
        start, change = p0[0], p1[0] - p0[0]
        m0, m1 = h * self._slope(place - 1), h * self._slope(place)
        c2, c3 = 3.0 * change - 2.0 * m0 - m1, m0 + m1 - 2.0 * change
        return (
            start + r * (m0 + r * (c2 + r * c3)),
            (m0 + r * (2.0 * c2 + 3.0 * r * c3)) / h,
            (2.0 * c2 + 6.0 * r * c3) / h**2,
        )

    def _coast(self, time: float) -> tuple[Array, Array, Array]:
        last, zero = len(self._samples) - 1, np.zeros(6)
        beyond = time - self._samples[last][0]
        slope = self._slope(last) if last > 0 else zero
        if beyond > PLAYING.coast_s:
            return self._samples[last][2][0] + PLAYING.coast_s * slope, zero, zero
        return self._samples[last][2][0] + beyond * slope, slope, zero
