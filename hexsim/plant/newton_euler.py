# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""The platform of the tendon model by Newton and Euler, compiled: in place of MuJoCo's evaluation and of its RK4.

One rigid body on six forces needs none of MuJoCo's machinery (trees, constraints, sparse factors): with all masses that
are fixed to the platform as one body, mass m, centre c and inertia I about it, in the platform's frame,

    F  = sum f_i u_i + m_c g + F_x,    M = sum r_i x f_i u_i + ... - c x F       about the centre of mass
    w' = I^-1 (M - w x (I w)),         a = F/m - w' x c - w x (w x c)            of the platform's origin

m_c is the mass that is carried. All numbers are read from mjModel and mjData, where MuJoCo has them, and all results go
where MuJoCo would write them: readers, faults, viewers and the choice of the step see no difference, and both agree to
rounding (tests/plant/test_newton_euler.py). A payload on a spring is a second body: such a model keeps MuJoCo's steps.
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from hexsim.compiled import compiled, compiled_callback
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.mechanics.kinematics import N_LEGS
from hexsim.mechanics.leg_geometry import leg_line
from hexsim.mechanics.mechanics import DOF_NAMES
from hexsim.mechanics.rigid_body import centre_acceleration, cross, dot, rotated, rotated_back, rotation_of, triple
from hexsim.plant.callbacks import WORDS, doubles, leg_bias, leg_rates, offset, supply_rates
from hexsim.plant.states import LEG, ROW, A
from hexsim.plant.structs import slot


class What(IntEnum):
    """What `native_platform` is asked for."""

    LENGTHS = 0
    EVALUATE = 1
    RUNGE_KUTTA = 2


MOST_STATES = 48  # of six legs with all six states each, and of a power unit: 42
N_TWIST = len(DOF_NAMES)  # velocity and turning rate of the platform
N_GAIN = int(mujoco.mjNGAIN)


@intrinsic
def integers(typingctx, address):
    """An address as a pointer to 32-bit integers."""
    signature = types.CPointer(types.int32)(types.uintp)

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], ir.PointerType(ir.IntType(32)))

    return signature, codegen


@intrinsic
def room(typingctx):
    """MOST_STATES doubles on the stack, valid until the function returns."""
    signature = types.CPointer(types.float64)()

    def codegen(context, builder, signature, args):
        return cgutils.alloca_once(builder, ir.DoubleType(), size=MOST_STATES)

    return signature, codegen


@compiled
def turned_by(quaternion, omega, h):
    """The quaternion (w, x, y, z) after h seconds of a constant omega in the body's frame, as MuJoCo turns it."""
    speed = math.sqrt(dot(omega, omega))
    w, x, y, z = quaternion
    if speed < 1e-15:
        return quaternion
    half = 0.5 * h * speed
    c, s = math.cos(half), math.sin(half) / speed
    p, q, r = s * omega[0], s * omega[1], s * omega[2]
    w, x, y, z = (
        w * c - x * p - y * q - z * r,
        w * p + x * c + y * r - z * q,
        w * q - x * r + y * c + z * p,
        w * r + x * q - y * p + z * c,
    )
    n = math.sqrt(w * w + x * x + y * y + z * z)
    return w / n, x / n, y / n, z / n


@compiled
def four(values, first):
    """Four numbers of a row as a quaternion."""
    return values[first], values[first + 1], values[first + 2], values[first + 3]


@compiled
def solved(rows, b):
    """x of A x = b for a symmetric A (3, 3), by its cofactors."""
    (a, d, e), (_, g, f), (_, _, i) = rows
    A, B, C = g * i - f * f, e * f - d * i, d * f - e * g
    det = a * A + d * B + e * C
    D, E, F = a * i - e * e, d * e - a * f, a * g - d * d
    return (
        (A * b[0] + B * b[1] + C * b[2]) / det,
        (B * b[0] + D * b[1] + E * b[2]) / det,
        (C * b[0] + E * b[1] + F * b[2]) / det,
    )


@compiled
def turned_inertia(q, x, y, z):
    """(xx, yy, zz, xy, xz, yz) of principal moments whose axes stand turned by q."""
    if q[0] == 1.0:
        return x, y, z, 0.0, 0.0, 0.0
    r, s, t = rotation_of(q)
    return (
        x * r[0] * r[0] + y * r[1] * r[1] + z * r[2] * r[2],
        x * s[0] * s[0] + y * s[1] * s[1] + z * s[2] * s[2],
        x * t[0] * t[0] + y * t[1] * t[1] + z * t[2] * t[2],
        x * r[0] * s[0] + y * r[1] * s[1] + z * r[2] * s[2],
        x * r[0] * t[0] + y * r[1] * t[1] + z * r[2] * t[2],
        x * s[0] * t[0] + y * s[1] * t[1] + z * s[2] * t[2],
    )


