"""The geometry of the legs, compiled: rotation, leg lengths, Jacobian, and Newton for the pose.

Each equation stands here once; `hexsim.mechanics.mechanics` says what frames, pose and legs are, and is what to call. Arguments
common to all: pose (6,) or poses (n, 6), base and platform joints (n_legs, 3) [m], height = neutral height [m].
"""

import numpy as np

from hexsim.compiled import allocating, compiled


@compiled
def write_rotation(pose, rotation):
    """R = Rz(yaw) Ry(pitch) Rx(roll), platform to world."""
    cr, sr = np.cos(pose[3]), np.sin(pose[3])
    cp, sp = np.cos(pose[4]), np.sin(pose[4])
    cy, sy = np.cos(pose[5]), np.sin(pose[5])
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = -sp, cp * sr, cp * cr


@compiled
def write_rate_matrix(pose, rates):
    """E of omega_world = E (roll', pitch', yaw'): its columns are the three axes Rz Ry e_x, Rz e_y, e_z."""
    cp, sp = np.cos(pose[4]), np.sin(pose[4])
    cy, sy = np.cos(pose[5]), np.sin(pose[5])
    rates[0, 0], rates[0, 1], rates[0, 2] = cy * cp, -sy, 0.0
    rates[1, 0], rates[1, 1], rates[1, 2] = sy * cp, cy, 0.0
    rates[2, 0], rates[2, 1], rates[2, 2] = -sp, 0.0, 1.0


@compiled
def leg_line(place, rotation, base, joint):
    """Length of a leg, its direction u, and the moment r x u of its line about the origin.

    place: of the platform's origin above the base [m]; rotation: three rows; base, joint: the leg's ends [m].
    """
    r, s, t = rotation
    rx = r[0] * joint[0] + r[1] * joint[1] + r[2] * joint[2]
    ry = s[0] * joint[0] + s[1] * joint[1] + s[2] * joint[2]
    rz = t[0] * joint[0] + t[1] * joint[1] + t[2] * joint[2]
    sx, sy, sz = place[0] + rx - base[0], place[1] + ry - base[1], place[2] + rz - base[2]
    length = np.sqrt(sx * sx + sy * sy + sz * sz)
    ux, uy, uz = sx / length, sy / length, sz / length
    return length, (ux, uy, uz), (ry * uz - rz * uy, rz * ux - rx * uz, rx * uy - ry * ux)


@compiled
def write_legs(pose, rotation, base, platform, height, lengths, jacobian):
    """Leg lengths, and rows (u_i, r_i x u_i) with r_i = R b_i, for a pose whose rotation is given."""
    place, rows = (pose[0], pose[1], pose[2] + height), (row3(rotation, 0), row3(rotation, 1), row3(rotation, 2))
    for i in range(base.shape[0]):
        lengths[i], u, moment = leg_line(place, rows, row3(base, i), row3(platform, i))
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = u
        jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = moment


@compiled
def row3(matrix, i):
    """Row of a matrix (n, 3) as a vector."""
    return matrix[i, 0], matrix[i, 1], matrix[i, 2]


@allocating
def lengths_of_rows(poses, base, platform, height):
    n = poses.shape[0]
    legs = base.shape[0]
    lengths, rotation, jacobian = np.empty((n, legs)), np.empty((3, 3)), np.empty((legs, 6))
    for k in range(n):
        write_rotation(poses[k], rotation)
        write_legs(poses[k], rotation, base, platform, height, lengths[k], jacobian)
    return lengths


@allocating
def frames_of_rows(poses):
    rotations, rates = np.empty((poses.shape[0], 3, 3)), np.empty((poses.shape[0], 3, 3))
    for k in range(poses.shape[0]):
        write_rotation(poses[k], rotations[k])
        write_rate_matrix(poses[k], rates[k])
    return rotations, rates


@allocating
def all_of_rows(poses, base, platform, height):
    n = poses.shape[0]
    lengths, jacobian = np.empty((n, base.shape[0])), np.empty((n, base.shape[0], 6))
    rotation = np.empty((n, 3, 3))
    for k in range(n):
        write_rotation(poses[k], rotation[k])
        write_legs(poses[k], rotation[k], base, platform, height, lengths[k], jacobian[k])
    return lengths, jacobian, rotation


@compiled
def to_pose_coordinates(jacobian, rates):
    """Columns 3 to 5 from angular velocity to roll-pitch-yaw rates, in place: J_w -> J_w E."""
    for i in range(6):
        jx, jy, jz = jacobian[i, 3], jacobian[i, 4], jacobian[i, 5]
        for c in range(3):
            jacobian[i, 3 + c] = jx * rates[0, c] + jy * rates[1, c] + jz * rates[2, c]


@compiled
def solve(matrix, right):
    """Gaussian elimination with row pivoting, in place; the solution stands in `right`. False if singular."""
    n = right.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if not abs(matrix[pivot, k]) > 1e-14:  # also true for NaN; entries are of order 0.1 to 1
            return False
        if pivot != k:
            for j in range(n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k, n):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return True


@allocating
def forward_rows(lengths, poses, base, platform, height, max_iterations, tolerance):
    """Newton on l(pose) = lengths, row by row from the guesses in `poses`, in place; returns the rows' residuals [m].

    A step that does not lower the largest residual is halved (up to 10 times), so a far guess cannot run away.
    """
    n = lengths.shape[0]
    residuals = np.empty(n)
    now, trial, step = np.empty(6), np.empty(6), np.empty(6)
    rotation, rates, jacobian = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 6))
    for k in range(n):
        pose = poses[k]
        write_rotation(pose, rotation)
        write_legs(pose, rotation, base, platform, height, now, jacobian)
        worst = np.max(np.abs(lengths[k] - now))
        for _ in range(max_iterations):
            if not worst > tolerance:
                break
            write_rate_matrix(pose, rates)
            to_pose_coordinates(jacobian, rates)
            step[:] = lengths[k] - now
            if not solve(jacobian, step):
                break
            scale, lowered = 1.0, False
            for _ in range(10):
                trial[:] = pose + scale * step
                write_rotation(trial, rotation)
                write_legs(trial, rotation, base, platform, height, now, jacobian)
                trial_worst = np.max(np.abs(lengths[k] - now))
                if trial_worst < worst:
                    lowered = True
                    break
                scale *= 0.5
            if not lowered:  # rounding error reached, or stuck: the residual tells which
                break
            pose[:] = trial
            worst = trial_worst
        residuals[k] = worst
    return residuals
