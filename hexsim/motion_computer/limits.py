"""Limits of a host's setpoints: excursion, velocity and acceleration of each coordinate, kept smoothly.

    target    p_t -> f(p_t):  f(p) = p up to (1 - s) L, then L (1 - s + s tanh((p/L - 1 + s)/s)): never reaches L
    follower  a = sat(f'' + 2 w (f' - v) + w^2 (f - p), +-a_max),  |v| <= v_max,  |v| <= sqrt(2 a_max (L - |p|))

Within the limits the follower has the target's position, velocity and acceleration and no lag; beyond them it takes the
quickest motion that the limits allow and comes back with continuous velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.workspace import excursions

Array = NDArray[np.float64]
SOFT_SHARE = 0.1  # of the excursion, in which it is compressed
RETURN_rad_s = 12.0  # w, how fast the follower comes back to its target
LEG_MARGIN_m = 0.005  # kept free of the cushions
LEG_SOFT_m = 0.010  # in which a leg's setpoint is compressed


@dataclass(frozen=True, kw_only=True, eq=False)
class Limits:
    """Of n coordinates, arrays (n,) [m or rad, and per s, per s2]; excursion counts from neutral, both ways."""

    excursion: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        for name in ("excursion", "velocity", "acceleration"):
            value = np.array(getattr(self, name), dtype=float)
            if value.ndim != 1 or not (np.isfinite(value).all() and (value > 0).all()):
                raise HexsimError(f"limits: {name} is {value}; give a number above zero for each coordinate")
            object.__setattr__(self, name, value)


def dof_limits(kinematics: Mechanics) -> Limits:
    """Of the platform: 90 % of what each degree of freedom reaches alone; 0.3 m/s and 3 m/s2, 20 deg/s and 150 deg/s2.

    Velocities and accelerations are assumed values for people on board, well inside the machine's flow.
    """
    excursion = [0.9 * min(-one.minimum, one.maximum) for one in excursions(kinematics)]
    return Limits(
        excursion=np.array(excursion),
        velocity=np.array([0.3] * 3 + [np.radians(20.0)] * 3),
        acceleration=np.array([3.0] * 3 + [np.radians(150.0)] * 3),
    )


def pose_limits(machine: Machine) -> Limits:
    """Of the degrees of freedom that a host moves: `dof_limits` of a hexapod, `leg_limits` of a bench."""
    mechanics = machine.mechanics
    return dof_limits(mechanics) if mechanics.has_platform else leg_limits(machine)


def leg_limits(machine: Machine) -> Limits:
    """Of single actuators, from the neutral pose: clear of the cushions; 0.3 m/s and 3 m/s2."""
    n, neutral = machine.n_legs, machine.mechanics.neutral_positions
    reach = np.minimum(neutral, machine.mechanics.stroke_m - neutral)
    excursion = reach - machine.of_legs("cylinder", "cushion_length_m") - LEG_MARGIN_m
    return Limits(excursion=excursion, velocity=np.full(n, 0.3), acceleration=np.full(n, 3.0))


@compiled
def _follow(p, v, target, target_rate, target_acceleration, dt, excursion, velocity, acceleration, share, w):
    """One step of the follower, in place; returns how far the target lies beyond the excursion's soft part [share]."""
    beyond = 0.0
    for i in range(p.shape[0]):
        L = excursion[i]
        position, speed, change = target[i], target_rate[i], target_acceleration[i]
        over = abs(position) / L - (1.0 - share)
        if over > 0.0:
            beyond = max(beyond, over)
            t = np.tanh(over / share)
            slope = 1.0 - t * t
            change = slope * change - 2.0 * t * slope / (share * L) * speed * speed * np.sign(position)
            speed *= slope
            position = np.sign(position) * L * (1.0 - share + share * t)
        a = change + 2.0 * w * (speed - v[i]) + w * w * (position - p[i])
        a = min(max(a, -acceleration[i]), acceleration[i])
        up = min(velocity[i], np.sqrt(2.0 * 0.9 * acceleration[i] * max(L - p[i], 0.0)))
        down = min(velocity[i], np.sqrt(2.0 * 0.9 * acceleration[i] * max(L + p[i], 0.0)))
        after = min(max(v[i] + a * dt, -down), up)
        p[i] += 0.5 * (v[i] + after) * dt
        v[i] = after
    return beyond


class CommandLimiter:
    """Follows targets of n coordinates within `limits`, from rest at neutral. position, velocity: arrays (n,)."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.position = np.zeros(len(limits.excursion))
        self.velocity = np.zeros(len(limits.excursion))
        self.limited = False

    def step(self, target: Array, velocity: Array, acceleration: Array, dt: float) -> Array:
        """The position (n,) `dt` later. Targets are those of the present time."""
        limits = self.limits
        beyond = _follow(
            self.position, self.velocity, target, velocity, acceleration, dt,
            limits.excursion, limits.velocity, limits.acceleration, SOFT_SHARE, RETURN_rad_s,
        )  # fmt: skip
        self.limited = beyond > 0.0
        return self.position.copy()


def soft_legs(positions: Array, stroke_m: ArrayLike, cushion_m: ArrayLike) -> tuple[Array, bool]:
    """Piston setpoints held clear of the cushions, and whether any had to be: tanh within the last `LEG_SOFT_m`.

    Poses that are each within their limits can together exceed the stroke of a leg.
    """
    half = 0.5 * np.asarray(stroke_m)
    linear = half - np.asarray(cushion_m) - LEG_MARGIN_m - LEG_SOFT_m
    offset = positions - half
    over = np.abs(offset) - linear
    if not (over > 0.0).any():
        return positions, False
    held = np.sign(offset) * (linear + LEG_SOFT_m * np.tanh(np.maximum(over, 0.0) / LEG_SOFT_m))
    return half + np.where(over > 0.0, held, offset), True