def is_one_body(model: mujoco.MjModel) -> bool:
    """Whether all that moves is one body: a free platform, and what is fixed to it without a turn."""
    if (model.njnt, model.nv) != (1, N_TWIST) or model.na > MOST_STATES:
        return False
    platform = model.jnt_bodyid[0]
    fixed = [b for b in range(model.nbody) if model.body_rootid[b] == platform and b != platform]
    return all(model.body_parentid[b] == platform and model.body_quat[b][0] == 1.0 for b in fixed)


@intrinsic
def doubles_in(typingctx, words, place):
    """The memory of an array of words from a place on, as doubles."""
    signature = types.CPointer(types.float64)(words, types.intp)

    def codegen(context, builder, signature, args):
        first = context.make_array(signature.args[0])(context, builder, value=args[0]).data
        return builder.bitcast(
            builder.gep(first, [args[1]], source_etype=ir.IntType(64)), ir.PointerType(ir.DoubleType())
        )

    return signature, codegen


class Memory(NamedTuple):
    """Where mjModel and mjData keep what is read and written here; names as MuJoCo's."""

    n_bodies: int
    n_states: int
    n_actuators: int
    platform: int  # number of the body
    roots: Any
    masses: Any
    inertias: Any
    centres: Any
    turns: Any
    places: Any
    floats: Any
    sites: Any
    tendons: Any
    wraps: Any
    rows: Any
    gains: Any
    gravity: Any
    qpos: Any
    qvel: Any
    act: Any
    ctrl: Any
    outside: Any
    qacc: Any
    act_dot: Any
    from_legs: Any
    lengths: Any
    velocities: Any
    forces: Any
    tendon_lengths: Any
    tendon_velocities: Any
    xpos: Any
    xquat: Any
    xmat: Any
    xipos: Any
    time: Any


@compiled
def line_of_leg(m, place, rotation, i):
    """Length of leg i, its direction and the moment of its line about the origin, in the world."""
    first = m.tendons[i]
    base, joint = 3 * np.intp(m.wraps[first]), 3 * np.intp(m.wraps[first + 1])
    return leg_line(place, rotation, triple(m.sites, base), triple(m.sites, joint))


@compiled
def write_place(m):
    """Write where the platform stands, and the lengths of the legs."""
    place, q, b = triple(m.qpos, 0), four(m.qpos, 3), m.platform
    rotation = rotation_of(q)
    centre = rotated(rotation, triple(m.centres, 3 * b))
    for k in range(3):
        m.xpos[3 * b + k] = place[k]
        m.xipos[3 * b + k] = place[k] + centre[k]
        for c in range(3):
            m.xmat[9 * b + 3 * k + c] = rotation[k][c]
    for k in range(4):
        m.xquat[4 * b + k] = q[k]
    for i in range(N_LEGS):
        m.tendon_lengths[i] = line_of_leg(m, place, rotation, i)[0]


@compiled
def write_legs(m, h, t, rotation):
    """Write lengths, velocities, forces and states' rates of all legs, and the supply's; return force and moment of the legs
    about the platform's origin, in the world. h: step [s], for stiff laws."""
    place, velocity, omega = triple(m.qpos, 0), triple(m.qvel, 0), rotated(rotation, triple(m.qvel, 3))
    f0 = f1 = f2 = m0 = m1 = m2 = all_demand = all_heat = 0.0
    for i in range(m.n_actuators):
        p = offset(m.rows, i * ROW)
        places = offset(p, N_PARAMETERS)
        last = int(places[A.PRESSURE])
        if places[A.OWNER] != LEG:
            m.act_dot[last] = supply_rates(p, places, m.act, m.act_dot, m.ctrl[i], all_demand, all_heat, h)
            continue
        length, line, moment = line_of_leg(m, place, rotation, i)
        v = dot(line, velocity) + dot(moment, omega)
        m.lengths[i] = m.tendon_lengths[i] = length
        m.velocities[i] = m.tendon_velocities[i] = v
        y = length - p[P.LENGTH_OFFSET]
        force = m.gains[i * N_GAIN] * m.act[last] + leg_bias(p, places, m.act, y, v, m.ctrl[i], t)
        demand, heat = leg_rates(p, places, m.act, m.act_dot, y, v, m.ctrl[i], t, h)
        m.from_legs[2 * i], m.from_legs[2 * i + 1], m.forces[i] = demand, heat, force
        all_demand += demand
        all_heat += heat
        f0, f1, f2 = f0 + force * line[0], f1 + force * line[1], f2 + force * line[2]
        m0, m1, m2 = m0 + force * moment[0], m1 + force * moment[1], m2 + force * moment[2]
    return (f0, f1, f2), (m0, m1, m2)


