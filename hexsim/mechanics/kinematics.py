"""Kinematics of a hexapod: joints on two circles, the pose of given leg lengths, forces and singularities.

Frames, pose and legs: `hexsim.mechanics.mechanics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError
from hexsim.mechanics.checks import as_rows
from hexsim.mechanics.leg_geometry import forward_rows
from hexsim.mechanics.mechanics import DOF_NAMES, Mechanics

NEWTON_MAX_ITERATIONS = 50  # quadratic convergence needs 4 to 6; more only where steps are shortened

N_LEGS = len(DOF_NAMES)  # of a hexapod: one a degree of freedom
Array = NDArray[np.float64]


def pair_joints(radius_m: float, angles_deg: ArrayLike) -> Array:
    """Six joints (6, 3) on a horizontal circle: two angles (legs 1 and 2) [deg], repeated at +120 and +240 deg."""
    angles = np.radians(np.add.outer([0.0, 120.0, 240.0], np.asarray(angles_deg, dtype=float)).ravel())
    return radius_m * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def joints_on_circles(
    base_radius_m: float, base_half_angle_deg: float, platform_radius_m: float, platform_half_angle_deg: float
) -> tuple[Array, Array]:
    """Base and platform joints (6, 3) [m] in pairs.

    Legs 1, 2 at base angles +half, -half and platform angles 60 - half, -60 + half [deg]; legs 3, 4 and 5, 6 the
    same turned by 120 and 240 deg.
    """
    base = pair_joints(base_radius_m, [base_half_angle_deg, -base_half_angle_deg])
    platform = pair_joints(platform_radius_m, [60.0 - platform_half_angle_deg, platform_half_angle_deg - 60.0])
    return base, platform


def neutral_height(
    base: Array,
    platform: Array,
    mean_length_m: float,
    *,
    tolerance_m: float = 1e-14,  # of a leg of a metre: its rounding
) -> float:
    """h at which the legs from base to platform joints (6, 3) are `mean_length_m` long in the mean: from leg 1, then Newton."""
    level = (platform - base) * [1.0, 1.0, 0.0]
    across = [float(np.linalg.norm(arm)) for arm in level]
    rise = platform[:, 2] - base[:, 2]
    leg = int(np.argmax(np.round(across, 9)))
    if not mean_length_m > across[leg]:
        raise HexsimError(
            f"neutral_leg_length_m is {mean_length_m}, but the joints of leg {leg + 1} are {across[leg]:.4f} m apart in "
            f"plan; make it longer than that, or bring the joints closer."
        )
    height = float(np.sqrt(mean_length_m**2 - across[0] ** 2)) - float(rise[0])
    for _ in range(NEWTON_MAX_ITERATIONS):
        lengths = np.hypot(across, height + rise)
        missing = mean_length_m - float(lengths.mean())
        if abs(missing) < tolerance_m:
            break
        height += missing / float(np.mean((height + rise) / lengths))
    return height


@dataclass(frozen=True, kw_only=True, eq=False)
class HexapodKinematics(Mechanics):
    """Six legs under a platform."""

    n_legs: ClassVar[int] = N_LEGS
    dofs: ClassVar[tuple[str, ...]] = DOF_NAMES
    axes: ClassVar[tuple[str, ...]] = DOF_NAMES
    moving_body: ClassVar[str] = "platform"

    @classmethod
    def from_joints(
        cls,
        base_joints_m: ArrayLike,
        platform_joints_m: ArrayLike,
        neutral_leg_length_m: float,
        stroke_m: ArrayLike,
        leg_zero_offsets_m: ArrayLike = 0.0,
    ) -> HexapodKinematics:
        """Joints (6, 3) [m] where they are. In the neutral pose the platform is level over the base, without turn or shift,
        at the height where the legs are `neutral_leg_length_m` long in the mean.

        A piston at half its stroke makes a leg of that length, plus the leg's zero offset [m].
        Raises HexsimError if the neutral leg cannot span the joints, or if it is shorter than half its stroke.
        """
        base, platform = np.array(base_joints_m, dtype=float), np.array(platform_joints_m, dtype=float)
        return cls(
            base_joints=base,
            platform_joints=platform,
            retracted_length_m=neutral_leg_length_m - 0.5 * np.asarray(stroke_m) + np.asarray(leg_zero_offsets_m),
            stroke_m=np.asarray(stroke_m, dtype=float),
            neutral_height_m=neutral_height(base, platform, neutral_leg_length_m),
        )

    def forward(self, piston_positions: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Pose (..., 6) with these piston positions, by Newton from `guess` (pose(s), default neutral).

        Of the up to 40 poses with the same lengths it returns the one connected with the guess, as a rule. Raises
        HexsimError naming the row and the residual where no pose is found. Rounding limits the result to about
        1e-13 m times the condition number of the Jacobian.
        """
        positions, lead = as_rows(piston_positions, "piston positions", N_LEGS)
        lengths = positions + self.retracted_length_m
        tolerance_m = 1e-13  # residual length at which the iteration stops: about 450 ulp of a 1 m leg
        start = np.zeros(N_LEGS) if guess is None else np.asarray(guess, dtype=np.float64)
        poses = np.array(np.broadcast_to(start, (*lead, N_LEGS)), dtype=np.float64, order="C").reshape(-1, N_LEGS)
        residuals = forward_rows(
            lengths,
            poses,
            self.base_joints,
            self.platform_joints,
            self.neutral_height_m,
            NEWTON_MAX_ITERATIONS,
            tolerance_m,
        )
        found = residuals <= 100.0 * tolerance_m
        if not found.all():
            row = int(np.argmin(found))
            raise HexsimError(
                f"No pose found for piston positions {np.array2string(positions[row], precision=4)} m (row {row}, "
                f"residual {residuals[row]:.2e} m); check that they belong to one pose, or give a closer guess."
            )
        return poses.reshape(*lead, N_LEGS)

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

    def on_neutral_branch(self, poses: ArrayLike) -> NDArray[np.bool_]:
        """Whether det J has the sign it has in the neutral pose, (...) bool: no singularity between, as a rule."""
        return np.linalg.det(self.jacobian(poses)) * np.linalg.det(self.jacobian(np.zeros(N_LEGS))) > 0.0
