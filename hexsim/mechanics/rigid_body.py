"""A rigid body that is pushed at its joints, and the masses that ride on it on springs: Newton and Euler, once.

Everything in the body's frame, about its origin O (the centre of the platform joints); c: centre of mass from O.

    a_c = a + w' x c + w x (w x c)                              acceleration of the centre of mass
    F   = m a_c - m_c g + m_s (felt_x, felt_y, 0) + (0, 0, B)   felt = a_c - g, what a mass that rides along feels
    M   = I w' + w x (I w) + c x F

(F, M): the wrench that the joints must put on the body. m moves, m_c is carried (they differ where legs are shared between
body and base). m_s rides on springs along z: across that axis it moves with the body, along it its spring pushes back by B.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import bilinear, lfilter

from hexsim.compiled import compiled

Array = np.ndarray


class RigidBody(NamedTuple):
    """mass that moves, mass that is carried, mass on springs along z [kg]; centre (3,) [m]; inertia about it (3, 3) [kg m2]."""

    mass: float
    carried: float
    sprung: float
    centre: Array
    inertia: Array


class Suspension(NamedTuple):
    """A mass [kg] on a spring and damper: natural frequency [rad/s], damping ratio. mass 0: there is none."""

    mass: float
    omega: float
    damping: float


@compiled
def write_cross(a, b, product):
    """a x b, (3,) each."""
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def write_centre_acceleration(c, acceleration, omega, centre):
    """a_c (3,) from (a, w') (6,) and w (3,)."""
    w0, w1, w2 = omega[0], omega[1], omega[2]
    along, square = w0 * c[0] + w1 * c[1] + w2 * c[2], w0 * w0 + w1 * w1 + w2 * w2
    write_cross(acceleration[3:6], c, centre)
    for k in range(3):
        centre[k] += acceleration[k] + omega[k] * along - c[k] * square


@compiled
def write_joint_wrench(body, acceleration, omega, gravity, pushed_back, wrench):
    """(F, M) (6,) for the motion (a, w') (6,) and w (3,) under gravity (3,); pushed_back: B [N]."""
    c, inertia = body.centre, body.inertia
    write_centre_acceleration(c, acceleration, omega, wrench)
    for k in range(3):
        felt = wrench[k] - gravity[k]
        wrench[k] = body.mass * wrench[k] - body.carried * gravity[k] + (body.sprung * felt if k < 2 else pushed_back)
    w0, w1, w2 = omega[0], omega[1], omega[2]
    h0 = inertia[0, 0] * w0 + inertia[0, 1] * w1 + inertia[0, 2] * w2
    h1 = inertia[1, 0] * w0 + inertia[1, 1] * w1 + inertia[1, 2] * w2
    h2 = inertia[2, 0] * w0 + inertia[2, 1] * w1 + inertia[2, 2] * w2
    wrench[3] = w1 * h2 - w2 * h1 + c[1] * wrench[2] - c[2] * wrench[1]
    wrench[4] = w2 * h0 - w0 * h2 + c[2] * wrench[0] - c[0] * wrench[2]
    wrench[5] = w0 * h1 - w1 * h0 + c[0] * wrench[1] - c[1] * wrench[0]
    for k in range(3):
        for j in range(3):
            wrench[3 + k] += inertia[k, j] * acceleration[3 + j]


@compiled
def joint_wrenches(body, acceleration, omega, gravity, pushed_back):
    """(F, M) of every sample (n, 6): acceleration (n, 6), omega and gravity (n, 3), pushed_back (n,)."""
    wrench = np.empty(acceleration.shape)
    for i in range(acceleration.shape[0]):
        write_joint_wrench(body, acceleration[i], omega[i], gravity[i], pushed_back[i], wrench[i])
    return wrench


@compiled
def centre_accelerations(body, acceleration, omega):
    """a_c of every sample (n, 3)."""
    centre = np.empty(omega.shape)
    for i in range(omega.shape[0]):
        write_centre_acceleration(body.centre, acceleration[i], omega[i], centre[i])
    return centre


def mass_matrix(body: RigidBody) -> Array:
    """(6, 6): how the wrench grows with (a, w'), constant in the body's frame."""
    nothing = np.zeros((6, 3))
    return joint_wrenches(body, np.eye(6), nothing, nothing, np.zeros(6)).T


@compiled
def write_body_acceleration(body, compliance, wrench, omega, gravity, pushed_back, rest, acceleration):
    """(a, w') (6,) under the wrench of the joints (6,): what is left of it at zero acceleration, times the inverse mass matrix.

    compliance: inverse of `mass_matrix` (6, 6).  rest (6,): room to work in.
    """
    acceleration[:] = 0.0
    write_joint_wrench(body, acceleration, omega, gravity, pushed_back, rest)
    for k in range(6):
        rest[k] = wrench[k] - rest[k]
    for k in range(6):
        for j in range(6):
            acceleration[k] += compliance[k, j] * rest[j]


@compiled
def axial_acceleration(body, force, gravity, pushed_back):
    """a [m/s2] of a body that only moves along z: the third row of F, solved."""
    return (force + body.carried * gravity - pushed_back) / body.mass


def joined(one: RigidBody, other: RigidBody) -> RigidBody:
    """Two bodies as one, by the parallel-axis theorem."""
    mass = one.mass + other.mass
    centre = (one.mass * one.centre + other.mass * other.centre) / mass
    inertia = one.inertia + other.inertia
    for body in (one, other):
        arm = body.centre - centre
        inertia = inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return RigidBody(mass, one.carried + other.carried, one.sprung + other.sprung, centre, inertia)


# A mass on a spring: travel q along the axis from the unstressed spring, q'' = -(w^2 q + 2 zeta w q') - felt.


@compiled
def spring_acceleration(suspension, travel, rate):
    """w^2 q + 2 zeta w q' [m/s2]: by it, times the mass, the spring pulls the body along its axis."""
    omega = suspension.omega
    return omega * omega * travel + 2.0 * suspension.damping * omega * rate


def pushed_back(suspension: Suspension, felt: Array, rate: float) -> Array:
    """Specific force (n,) [m/s2] that a mass on a spring gives back when its foot feels `felt` (n,), steady at first.

    (2 zeta w p + w^2)/(p^2 + 2 zeta w p + w^2), the transfer function of `spring_acceleration`, by the bilinear rule (0.1 %
    off in frequency at 17 Hz and 1 kHz). felt: acceleration less gravity along the spring.
    """
    damper = 2 * suspension.damping * suspension.omega
    top, bottom = bilinear([damper, suspension.omega**2], [1.0, damper, suspension.omega**2], rate)
    return lfilter(top, bottom, felt - felt[0]) + felt[0]


@compiled
def write_rotation_of(q, R):
    """Rotation (3, 3), body to world, of a quaternion (w, x, y, z), normalised."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w, x, y, z = q[0] / n, q[1] / n, q[2] / n, q[3] / n
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled
def write_quaternion_rate(q, omega, rate):
    """dq/dt (4,) = q o (0, w)/2 with w (3,) in the body's frame."""
    w0, w1, w2 = omega[0], omega[1], omega[2]
    rate[0] = 0.5 * (-q[1] * w0 - q[2] * w1 - q[3] * w2)
    rate[1] = 0.5 * (q[0] * w0 + q[2] * w2 - q[3] * w1)
    rate[2] = 0.5 * (q[0] * w1 - q[1] * w2 + q[3] * w0)
    rate[3] = 0.5 * (q[0] * w2 + q[1] * w1 - q[2] * w0)
