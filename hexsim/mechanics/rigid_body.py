"""A rigid body that is pushed at its joints, and the masses that ride on it on springs: Newton and Euler, once.

Everything in the body's frame, about its origin O (the centre of the platform joints); c: centre of mass from O.

    a_c = a + w' x c + w x (w x c)                              acceleration of the centre of mass
    F   = m a_c - m_c g,   M = I w' + w x (I w) + c x F

(F, M): the wrench that the joints must put on the body. m moves, m_c is carried (they differ where legs are shared between
body and base). A mass m_s on a spring along n (unit vector, fixed in the body) with travel q adds

    f   = a + w' x p + w x (w x p) + 2 q' w x n - g,   p = place + (q - rest) n     what it feels besides q''
    q'' = -(w_s^2 q + 2 zeta w_s q') - n . f
    F_s = m_s (f + q'' n),   M_s = p x F_s                      across n it moves with the body
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hexsim.compiled import allocating, compiled

Array = np.ndarray
Vector = tuple[float, float, float]


class RigidBody(NamedTuple):
    """mass that moves, mass that is carried [kg]; centre [m]; rows of the inertia about it [kg m2]."""

    mass: float
    carried: float
    centre: Vector
    inertia: tuple[Vector, Vector, Vector]


class Suspension(NamedTuple):
    """A mass [kg] on a spring and damper: natural frequency [rad/s], damping ratio. mass 0: there is none.

    axis: unit vector of its travel; place [m]: where it stands when the body is level and at rest, and rest [m]: its travel
    from the unstressed spring there.
    """

    mass: float
    omega: float
    damping: float
    axis: Vector = (0.0, 0.0, 1.0)  # up
    place: Vector = (0.0, 0.0, 0.0)  # in the origin
    rest: float = 0.0  # unstressed


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
def joint_wrench(body, a, turning, omega, gravity):
    """(F, M) for a motion under gravity."""
    m, carried = body.mass, body.carried
    x, y, z = centre_acceleration(body.centre, a, turning, omega)
    force = (m * x - carried * gravity[0], m * y - carried * gravity[1], m * z - carried * gravity[2])
    spun, lever = cross(omega, rotated(body.inertia, omega)), cross(body.centre, force)
    grown = rotated(body.inertia, turning)
    return force, (grown[0] + spun[0] + lever[0], grown[1] + spun[1] + lever[1], grown[2] + spun[2] + lever[2])


@compiled
def triple(values, first):
    """Three numbers of a row as a vector."""
    return values[first], values[first + 1], values[first + 2]


@compiled
def ride_wrench(suspension, a, turning, omega, gravity, travel, rate):
    """(F_s, M_s, n . f) of a mass on a spring, for a motion of the body and its own travel [m] and rate [m/s]."""
    n, place, off = suspension.axis, suspension.place, travel - suspension.rest
    p = (place[0] + off * n[0], place[1] + off * n[1], place[2] + off * n[2])
    x, y, z = centre_acceleration(p, a, turning, omega)
    turned, twice = cross(omega, n), 2.0 * rate
    f = (
        x + twice * turned[0] - gravity[0],
        y + twice * turned[1] - gravity[1],
        z + twice * turned[2] - gravity[2],
    )
    felt = dot(n, f)
    along, m = spring_acceleration(suspension, travel, rate) + felt, suspension.mass
    force = (m * (f[0] - along * n[0]), m * (f[1] - along * n[1]), m * (f[2] - along * n[2]))
    return force, cross(p, force), felt


@compiled
def add_ride_wrenches(wrench, suspension, acceleration, omega, gravity, travel, rate):
    """Add (F_s, M_s) of every sample to a wrench (n, 6); the rest as in `joint_wrenches`, travel and rate (n,)."""
    for i in range(wrench.shape[0]):
        motion = acceleration[i]
        force, moment, _ = ride_wrench(
            suspension,
            triple(motion, 0),
            triple(motion, 3),
            triple(omega[i], 0),
            triple(gravity[i], 0),
            travel[i],
            rate[i],
        )
        for k in range(3):
            wrench[i, k] += force[k]
            wrench[i, 3 + k] += moment[k]


@allocating
def joint_wrenches(body, acceleration, omega, gravity):
    """(F, M) of every sample (n, 6): acceleration (a, w') (n, 6), omega and gravity (n, 3)."""
    wrench = np.empty(acceleration.shape)
    for i in range(acceleration.shape[0]):
        motion, field = acceleration[i], gravity[i]
        force, moment = joint_wrench(body, triple(motion, 0), triple(motion, 3), triple(omega[i], 0), triple(field, 0))
        wrench[i, 0], wrench[i, 1], wrench[i, 2] = force
        wrench[i, 3], wrench[i, 4], wrench[i, 5] = moment
    return wrench


@allocating
def point_accelerations(place, acceleration, omega):
    """Acceleration (n, 3) of a point of the body, every sample."""
    found = np.empty(omega.shape)
    for i in range(omega.shape[0]):
        motion = acceleration[i]
        found[i, 0], found[i, 1], found[i, 2] = centre_acceleration(
            place, triple(motion, 0), triple(motion, 3), triple(omega[i], 0)
        )
    return found


def mass_matrix(body: RigidBody, riding: Suspension | None = None) -> Array:
    """(6, 6): how the wrench grows with (a, w'), constant in the body's frame. riding: where it stands at rest."""
    nothing = np.zeros((6, 3))
    own = joint_wrenches(body, np.eye(6), nothing, nothing).T
    if riding is None:
        return own
    moved = np.hstack([np.eye(3), -np.cross(np.eye(3), riding.place)])  # acceleration of its place
    across = moved - np.outer(riding.axis, riding.axis) @ moved
    return own + riding.mass * across.T @ across


@compiled
def body_acceleration(body, compliance, force, moment, omega, gravity):
    """(a, w') under the wrench of the joints: what is left of it at zero acceleration, times the inverse mass matrix.

    compliance: inverse of `mass_matrix`, (6, 6).
    """
    none = (0.0, 0.0, 0.0)
    F, M = joint_wrench(body, none, none, omega, gravity)
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


def rigid_body(mass: float, centre: ArrayLike, inertia: ArrayLike, carried: float) -> RigidBody:
    """A body from centre (3,) and inertia about it (3, 3)."""
    x, y, z = (float(c) for c in np.asarray(centre))
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in np.asarray(inertia))
    return RigidBody(float(mass), float(carried), (x, y, z), (rows[0], rows[1], rows[2]))


