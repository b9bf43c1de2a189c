"""Kinematics of a six-legged motion system: poses, leg lengths, their rates, and where the legs end.

Frames
    World: origin at the centre of the base joints, z up, x forward (surge), y left (sway).
    Platform: origin at the centre of the platform joints, axes along the world's in the neutral pose.
Pose
    (x, y, z, roll, pitch, yaw) [m, rad], RELATIVE TO NEUTRAL: all zero is the platform level at the neutral
    height h0. Rotation from platform to world: R = Rz(yaw) Ry(pitch) Rx(roll).
Legs
    Numbered 1 to 6 in messages and logs, index 0 to 5 in arrays. Leg vector, from base joint a_i to platform joint b_i:
    s_i = (x, y, z + h0) + R b_i - a_i,  length l_i = |s_i|,  direction u_i = s_i / l_i.
    Piston position = length - retracted length, 0 at full retraction, stroke at full extension.

Every method takes poses of shape (..., 6) and returns results with the same leading axes.

Limits: joints are ideal points; cylinders and rods are not checked against collision, joints not against their angle.
The roll-pitch-yaw angles are singular at a pitch of +-90 deg, far outside what a hexapod reaches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError
from hexsim.mechanics.checks import N_LEGS, as_rows, check_reach
from hexsim.mechanics.leg_geometry import all_of_rows, forward_rows, lengths_of_rows

DOF_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
NEWTON_MAX_ITERATIONS = 50  # quadratic convergence needs 4 to 6; more only where steps are shortened
NEWTON_TOLERANCE_M = 1e-13  # residual length at which the iteration stops: 1e-13 m, about 450 ulp of a 1 m leg

Array = NDArray[np.float64]


def pair_joints(radius_m: float, angles_deg: ArrayLike) -> Array:
    """Six joints (6, 3) on a horizontal circle: two angles (legs 1 and 2) [deg], repeated at +120 and +240 deg."""
    angles = np.radians(np.add.outer([0.0, 120.0, 240.0], np.asarray(angles_deg, dtype=float)).ravel())
    return radius_m * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class HexapodKinematics:
    """Joints, legs and neutral height of a hexapod; see the module for frames, pose and leg numbers.

    base_joints: (6, 3) [m], in the world frame.  platform_joints: (6, 3) [m], in the platform frame.
    retracted_length_m: joint to joint with the piston at 0, one number or (6,); kept as (6,).
    stroke_m: travel of each piston.  neutral_height_m: h0, platform frame above the world frame in the neutral pose.
    """

    dofs: ClassVar[tuple[str, ...]] = DOF_NAMES
    moving_body: ClassVar[str] = "platform"  # its name in the MuJoCo model
    base_joints: Array
    platform_joints: Array
    retracted_length_m: float | Array
    stroke_m: float
    neutral_height_m: float

    def __post_init__(self) -> None:
        for name in ("base_joints", "platform_joints"):
            joints = np.array(getattr(self, name), dtype=np.float64, order="C")
            if joints.shape != (N_LEGS, 3) or not np.all(np.isfinite(joints)):
                raise HexsimError(f"{name} has shape {joints.shape}; it needs six finite joints, shape (6, 3) [m].")
            joints.flags.writeable = False
            object.__setattr__(self, name, joints)
        retracted = np.asarray(self.retracted_length_m, dtype=np.float64)
        if retracted.shape not in ((), (N_LEGS,)) or not np.all(np.isfinite(retracted)) or np.any(retracted <= 0.0):
            raise HexsimError(f"retracted_length_m is {self.retracted_length_m}; give one length > 0 m, or six.")
        retracted = np.array(np.broadcast_to(retracted, (N_LEGS,)))
        retracted.flags.writeable = False
        object.__setattr__(self, "retracted_length_m", retracted)
        if not (np.isfinite(self.stroke_m) and self.stroke_m > 0.0):
            raise HexsimError(f"stroke_m is {self.stroke_m}; the pistons need a stroke > 0 m.")
        if not np.isfinite(self.neutral_height_m):
            raise HexsimError(f"neutral_height_m is {self.neutral_height_m}; give a height in m.")
        self.inverse(np.zeros(6))

    @classmethod
    def from_geometry(
        cls,
        base_radius_m: float,
        base_half_angle_deg: float,
        platform_radius_m: float,
        platform_half_angle_deg: float,
        neutral_leg_length_m: float,
        stroke_m: float,
    ) -> HexapodKinematics:
        """Joints in pairs on two circles; in the neutral pose all legs are alike and all pistons at half stroke.

        Legs 1, 2 at base angles +half, -half and platform angles 60 - half, -60 + half [deg]; legs 3, 4 and 5, 6 the
        same turned by 120 and 240 deg. Raises HexsimError if the neutral leg cannot span the circles, or if it is
        shorter than half its stroke.
        """
        base = pair_joints(base_radius_m, [base_half_angle_deg, -base_half_angle_deg])
        platform = pair_joints(platform_radius_m, [60.0 - platform_half_angle_deg, platform_half_angle_deg - 60.0])
        across = float(np.linalg.norm(platform[0] - base[0]))
        if not neutral_leg_length_m > across:
            raise HexsimError(
                f"neutral_leg_length_m is {neutral_leg_length_m}, but the joints of leg 1 are {across:.4f} m apart in "
                f"plan; make it longer than that, or bring the joints closer."
            )
        return cls(
            base_joints=base,
            platform_joints=platform,
            retracted_length_m=neutral_leg_length_m - 0.5 * stroke_m,
            stroke_m=stroke_m,
            neutral_height_m=float(np.sqrt(neutral_leg_length_m**2 - across**2)),
        )

    def leg_lengths(self, pose: ArrayLike) -> Array:
        """Joint-to-joint lengths (..., 6) [m]; no check of limits."""
        rows, lead = as_rows(pose, "pose")
        lengths = lengths_of_rows(rows, self.base_joints, self.platform_joints, self.neutral_height_m)
        return lengths.reshape(*lead, N_LEGS)

    def piston_positions(self, pose: ArrayLike) -> Array:
        """Piston positions (..., 6) [m], 0 at full retraction; no check of limits."""
        return self.leg_lengths(pose) - self.retracted_length_m

    def inverse(self, pose: ArrayLike) -> Array:
        """Piston positions (..., 6) [m]; HexsimError naming leg, length and limits if a pose is out of reach."""
        positions = self.piston_positions(pose)
        self._check_reach(positions, lambda _: "The pose is out of reach")
        return positions

    def check_trajectory(self, time_s: ArrayLike, poses: ArrayLike, margin_m: float = 0.0) -> None:
        """HexsimError naming time, leg, length and limits of the first sample out of the workspace.

        time_s (n,), poses (n, 6); margin_m is kept free at both ends of each stroke. A trajectory whose legs all fit
        but that passes a singular pose (the sign of det J changes, the legs cannot hold the platform) is refused too.
        """
        self.check_piston_positions(time_s, self.piston_positions(poses), margin_m)
        same_branch = self.on_neutral_branch(poses)
        if not np.all(same_branch):
            when = float(np.asarray(time_s)[int(np.argmin(same_branch))])
            raise HexsimError(
                f"The trajectory passes a singular pose before t = {when:.4f} s, where the legs cannot hold the "
                f"platform; make the motion smaller."
            )

    def check_piston_positions(self, time_s: ArrayLike, positions: ArrayLike, margin_m: float = 0.0) -> None:
        """`check_trajectory` for piston setpoints (n, 6) [m], as in actuator mode."""
        times = np.asarray(time_s, dtype=np.float64)
        leaves = "The trajectory leaves the workspace"
        self._check_reach(positions, lambda row: f"{leaves} at t = {times[row]:.4f} s", margin_m)

    def _check_reach(self, positions: ArrayLike, where: Callable[[int], str], margin_m: float = 0.0) -> None:
        check_reach(positions, np.asarray(self.retracted_length_m), self.stroke_m, where, margin_m)

    def forward(self, piston_positions: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Pose (..., 6) with these piston positions, by Newton from `guess` (pose(s), default neutral).

        Of the up to 40 poses with the same lengths it returns the one connected with the guess, as a rule. Raises
        HexsimError naming the row and the residual where no pose is found. Rounding limits the result to about
        1e-13 m times the condition number of the Jacobian.
        """
        positions, lead = as_rows(piston_positions, "piston positions")
        lengths = positions + self.retracted_length_m
        start = np.zeros(N_LEGS) if guess is None else np.asarray(guess, dtype=np.float64)
        poses = np.array(np.broadcast_to(start, (*lead, N_LEGS)), dtype=np.float64, order="C").reshape(-1, N_LEGS)
        residuals = forward_rows(
            lengths,
            poses,
            self.base_joints,
            self.platform_joints,
            self.neutral_height_m,
            NEWTON_MAX_ITERATIONS,
            NEWTON_TOLERANCE_M,
        )
        found = residuals <= 100.0 * NEWTON_TOLERANCE_M
        if not found.all():
            row = int(np.argmin(found))
            raise HexsimError(
                f"No pose found for piston positions {np.array2string(positions[row], precision=4)} m (row {row}, "
                f"residual {residuals[row]:.2e} m); check that they belong to one pose, or give a closer guess."
            )
        return poses.reshape(*lead, N_LEGS)

    def _all(self, pose: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Lengths (..., 6), twist Jacobian (..., 6, 6), rotation (..., 3, 3), rate matrix (..., 3, 3)."""
        rows, lead = as_rows(pose, "pose")
        results = all_of_rows(rows, self.base_joints, self.platform_joints, self.neutral_height_m)
        return tuple(result.reshape(*lead, *result.shape[1:]) for result in results)  # pyright: ignore

    def rotation(self, pose: ArrayLike) -> Array:
        """R (..., 3, 3): a vector in the platform frame times R is the vector in the world frame."""
        return self._all(pose)[2]

    def jacobian(self, pose: ArrayLike) -> Array:
        """J (..., 6, 6) of l' = J (v, omega): v of the platform origin, omega, both in the world frame. [1, m]"""
        return self._all(pose)[1]

    def pose_jacobian(self, pose: ArrayLike) -> Array:
        """d length / d (x, y, z, roll, pitch, yaw), (..., 6, 6) [1, m]."""
        _, jacobian, _, rates = self._all(pose)
        return np.concatenate([jacobian[..., :3], jacobian[..., 3:] @ rates], axis=-1)

    def condition_number(self, pose: ArrayLike, characteristic_length_m: float | None = None) -> Array:
        """Ratio of largest to smallest singular value of (J_v, J_omega / L), (...); 1 is isotropic, inf singular.

        L makes metres and radians comparable; default the rms distance of the platform joints from their centre,
        so a rotation counts as the travel it gives the joints.
        """
        length = characteristic_length_m
        if length is None:
            length = float(np.sqrt(np.mean(np.sum(self.platform_joints**2, axis=-1))))
        return np.linalg.cond(self.jacobian(pose) / np.array([1.0, 1.0, 1.0, length, length, length]))

    def static_leg_forces(self, pose: ArrayLike, wrench: ArrayLike) -> Array:
        """Thrusts f (..., 6) [N] with J^T f = wrench; positive pushes base and platform apart.

        wrench (..., 6) [N, N m]: force and moment about the platform origin, world frame, that the legs together
        exert on the platform. To carry a mass m with its centre at the origin: (0, 0, m g, 0, 0, 0).
        Massless legs, no joint friction.
        """
        transposed = np.swapaxes(self.jacobian(pose), -1, -2)
        forces = np.linalg.solve(transposed, np.asarray(wrench, dtype=np.float64)[..., None])
        return np.asarray(forces[..., 0], dtype=np.float64)

    def twist(self, pose: ArrayLike, pose_rate: ArrayLike) -> Array:
        """(v, omega) (..., 6) in the world frame [m/s, rad/s] from the rates of the pose coordinates."""
        rate = np.asarray(pose_rate, dtype=np.float64)
        rates = self._all(pose)[3]
        return np.concatenate([rate[..., :3], _times(rates, rate[..., 3:])], axis=-1)

    def twist_rate(self, pose: ArrayLike, pose_rate: ArrayLike, pose_acceleration: ArrayLike) -> Array:
        """(v', omega') (..., 6) in the world frame [m/s2, rad/s2]: omega' = E q'' + E' q'.

        E' turns with the axes: the roll axis E_1 with yaw' e_z + pitch' E_2, the pitch axis E_2 with yaw' e_z.
        """
        rate = np.asarray(pose_rate, dtype=np.float64)
        acceleration = np.asarray(pose_acceleration, dtype=np.float64)
        rates = self._all(pose)[3]
        roll_axis, pitch_axis, yaw_axis = rates[..., 0], rates[..., 1], rates[..., 2]
        roll, pitch, yaw = rate[..., 3:4], rate[..., 4:5], rate[..., 5:6]
        turning = roll * np.cross(yaw * yaw_axis + pitch * pitch_axis, roll_axis)
        turning = turning + pitch * np.cross(yaw * yaw_axis, pitch_axis)
        return np.concatenate([acceleration[..., :3], _times(rates, acceleration[..., 3:]) + turning], axis=-1)

    def leg_velocities(self, pose: ArrayLike, twist: ArrayLike) -> Array:
        """l' (..., 6) [m/s] = J twist: the pistons' velocities; twist = (v, omega), world frame."""
        return _times(self.jacobian(pose), np.asarray(twist, dtype=np.float64))

    def joint_axial_accelerations(self, pose: ArrayLike, twist: ArrayLike, twist_rate: ArrayLike) -> Array:
        """u_i . p_i'' (..., 6) [m/s2]: the platform joint's acceleration in the world, along its leg.

        p_i'' = v' + omega' x r_i + omega x (omega x r_i). This is the acceleration of a mass that rides on the
        platform end of the leg; the piston's own in its cylinder is `leg_accelerations`. Gravity is not in it.
        """
        _, jacobian, rotation, _ = self._all(pose)
        omega = np.asarray(twist, dtype=np.float64)[..., None, 3:]
        arms = np.einsum("...ab,ib->...ia", rotation, self.platform_joints)
        centripetal = np.cross(omega, np.cross(omega, arms))
        along = np.einsum("...ia,...ia->...i", jacobian[..., :3], centripetal)
        return _times(jacobian, np.asarray(twist_rate, dtype=np.float64)) + along

    def leg_accelerations(self, pose: ArrayLike, twist: ArrayLike, twist_rate: ArrayLike) -> Array:
        """l'' (..., 6) [m/s2]: the pistons' accelerations in their cylinders.

        l'' = u . p'' + (|p'|^2 - l'^2) / l: the second term is the swing of the leg about its base joint.
        """
        lengths, jacobian, rotation, _ = self._all(pose)
        twist = np.asarray(twist, dtype=np.float64)
        arms = np.einsum("...ab,ib->...ia", rotation, self.platform_joints)
        joint_velocity = twist[..., None, :3] + np.cross(twist[..., None, 3:], arms)
        swing = (np.sum(joint_velocity**2, axis=-1) - _times(jacobian, twist) ** 2) / lengths
        return self.joint_axial_accelerations(pose, twist, twist_rate) + swing

    def from_platform_frame(self, pose: ArrayLike, motion: ArrayLike) -> Array:
        """A pair of vectors (..., 6) from the platform frame to the world frame: twists, measured accelerations.

        (a, alpha) of a log (`acceleration_*_m_s2` at the centre of the platform joints with gravity removed,
        `angular_acceleration_*_rad_s2`) become the `twist_rate` of the leg accelerations above.
        """
        rotation = self.rotation(pose)
        motion = np.asarray(motion, dtype=np.float64)
        return np.concatenate([_times(rotation, motion[..., :3]), _times(rotation, motion[..., 3:])], axis=-1)

    def to_platform_frame(self, pose: ArrayLike, motion: ArrayLike) -> Array:
        """The inverse of `from_platform_frame`."""
        back = np.swapaxes(self.rotation(pose), -1, -2)
        motion = np.asarray(motion, dtype=np.float64)
        return np.concatenate([_times(back, motion[..., :3]), _times(back, motion[..., 3:])], axis=-1)

    def on_neutral_branch(self, poses: ArrayLike) -> NDArray[np.bool_]:
        """Whether det J has the sign it has in the neutral pose, (...) bool: no singularity between, as a rule."""
        return np.linalg.det(self.jacobian(poses)) * np.linalg.det(self.jacobian(np.zeros(N_LEGS))) > 0.0


def _times(matrix: Array, vector: Array) -> Array:
    """Matrix (..., a, b) times vector (..., b)."""
    return np.einsum("...ab,...b->...a", matrix, vector)
