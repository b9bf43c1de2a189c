"""The mechanics of a machine: legs between base and moving body, poses, leg lengths and their rates. One leg or six.

Frames
    World: origin at the centre of the base joints, z up, x forward (surge), y left (sway).
    Platform: origin at the centre of the platform joints, axes along the world's in the neutral pose.
Pose
    (x, y, z, roll, pitch, yaw) [m, rad], RELATIVE TO NEUTRAL: all zero is the platform level at the neutral
    height h0. Rotation from platform to world: R = Rz(yaw) Ry(pitch) Rx(roll).
Legs
    Numbered 1 to n in messages and logs, index 0 to n - 1 in arrays. Leg vector, from base joint a_i to platform joint
    b_i: s_i = (x, y, z + h0) + R b_i - a_i,  length l_i = |s_i|,  direction u_i = s_i / l_i.
    Piston position = length - retracted length, 0 at full retraction, stroke at full extension.

Every method takes poses of shape (..., 6) and returns results with the same leading axes.

Limits: joints are ideal points; cylinders and rods are not checked against collision, joints not against their angle.
The roll-pitch-yaw angles are singular at a pitch of +-90 deg, far outside what a hexapod reaches.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError
from hexsim.mechanics.checks import as_rows, check_reach
from hexsim.mechanics.leg_geometry import all_of_rows, frames_of_rows, lengths_of_rows

DOF_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
ROUNDING_m = 1e-12  # of lengths of metres: below it a difference is none

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Mechanics(ABC):
    """Joints, legs and neutral height; see the module for frames, pose and leg numbers.

    n_legs.  dofs: coordinates of the pose that it has.  axes: what its motion is called in logs and figures.
    moving_body: its name in the MuJoCo model.
    base_joints: (n, 3) [m], in the world frame.  platform_joints: (n, 3) [m], in the platform frame.
    retracted_length_m: joint to joint with the piston at 0, one number or (n,); kept as (n,).
    stroke_m: travel of each piston, one number or (n,); kept as (n,).
    neutral_height_m: h0, platform frame above the world frame in the neutral pose.
    """

    n_legs: ClassVar[int]
    dofs: ClassVar[tuple[str, ...]]
    axes: ClassVar[tuple[str, ...]]
    moving_body: ClassVar[str]
    base_joints: Array
    platform_joints: Array
    retracted_length_m: float | Array
    stroke_m: float | Array
    neutral_height_m: float

    def __post_init__(self) -> None:
        n = self.n_legs
        for name in ("base_joints", "platform_joints"):
            joints = np.array(getattr(self, name), dtype=np.float64, order="C")
            if joints.shape != (n, 3) or not np.all(np.isfinite(joints)):
                raise HexsimError(f"{name} has shape {joints.shape}; it needs {n} finite joints, shape ({n}, 3) [m].")
            self._keep(name, joints)
        for name, must in (("retracted_length_m", "give one"), ("stroke_m", "the pistons need a stroke: one")):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            if given.shape not in ((), (n,)) or not np.all(np.isfinite(given)) or np.any(given <= 0.0):
                raise HexsimError(f"{name} is {getattr(self, name)}; {must} length > 0 m, or {n}.")
            self._keep(name, np.array(np.broadcast_to(given, (n,))))
        if not np.isfinite(self.neutral_height_m):
            raise HexsimError(f"neutral_height_m is {self.neutral_height_m}; give a height in m.")
        self.inverse(np.zeros(6))

    def _keep(self, name: str, values: Array) -> None:
        values.flags.writeable = False
        object.__setattr__(self, name, values)

    @property
    def has_platform(self) -> bool:
        """Whether six legs carry a platform; else one leg carries a mass."""
        return self.n_legs > 1

    @property
    def neutral_positions(self) -> Array:
        """Piston positions (n,) [m] in the neutral pose; half stroke to the bit where that is meant."""
        positions, half = self.piston_positions(np.zeros(6)), 0.5 * np.asarray(self.stroke_m)
        return np.where(np.abs(positions - half) < ROUNDING_m, half, positions)

    @property
    def dof_places(self) -> list[int]:
        """Where its degrees of freedom stand in a pose."""
        return [DOF_NAMES.index(dof) for dof in self.dofs]

    @property
    def radius_m(self) -> float:
        """How far the base reaches; of a bench twice its stroke."""
        reach = float(np.hypot(self.base_joints[:, 0], self.base_joints[:, 1]).max())
        return reach or 2.0 * float(np.max(self.stroke_m))

    @property
    def longest_leg_m(self) -> float:
        """In the neutral pose."""
        return float(self.leg_lengths(np.zeros(6)).max())

    @abstractmethod
    def forward(self, piston_positions: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Pose (..., 6) with these piston positions (..., n)."""

    def leg_lengths(self, pose: ArrayLike) -> Array:
        """Joint-to-joint lengths (..., n) [m]; no check of limits."""
        rows, lead = as_rows(pose, "pose", 6)
        lengths = lengths_of_rows(rows, self.base_joints, self.platform_joints, self.neutral_height_m)
        return lengths.reshape(*lead, self.n_legs)

    def piston_positions(self, pose: ArrayLike) -> Array:
        """Piston positions (..., n) [m], 0 at full retraction; no check of limits."""
        return self.leg_lengths(pose) - self.retracted_length_m

    def inverse(self, pose: ArrayLike) -> Array:
        """Piston positions (..., n) [m]; HexsimError naming leg, length and limits if a pose is out of reach."""
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
        """`check_trajectory` for piston setpoints (m, n) [m], as in actuator mode."""
        times = np.asarray(time_s, dtype=np.float64)
        leaves = "The trajectory leaves the workspace"
        self._check_reach(positions, lambda row: f"{leaves} at t = {times[row]:.4f} s", margin_m)

    def _check_reach(self, positions: ArrayLike, where: Callable[[int], str], margin_m: float = 0.0) -> None:
        check_reach(positions, np.asarray(self.retracted_length_m), np.asarray(self.stroke_m), where, margin_m)

    def on_neutral_branch(self, poses: ArrayLike) -> NDArray[np.bool_]:
        """Whether no singular pose lies between a pose and neutral, (...) bool."""
        return np.ones(np.shape(poses)[:-1], dtype=bool)

    def _all(self, pose: ArrayLike) -> tuple[Array, Array, Array]:
        """Lengths (..., n), twist Jacobian (..., n, 6), rotation (..., 3, 3)."""
        rows, lead = as_rows(pose, "pose", 6)
        results = all_of_rows(rows, self.base_joints, self.platform_joints, self.neutral_height_m)
        return tuple(result.reshape(*lead, *result.shape[1:]) for result in results)  # pyright: ignore

    def rotation(self, pose: ArrayLike) -> Array:
        """R (..., 3, 3): a vector in the platform frame times R is the vector in the world frame."""
        return self._frames(pose)[0]

    def _frames(self, pose: ArrayLike) -> tuple[Array, Array]:
        """Rotation and rate matrix (..., 3, 3)."""
        rows, lead = as_rows(pose, "pose", 6)
        rotation, rates = frames_of_rows(rows)
        return rotation.reshape(*lead, 3, 3), rates.reshape(*lead, 3, 3)

    def jacobian(self, pose: ArrayLike) -> Array:
        """J (..., n, 6) of l' = J (v, omega): v of the platform origin, omega, both in the world frame. [1, m]"""
        return self._all(pose)[1]

    def twist(self, pose: ArrayLike, pose_rate: ArrayLike) -> Array:
        """(v, omega) (..., 6) in the world frame [m/s, rad/s] from the rates of the pose coordinates."""
        rate = np.asarray(pose_rate, dtype=np.float64)
        return np.concatenate([rate[..., :3], _times(self._frames(pose)[1], rate[..., 3:])], axis=-1)

    def twist_rate(self, pose: ArrayLike, pose_rate: ArrayLike, pose_acceleration: ArrayLike) -> Array:
        """(v', omega') (..., 6) in the world frame [m/s2, rad/s2]: omega' = E q'' + E' q'.

        E' turns with the axes: the roll axis E_1 with yaw' e_z + pitch' E_2, the pitch axis E_2 with yaw' e_z.
        """
        rate = np.asarray(pose_rate, dtype=np.float64)
        acceleration = np.asarray(pose_acceleration, dtype=np.float64)
        rates = self._frames(pose)[1]
        roll_axis, pitch_axis, yaw_axis = rates[..., 0], rates[..., 1], rates[..., 2]
        roll, pitch, yaw = rate[..., 3:4], rate[..., 4:5], rate[..., 5:6]
        turning = roll * np.cross(yaw * yaw_axis + pitch * pitch_axis, roll_axis)
        turning = turning + pitch * np.cross(yaw * yaw_axis, pitch_axis)
        return np.concatenate([acceleration[..., :3], _times(rates, acceleration[..., 3:]) + turning], axis=-1)

    def leg_velocities(self, pose: ArrayLike, twist: ArrayLike) -> Array:
        """l' (..., n) [m/s] = J twist: the pistons' velocities; twist = (v, omega), world frame."""
        return _times(self.jacobian(pose), np.asarray(twist, dtype=np.float64))

    def joint_axial_accelerations(self, pose: ArrayLike, twist: ArrayLike, twist_rate: ArrayLike) -> Array:
        """u_i . p_i'' (..., n) [m/s2]: the platform joint's acceleration in the world, along its leg.

        p_i'' = v' + omega' x r_i + omega x (omega x r_i). This is the acceleration of a mass that rides on the
        platform end of the leg; the piston's own in its cylinder is `leg_accelerations`. Gravity is not in it.
        """
        _, jacobian, rotation = self._all(pose)
        omega = np.asarray(twist, dtype=np.float64)[..., None, 3:]
        arms = np.einsum("...ab,ib->...ia", rotation, self.platform_joints)
        centripetal = np.cross(omega, np.cross(omega, arms))
        along = np.einsum("...ia,...ia->...i", jacobian[..., :3], centripetal)
        return _times(jacobian, np.asarray(twist_rate, dtype=np.float64)) + along

    def leg_accelerations(self, pose: ArrayLike, twist: ArrayLike, twist_rate: ArrayLike) -> Array:
        """l'' (..., n) [m/s2]: the pistons' accelerations in their cylinders.

        l'' = u . p'' + (|p'|^2 - l'^2) / l: the second term is the swing of the leg about its base joint.
        """
        lengths, jacobian, rotation = self._all(pose)
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


def _times(matrix: Array, vector: Array) -> Array:
    """Matrix (..., a, b) times vector (..., b)."""
    return np.einsum("...ab,...b->...a", matrix, vector)
