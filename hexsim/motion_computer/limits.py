"""Limits of a host's setpoints, from the table [host_limits], and how the machine keeps excursion, velocity and acceleration.

What leaves a host passes `host_setpoint_limiter` first; the machine trusts no host and limits again, here.

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
from hexsim.mechanics.workspace import excursions

Array = NDArray[np.float64]
LEG_MARGIN_m = 0.005  # kept free of the cushions


@dataclass(frozen=True, kw_only=True, eq=False)
class Limits:
    """Of n coordinates, arrays (n,) [m or rad, and per s, s2, s3]; excursion counts from neutral, both ways."""

    excursion: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        for name in ("excursion", "velocity", "acceleration", "jerk"):
            value = np.array(getattr(self, name), dtype=float)
            if value.ndim != 1 or not (np.isfinite(value).all() and (value > 0).all()):
                raise HexsimError(f"limits: {name} is {value}; give a number above zero for each coordinate")
            object.__setattr__(self, name, value)

    def scaled(self, share: float) -> Limits:
        """The limits of a motion that is `share` times as large."""
        return Limits(
            excursion=share * self.excursion,
            velocity=share * self.velocity,
            acceleration=share * self.acceleration,
            jerk=share * self.jerk,
        )


def dof_limits(
    machine: Machine,
    *,
    reach_share: float = 0.9,  # of what a degree of freedom reaches alone
) -> Limits:
    """Of a platform: 90 % of what each degree of freedom reaches alone, and the derivatives of [host_limits]."""
    own = machine.host_limits
    reach = np.array([min(-one.minimum, one.maximum) for one in excursions(machine.mechanics)])
    turning = np.radians([own.angular_velocity_deg_s, own.angular_acceleration_deg_s2, own.angular_jerk_deg_s3])
    along = np.array([own.velocity_m_s, own.acceleration_m_s2, own.jerk_m_s3])
    velocity, acceleration, jerk = np.repeat(np.stack([along, turning], axis=1), 3, axis=1)
    return Limits(
        excursion=reach_share * own.stroke_share * reach, velocity=velocity, acceleration=acceleration, jerk=jerk
    )


def pose_limits(machine: Machine) -> Limits:
    """Of the degrees of freedom that a host moves: `dof_limits` of a hexapod, `leg_limits` of a bench."""
    return dof_limits(machine) if machine.mechanics.has_platform else leg_limits(machine)


def leg_limits(machine: Machine) -> Limits:
    """Of single actuators, from the neutral pose: clear of the cushions, and the derivatives of [host_limits]."""
    n, own, neutral = machine.n_legs, machine.host_limits, machine.mechanics.neutral_positions
    reach = np.minimum(neutral, machine.mechanics.stroke_m - neutral)
    free = reach - machine.of_legs("cylinder", "cushion_length_m") - LEG_MARGIN_m
    return Limits(
        excursion=own.stroke_share * free,
        velocity=np.full(n, own.velocity_m_s),
        acceleration=np.full(n, own.acceleration_m_s2),
        jerk=np.full(n, own.jerk_m_s3),
    )


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

    def step(
        self,
        target: Array,
        velocity: Array,
        acceleration: Array,
        dt: float,
        *,
        soft_share: float = 0.1,  # of the excursion, in which it is compressed
        return_rad_s: float = 12.0,  # w, how fast the follower comes back to its target
    ) -> Array:
        """The position (n,) `dt` later. Targets are those of the present time."""
        limits = self.limits
        beyond = _follow(
            self.position,
            self.velocity,
            target,
            velocity,
            acceleration,
            dt,
            limits.excursion,
            limits.velocity,
            limits.acceleration,
            soft_share,
            return_rad_s,
        )
        self.limited = beyond > 0.0
        return self.position.copy()


def soft_legs(
    positions: Array,
    stroke_m: ArrayLike,
    cushion_m: ArrayLike,
    *,
    soft_m: float = 0.010,  # in which a leg's setpoint is compressed
) -> tuple[Array, bool]:
    """Piston setpoints held clear of the cushions, and whether any had to be: tanh within the last `soft_m`.

    Poses that are each within their limits can together exceed the stroke of a leg.
    """
    half = 0.5 * np.asarray(stroke_m)
    linear = half - np.asarray(cushion_m) - LEG_MARGIN_m - soft_m
    offset = positions - half
    over = np.abs(offset) - linear
    if not (over > 0.0).any():
        return positions, False
    held = np.sign(offset) * (linear + soft_m * np.tanh(np.maximum(over, 0.0) / soft_m))
    return half + np.where(over > 0.0, held, offset), True
