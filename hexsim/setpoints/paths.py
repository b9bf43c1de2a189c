"""Setpoint signals made of pieces of polynomial: reversals of constant acceleration, strokes of constant velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from hexsim.declaration import between
from hexsim.setpoints.signal import Array, Cycles, Duration, Signal

Knot = tuple[float, float, float]  # value, velocity, acceleration
Level = Annotated[float, between(1e-6, 1e3, "[m or rad per s or s2]")]
Levels = Annotated[tuple[Level, ...], Field(strict=False, min_length=1, max_length=100)]

# rows: coefficients of r^5 .. r^0 on 0 <= r <= 1; columns: x0, v0, a0, x1, v1, a1 (quintic Hermite)
_QUINTIC = np.array(
    [
        [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
        [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
        [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


class Path:
    """A path from pieces (duration [s], knot at the start, knot at the end), each the one quintic between its knots.

    Between knots that lie on a parabola or a straight line the quintic is that parabola or line.
    ends_s (n + 1,): where the pieces meet; coefficients (6, n): of (t - start of piece)^5 .. ^0.
    """

    def __init__(self, pieces: list[tuple[float, Knot, Knot]]) -> None:
        durations = np.array([piece[0] for piece in pieces])
        scale = np.array([np.ones_like(durations), durations, durations**2])
        knots = np.array([[*start, *end] for _, start, end in pieces]).T * np.concatenate([scale, scale])
        self.ends_s = np.concatenate([[0.0], np.cumsum(durations)])
        self.coefficients = _QUINTIC @ knots / durations ** np.arange(5, -1, -1)[:, None]

    def derivative(self, order: int, time_s: Array) -> Array:
        """Value (order 0), velocity (1) or acceleration (2) at times within the path, by Horner's rule."""
        piece = np.clip(np.searchsorted(self.ends_s, time_s, side="right") - 1, 0, len(self.ends_s) - 2)
        since = time_s - self.ends_s[piece]
        total = np.zeros(np.shape(time_s))
        for power in range(5, order - 1, -1):
            falling = math.perm(power, order)  # power (power - 1) ..., from differentiating
            total = total * since + falling * self.coefficients[5 - power][piece]
        return total


class PathSignal(Signal):
    """A signal that repeats one path; the subclass says which."""

    @cached_property
    def path(self) -> Path:
        return Path(self._pieces())

    def _pieces(self) -> list[tuple[float, Knot, Knot]]:
        raise NotImplementedError

    @property
    def period_s(self) -> float:
        return float(self.path.ends_s[-1])

    def _evaluate(self, order: int, time_s: ArrayLike) -> Array:
        return self.path.derivative(order, np.mod(np.asarray(time_s, dtype=float), self.period_s))

    def value(self, time_s: ArrayLike) -> Array:
        return self._evaluate(0, time_s)

    def velocity(self, time_s: ArrayLike) -> Array:
        return self._evaluate(1, time_s)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return self._evaluate(2, time_s)