@compiled
def pushed(m, b, rotation, gravity, place):
    """Force and moment about the origin, in the platform's frame, of body b's weight and of what pushes it from outside."""
    carried = m.masses[b] * (1.0 - m.floats[b])
    push, spin = triple(m.outside, 6 * b), triple(m.outside, 6 * b + 3)
    force, moment = (carried * gravity[0], carried * gravity[1], carried * gravity[2]), (0.0, 0.0, 0.0)
    if dot(push, push) + dot(spin, spin) != 0.0:
        more, moment = rotated_back(rotation, push), rotated_back(rotation, spin)
        force = (force[0] + more[0], force[1] + more[1], force[2] + more[2])
    lever = cross(place, force)
    return force, (moment[0] + lever[0], moment[1] + lever[1], moment[2] + lever[2])


@compiled
def evaluate(m, h, t):
    """Derivatives of the present state at time t."""
    rotation, omega = rotation_of(four(m.qpos, 3)), triple(m.qvel, 3)
    force, moment = write_legs(m, h, t, rotation)
    f0, f1, f2 = rotated_back(rotation, force)
    m0, m1, m2 = rotated_back(rotation, moment)
    gravity = rotated_back(rotation, triple(m.gravity, 0))
    mass = s0 = s1 = s2 = ixx = iyy = izz = ixy = ixz = iyz = 0.0
    for b in range(m.n_bodies):
        if m.roots[b] != m.platform:
            continue
        x, y, z = triple(m.centres, 3 * b)
        if b != m.platform:
            x, y, z = x + m.places[3 * b], y + m.places[3 * b + 1], z + m.places[3 * b + 2]
        own, moments = m.masses[b], triple(m.inertias, 3 * b)
        xx, yy, zz, xy, xz, yz = turned_inertia(four(m.turns, 4 * b), moments[0], moments[1], moments[2])
        mass, s0, s1, s2 = mass + own, s0 + own * x, s1 + own * y, s2 + own * z
        ixx, iyy, izz = (
            ixx + xx + own * (y * y + z * z),
            iyy + yy + own * (x * x + z * z),
            izz + zz + own * (x * x + y * y),
        )
        ixy, ixz, iyz = ixy + xy - own * x * y, ixz + xz - own * x * z, iyz + yz - own * y * z
        more, lever = pushed(m, b, rotation, gravity, (x, y, z))
        f0, f1, f2 = f0 + more[0], f1 + more[1], f2 + more[2]
        m0, m1, m2 = m0 + lever[0], m1 + lever[1], m2 + lever[2]
    x, y, z = s0 / mass, s1 / mass, s2 / mass
    ixx, iyy, izz = ixx - mass * (y * y + z * z), iyy - mass * (x * x + z * z), izz - mass * (x * x + y * y)
    ixy, ixz, iyz = ixy + mass * x * y, ixz + mass * x * z, iyz + mass * y * z
    inertia, centre = ((ixx, ixy, ixz), (ixy, iyy, iyz), (ixz, iyz, izz)), (x, y, z)
    off, spun = cross(centre, (f0, f1, f2)), cross(omega, rotated(inertia, omega))
    turning = solved(inertia, (m0 - off[0] - spun[0], m1 - off[1] - spun[1], m2 - off[2] - spun[2]))
    a = centre_acceleration(centre, (-f0 / mass, -f1 / mass, -f2 / mass), turning, omega)
    a = rotated(rotation, (-a[0], -a[1], -a[2]))
    for k in range(3):
        m.qacc[k], m.qacc[3 + k] = a[k], turning[k]


