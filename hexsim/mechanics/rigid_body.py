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
from numpy.typing import ArrayLike
from scipy.signal import bilinear, lfilter

from hexsim.compiled import compiled

Array = np.ndarray
Vector = tuple[float, float, float]


class RigidBody(NamedTuple):
    """mass that moves, mass that is carried, mass on springs along z [kg]; centre [m]; rows of the inertia about it [kg m2]."""

    mass: float
    carried: float
    sprung: float
    centre: Vector
    inertia: tuple[Vector, Vector, Vector]


class Suspension(NamedTuple):
    """A mass [kg] on a spring and damper: natural frequency [rad/s], damping ratio. mass 0: there is none."""

    mass: float
    omega: float
    damping: float


@compiled
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def dot(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def rotated(rows, a):
    """Matrix (three rows) times vector."""
    return dot(rows[0], a), dot(rows[1], a), dot(rows[2], a)


@compiled
def rotated_back(rows, a):
    """The transpose of the matrix times vector."""
    r, s, t = rows
    x, y, z = a
    return r[0] * x + s[0] * y + t[0] * z, r[1] * x + s[1] * y + t[1] * z, r[2] * x + s[2] * y + t[2] * z


@compiled
def centre_acceleration(c, a, turning, omega):
    """a_c from a, turning = w' and omega = w."""
    e, n = cross(turning, c), cross(omega, cross(omega, c))
    return a[0] + e[0] + n[0], a[1] + e[1] + n[1], a[2] + e[2] + n[2]


@compiled
def joint_wrench(body, a, turning, omega, gravity, pushed_back):
    """(F, M) for a motion under gravity; pushed_back: B [N]."""
    m, carried, riding = body.mass, body.carried, body.sprung
    x, y, z = centre_acceleration(body.centre, a, turning, omega)
    force = (
        m * x - carried * gravity[0] + riding * (x - gravity[0]),
        m * y - carried * gravity[1] + riding * (y - gravity[1]),
        m * z - carried * gravity[2] + pushed_back,
    )
    spun, lever = cross(omega, rotated(body.inertia, omega)), cross(body.centre, force)
    grown = rotated(body.inertia, turning)
    return force, (grown[0] + spun[0] + lever[0], grown[1] + spun[1] + lever[1], grown[2] + spun[2] + lever[2])


@compiled
def triple(values, first):
    """Three numbers of a row as a vector."""
    return values[first], values[first + 1], values[first + 2]


@compiled
def joint_wrenches(body, acceleration, omega, gravity, pushed_back):
    """(F, M) of every sample (n, 6): acceleration (a, w') (n, 6), omega and gravity (n, 3), pushed_back (n,)."""
    wrench = np.empty(acceleration.shape)
    for i in range(acceleration.shape[0]):
        motion, field = acceleration[i], gravity[i]
        force, moment = joint_wrench(
            body, triple(motion, 0), triple(motion, 3), triple(omega[i], 0), triple(field, 0), pushed_back[i]
        )
        wrench[i, 0], wrench[i, 1], wrench[i, 2] = force
        wrench[i, 3], wrench[i, 4], wrench[i, 5] = moment
    return wrench


@compiled
def centre_accelerations(body, acceleration, omega):
    """a_c of every sample (n, 3)."""
    centre = np.empty(omega.shape)
    for i in range(omega.shape[0]):
        motion = acceleration[i]
        centre[i, 0], centre[i, 1], centre[i, 2] = centre_acceleration(
            body.centre, triple(motion, 0), triple(motion, 3), triple(omega[i], 0)
        )
    return centre


def mass_matrix(body: RigidBody) -> Array:
    """(6, 6): how the wrench grows with (a, w'), constant in the body's frame."""
    nothing = np.zeros((6, 3))
    return joint_wrenches(body, np.eye(6), nothing, nothing, np.zeros(6)).T


@compiled
def body_acceleration(body, compliance, force, moment, omega, gravity, pushed_back):
    """(a, w') under the wrench of the joints: what is left of it at zero acceleration, times the inverse mass matrix.

    compliance: inverse of `mass_matrix`, (6, 6).
    """
    none = (0.0, 0.0, 0.0)
    F, M = joint_wrench(body, none, none, omega, gravity, pushed_back)
    f, m = (force[0] - F[0], force[1] - F[1], force[2] - F[2]), (moment[0] - M[0], moment[1] - M[1], moment[2] - M[2])
    c = compliance
    a = (row_times(c, 0, f, m), row_times(c, 1, f, m), row_times(c, 2, f, m))
    return a, (row_times(c, 3, f, m), row_times(c, 4, f, m), row_times(c, 5, f, m))


@compiled
def row_times(matrix, i, upper, lower):
    """Row of a matrix (6, 6) times a pair of vectors."""
    first = matrix[i, 0] * upper[0] + matrix[i, 1] * upper[1] + matrix[i, 2] * upper[2]
    return first + matrix[i, 3] * lower[0] + matrix[i, 4] * lower[1] + matrix[i, 5] * lower[2]


@compiled
def axial_acceleration(body, force, gravity, pushed_back):
    """a [m/s2] of a body that only moves along z: the third row of F, solved."""
    return (force + body.carried * gravity - pushed_back) / body.mass


def rigid_body(mass: float, centre: ArrayLike, inertia: ArrayLike, carried: float, sprung: float = 0.0) -> RigidBody:
    """A body from centre (3,) and inertia about it (3, 3)."""
    x, y, z = (float(c) for c in np.asarray(centre))
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in np.asarray(inertia))
    return RigidBody(float(mass), float(carried), float(sprung), (x, y, z), (rows[0], rows[1], rows[2]))


def joined(one: RigidBody, other: RigidBody) -> RigidBody:
    """Two bodies as one, by the parallel-axis theorem."""
    mass = one.mass + other.mass
    centre = (one.mass * np.array(one.centre) + other.mass * np.array(other.centre)) / mass
    inertia = np.array(one.inertia) + np.array(other.inertia)
    for body in (one, other):
        arm = np.array(body.centre) - centre
        inertia = inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return rigid_body(mass, centre, inertia, one.carried + other.carried, one.sprung + other.sprung)


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
def rotation_of(q):
    """Rows of the rotation, body to world, of a quaternion (w, x, y, z), normalised."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w, x, y, z = q[0] / n, q[1] / n, q[2] / n, q[3] / n
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@compiled
def quaternion_rate(q, omega):
    """dq/dt = q o (0, w)/2 with w in the body's frame."""
    w, x, y, z = q
    p, r, s = omega
    return (
        0.5 * (-x * p - y * r - z * s),
        0.5 * (w * p + y * s - z * r),
        0.5 * (w * r - x * s + z * p),
        0.5 * (w * s + x * r - y * p),
    )