def joined(one: RigidBody, other: RigidBody) -> RigidBody:
    """Two bodies as one, by the parallel-axis theorem."""
    mass = one.mass + other.mass
    centre = (one.mass * np.array(one.centre) + other.mass * np.array(other.centre)) / mass
    inertia = np.array(one.inertia) + np.array(other.inertia)
    for body in (one, other):
        arm = np.array(body.centre) - centre
        inertia = inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return rigid_body(mass, centre, inertia, one.carried + other.carried)


# A mass on a spring: travel q along the axis from the unstressed spring, q'' = -(w^2 q + 2 zeta w q') - felt.


@allocating  # of a whole ride
def spring_acceleration(suspension, travel, rate):
    """w^2 q + 2 zeta w q' [m/s2]: by it, times the mass, the spring pulls the body along its axis."""
    omega = suspension.omega
    return omega * omega * travel + 2.0 * suspension.damping * omega * rate


def ride(suspension: Suspension, felt: Array, rate: float) -> tuple[Array, Array]:
    """Travel (n,) [m] and its rate [m/s] of a mass on a spring whose foot feels `felt` (n,), steady at first.

    -1/(p^2 + 2 zeta w p + w^2) and -p/(...) by the bilinear rule (0.1 % off in frequency at 17 Hz and 1 kHz).
    felt: acceleration less gravity along the spring.
    """
    bottom = [1.0, 2 * suspension.damping * suspension.omega, suspension.omega**2]
    filters = [scipy.signal.bilinear(top, bottom, rate) for top in ([-1.0], [-1.0, 0.0])]
    travel, speed = (np.asarray(scipy.signal.lfilter(*own, felt - felt[0])) for own in filters)
    return travel - felt[0] / suspension.omega**2, speed


def pushed_back(suspension: Suspension, felt: Array, rate: float) -> Array:
    """Specific force (n,) [m/s2] that a mass on a spring gives back when its foot feels `felt` (n,), see `ride`."""
    return -spring_acceleration(suspension, *ride(suspension, felt, rate))


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
