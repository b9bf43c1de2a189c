"""Motion at points of a rigid platform, and what accelerometers mounted there read. Everything in the platform's frame.

    v_p = v + w x r            a_p = a + w' x r + w x (w x r)            r: from the origin of the frame to the point

An IMU turned by R = Rz(yaw) Ry(pitch) Rx(roll) against the frame reads R' a_p and R' w'.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.mechanics.leg_geometry import write_rotation
from hexsim.mechanics.rigid_body import point_accelerations

Array = NDArray[np.float64]


def point_velocity(velocity: Array, omega: Array, point_m: ArrayLike) -> Array:
    """v_p (n, 3) from v and w (n, 3)."""
    return velocity + np.cross(omega, np.asarray(point_m, dtype=float))


def point_acceleration(acceleration: Array, turning: Array, omega: Array, point_m: ArrayLike) -> Array:
    """a_p (n, 3) from a, w' and w (n, 3)."""
    motion = np.ascontiguousarray(np.concatenate([acceleration, turning], axis=1))
    x, y, z = map(float, np.asarray(point_m))
    return point_accelerations((x, y, z), motion, np.ascontiguousarray(omega))


def mounting(orientation_deg: ArrayLike) -> Array:
    """R (3, 3): from the axes of an IMU to those of the platform."""
    rotation = np.empty((3, 3))
    write_rotation(np.concatenate([np.zeros(3), np.radians(np.asarray(orientation_deg, dtype=float))]), rotation)
    return rotation


def imu_reading(
    acceleration: Array, turning: Array, omega: Array, position_m: ArrayLike, rotation: Array
) -> tuple[Array, Array]:
    """(a, w') (n, 3) along the axes of an IMU, R (3, 3), from those of the platform's origin; unchanged where it sits there."""
    if np.any(position_m):
        acceleration = point_acceleration(acceleration, turning, omega, position_m)
    if np.array_equal(rotation, np.eye(3)):
        return acceleration, turning
    return acceleration @ rotation, turning @ rotation


def origin_motion(
    reading: Array, turning: Array, omega: Array, position_m: ArrayLike, orientation_deg: ArrayLike
) -> tuple[Array, Array]:
    """The inverse of `imu_reading`; omega (n, 3) along the platform's axes."""
    if not np.any(position_m) and not np.any(orientation_deg):
        return reading, turning
    rotation = mounting(orientation_deg)
    turned = turning @ rotation.T
    offset = point_acceleration(np.zeros_like(turned), turned, omega, position_m)
    return reading @ rotation.T - offset, turned
