"""Smooth paths of the setpoints: stop from any motion, move from rest to rest, one after the other.

    stop   velocity v(r) = v0 h0(r) + a0 T h1(r),  r = t/T,  cubic Hermite from (v0, a0) to (0, 0)
    move   s(r) = s0 + (s1 - s0) (10 r^3 - 15 r^4 + 6 r^5)

Velocity and acceleration are continuous. All coordinates of a path share their durations, the shortest that keep
every velocity and acceleration limit:
    move   peak velocity 15/8 d/T, peak acceleration 10/sqrt(3) d/T^2
    stop   peak acceleration 1.5 |v0|/T from a0 = 0; |a0| itself where that is larger
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """Stop, then move; arrays (n,). Times count from `start_s`; before it the start is held, after `end_s` the end."""

    start_s: float
    stop_s: float
    move_s: float
    start: Array
    velocity: Array
    acceleration: Array
    rest: Array  # where the stop ends
    target: Array

    @property
    def end_s(self) -> float:
        return self.start_s + self.stop_s + self.move_s

    def value(self, time_s: float) -> Array:
        """Setpoints (n,) at a time [s]."""
        r = min(max((time_s - self.start_s) / self.stop_s, 0.0), 1.0)
        if r < 1.0:
            # integrals of the Hermite polynomials h0 = 1 - 3 r^2 + 2 r^3 and h1 = r - 2 r^2 + r^3
            along = r - r**3 + 0.5 * r**4
            bent = 0.5 * r**2 - 2.0 / 3.0 * r**3 + 0.25 * r**4
            return self.start + self.stop_s * (along * self.velocity + bent * self.stop_s * self.acceleration)
        if self.move_s == 0.0:
            return self.target
        q = min((time_s - self.start_s - self.stop_s) / self.move_s, 1.0)
        return self.rest + (self.target - self.rest) * q**3 * (10.0 - 15.0 * q + 6.0 * q**2)


def stop_and_move(
    time_s: float,
    start: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    target: ArrayLike | None,
    *,
    velocity_max: ArrayLike,
    acceleration_max: ArrayLike,
    stop_acceleration_max: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    peak_velocity: float = 15.0 / 8.0,  # of the quintic, over distance and time
    peak_acceleration: float = 10.0 / np.sqrt(3.0),  # of the quintic, over distance and time squared
    shortest_s: float = 0.05,  # no stop or move is shorter
) -> Path:
    """A path from the present motion to rest at `target` (None: to rest, wherever that is).

    All (n,) or numbers that stand for all. bounds: the stop is made shorter, at the cost of acceleration, where it
    would carry a coordinate beyond them.
    """
    s0, v0, a0 = (np.array(value, dtype=float) for value in (start, velocity, acceleration))
    limit = np.broadcast_to(np.asarray(stop_acceleration_max, dtype=float), s0.shape)
    a0 = np.clip(a0, -limit, limit)
    stop_s = max(shortest_s, float(np.max(1.5 * np.abs(v0) / limit)))
    if bounds is not None:
        low, high = (np.broadcast_to(np.asarray(bound, dtype=float), s0.shape) for bound in bounds)
        for _ in range(20):
            rest = s0 + stop_s * (0.5 * v0 + a0 * stop_s / 12.0)
            if stop_s <= shortest_s or np.all((rest >= np.minimum(low, s0)) & (rest <= np.maximum(high, s0))):
                break
            stop_s = max(0.8 * stop_s, shortest_s)
    rest = s0 + stop_s * (0.5 * v0 + a0 * stop_s / 12.0)
    end = rest if target is None else np.broadcast_to(np.asarray(target, dtype=float), s0.shape).copy()
    distance = np.abs(end - rest)
    move_s = 0.0
    if np.any(distance > 0.0):
        by_velocity = np.max(peak_velocity * distance / np.asarray(velocity_max, dtype=float))
        by_acceleration = np.max(np.sqrt(peak_acceleration * distance / np.asarray(acceleration_max, dtype=float)))
        move_s = max(shortest_s, float(by_velocity), float(by_acceleration))
    return Path(
        start_s=time_s, stop_s=stop_s, move_s=move_s, start=s0, velocity=v0, acceleration=a0, rest=rest, target=end
    )