@dataclass(frozen=True, kw_only=True)
class ConstantAccelerationReversals(PathSignal):
    """Parabolas: velocity from +a T to -a T at constant acceleration and back, for each a in turn.

    With acceleration constant through v = 0, any structure there is the bump itself (TU Delft,
    "high-efficiency-bump-test", 2024). Each level makes `cycles` cycles of 4 T from bottom to bottom about 0 with
    amplitude a T^2 / 2; quintics of `transition_s` lead from rest at 0 to the first bottom, from one level to the next
    and back to rest at 0. Starts at rest, so it needs no fade-in. Position and velocity are continuous throughout;
    acceleration jumps by 2 a where the velocity is largest.

    accelerations: levels a [m/s2 or rad/s2].  half_time_s: T [s], time from largest velocity to reversal.
    """

    kind: ClassVar[str] = "constant_acceleration_reversals"
    accelerations: Levels = (0.1, 0.05, 0.02, 0.01, 0.005)
    half_time_s: Duration = 1.0
    cycles: Cycles = 3
    transition_s: Duration = 2.0

    def _pieces(self) -> list[tuple[float, Knot, Knot]]:
        t, rest = self.half_time_s, (0.0, 0.0, 0.0)
        bottoms = [(-0.5 * a * t**2, 0.0, a) for a in self.accelerations]
        pieces = [(self.transition_s, rest, bottoms[0])]
        for level, a in enumerate(self.accelerations):
            amplitude = 0.5 * a * t**2
            rising, falling = (0.0, a * t), (0.0, -a * t)
            for _ in range(self.cycles):
                pieces.append((t, (-amplitude, 0.0, a), (*rising, a)))
                pieces.append((2.0 * t, (*rising, -a), (*falling, -a)))
                pieces.append((t, (*falling, a), (-amplitude, 0.0, a)))
            after = bottoms[level + 1] if level + 1 < len(bottoms) else rest
            pieces.append((self.transition_s, bottoms[level], after))
        return pieces

    def reversals(self) -> tuple[Array, Array]:
        """Times [s] in one period, and commanded accelerations, of the reversals with constant acceleration T about.

        All tops, and the bottoms inside a level; the bottoms at its ends have a transition on one side.
        """
        times, accelerations = [], []
        start = self.transition_s
        for a in self.accelerations:
            for cycle in range(self.cycles):
                if cycle > 0:
                    times.append(start)
                    accelerations.append(a)
                times.append(start + 2.0 * self.half_time_s)
                accelerations.append(-a)
                start += 4.0 * self.half_time_s
            start += self.transition_s
        return np.array(times), np.array(accelerations)


@dataclass(frozen=True, kw_only=True)
class ConstantVelocityStrokes(PathSignal):
    """Up and down at each of a range of velocities, with smooth turn-arounds: the friction experiment (report 2.3.3).

    Each level makes `cycles` strokes up and down of constant velocity over `stroke` about 0, shortened to what it
    covers in `longest_s`. Between them a quintic turns the velocity round in `turn_around_s` (it swings out by
    0.3125 v turn_around_s). `transition_s` leads from rest at 0 to the first stroke, from one level to the next and
    back. Velocity and acceleration are continuous. Starts at rest, so it needs no fade-in.

    velocities: levels [m/s or rad/s].  stroke: [m or rad], travel at constant velocity.
    """

    kind: ClassVar[str] = "constant_velocity_strokes"
    velocities: Levels = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
    stroke: Annotated[float, between(1e-6, 100.0, "travel at constant velocity [m or rad]")] = 0.1
    cycles: Cycles = 2
    turn_around_s: Duration = 0.2
    transition_s: Duration = 1.0
    longest_s: Duration = 10.0

    def _level(self, velocity: float) -> tuple[Knot, Knot, Knot, Knot, float]:
        """Knots of one level: start and end of the stroke up, start and end of the stroke down; its duration [s]."""
        half = 0.5 * min(self.stroke, velocity * self.longest_s)
        up, down = (velocity, 0.0), (-velocity, 0.0)
        return (-half, *up), (half, *up), (half, *down), (-half, *down), 2.0 * half / velocity

    def _pieces(self) -> list[tuple[float, Knot, Knot]]:
        rest: Knot = (0.0, 0.0, 0.0)
        levels = [self._level(velocity) for velocity in self.velocities]
        pieces = [(self.transition_s, rest, levels[0][0])]
        for level, following in pairwise([*levels, None]):
            assert level is not None
            up_start, up_end, down_start, down_end, duration = level
            for cycle in range(self.cycles):
                if cycle > 0:
                    pieces.append((self.turn_around_s, down_end, up_start))
                pieces.append((duration, up_start, up_end))
                pieces.append((self.turn_around_s, up_end, down_start))
                pieces.append((duration, down_start, down_end))
            pieces.append((self.transition_s, down_end, rest if following is None else following[0]))
        return pieces

    def strokes(self) -> tuple[Array, Array, Array]:
        """Start times [s], end times [s] and velocities (signed) of the strokes in one period."""
        ends = self.path.ends_s
        middle = 0.5 * (ends[:-1] + ends[1:])
        steady = np.abs(self.acceleration(ends[:-1] + 0.25 * np.diff(ends))) < 1e-9 * max(self.velocities)
        steady &= np.abs(self.acceleration(middle)) < 1e-9 * max(self.velocities)
        return ends[:-1][steady], ends[1:][steady], self.velocity(middle[steady])