@compiled
def step(m, h):
    """RK4 from an evaluated state, as mj_RungeKutta does it: it leaves the mean acceleration of the step, and of the states
    their rates in its last stage. `stepping.last_error` was set to that."""
    first, twists, accelerations, first_act, rates = room(), room(), room(), room(), room()
    place, q, t = triple(m.qpos, 0), four(m.qpos, 3), m.time[0]
    for k in range(N_TWIST):
        first[k], twists[k], accelerations[k] = m.qvel[k], m.qvel[k], m.qacc[k]
    for k in range(m.n_states):
        first_act[k], rates[k] = m.act[k], m.act_dot[k]
    for stage in range(1, 4):
        part, weight = (0.5 * h, 2.0) if stage < 3 else (h, 1.0)
        write_pose(m.qpos, place, q, triple(m.qvel, 0), triple(m.qvel, 3), part)
        for k in range(N_TWIST):
            m.qvel[k] = first[k] + part * m.qacc[k]
            twists[k] += weight * m.qvel[k]
        for k in range(m.n_states):
            m.act[k] = first_act[k] + part * m.act_dot[k]
        evaluate(m, h, t + part)
        for k in range(N_TWIST):
            accelerations[k] += weight * m.qacc[k]
        for k in range(m.n_states):
            rates[k] += weight * m.act_dot[k]
    sixth = h / 6.0
    write_pose(m.qpos, place, q, triple(twists, 0), triple(twists, 3), sixth)
    for k in range(N_TWIST):
        m.qvel[k] = first[k] + sixth * accelerations[k]
        m.qacc[k] = accelerations[k] / 6.0
    for k in range(m.n_states):
        m.act[k] = first_act[k] + sixth * rates[k]
    m.time[0] = t + h


@compiled
def write_pose(qpos, place, q, velocity, omega, h):
    """The pose that h seconds of a constant twist lead to from (place, q)."""
    turned = turned_by(q, omega, h)
    for k in range(3):
        qpos[k] = place[k] + h * velocity[k]
    for k in range(4):
        qpos[3 + k] = turned[k]


MODEL = (
    "nbody",
    "na",
    "nactuator",
    "jnt_bodyid",
    "body_rootid",
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_iquat",
    "body_pos",
    "body_gravcomp",
    "site_pos",
    "tendon_adr",
    "wrap_objid",
    "actuator_user",
    "actuator_gainprm",
)
DATA = (
    "qpos",
    "qvel",
    "act",
    "ctrl",
    "xfrc_applied",
    "qacc",
    "act_dot",
    "userdata",
    "actuator_length",
    "actuator_velocity",
    "actuator_force",
    "ten_length",
    "ten_velocity",
    "xpos",
    "xquat",
    "xmat",
    "xipos",
)


@cache
def native_platform() -> Any:
    """void f(mjModel*, mjData*, int what): lengths of the legs, an evaluation, or a step of RK4 from an evaluated state."""
    of_model, of_data = (
        tuple(slot(struct, name) for name in names) for struct, names in (("mjModel", MODEL), ("mjData", DATA))
    )
    time, options = slot("mjData", "time"), slot("mjModel", "opt")
    timestep, gravity = (options + slot("mjOption", name) for name in ("timestep", "gravity"))

    @compiled_callback(types.void(types.voidptr, types.voidptr, types.int32))
    def platform(model, data, what):
        fields, words = carray(model, (WORDS,), types.uintp), carray(data, (WORDS,), types.uintp)
        i, k = of_model, of_data
        m = Memory(
            np.intp(fields[i[0]]),
            np.intp(fields[i[1]]),
            np.intp(fields[i[2]]),
            np.intp(integers(fields[i[3]])[0]),
            integers(fields[i[4]]),
            doubles(fields[i[5]]),
            doubles(fields[i[6]]),
            doubles(fields[i[7]]),
            doubles(fields[i[8]]),
            doubles(fields[i[9]]),
            doubles(fields[i[10]]),
            doubles(fields[i[11]]),
            integers(fields[i[12]]),
            integers(fields[i[13]]),
            doubles(fields[i[14]]),
            doubles(fields[i[15]]),
            doubles_in(fields, gravity),
            doubles(words[k[0]]),
            doubles(words[k[1]]),
            doubles(words[k[2]]),
            doubles(words[k[3]]),
            doubles(words[k[4]]),
            doubles(words[k[5]]),
            doubles(words[k[6]]),
            doubles(words[k[7]]),
            doubles(words[k[8]]),
            doubles(words[k[9]]),
            doubles(words[k[10]]),
            doubles(words[k[11]]),
            doubles(words[k[12]]),
            doubles(words[k[13]]),
            doubles(words[k[14]]),
            doubles(words[k[15]]),
            doubles(words[k[16]]),
            doubles_in(words, time),
        )
        h = doubles_in(fields, timestep)[0]
        if what == What.LENGTHS:
            write_place(m)
        elif what == What.EVALUATE:
            evaluate(m, h, m.time[0])
        else:
            step(m, h)

    return platform
