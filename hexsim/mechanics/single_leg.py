"""Kinematics of a bench: one vertical leg. Its pose has one degree of freedom, z: the piston's travel from mid stroke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SingleLegKinematics:
    """The methods of `HexapodKinematics` that a machine needs in operation, for one leg.

    dofs: names of the degrees of freedom. moving_body: name of the body in the MuJoCo model.
    """

    stroke_m: float
    dofs: ClassVar[tuple[str, ...]] = ("z",)
    moving_body: ClassVar[str] = "load"

    def piston_positions(self, pose: ArrayLike) -> Array:
        """Piston positions (..., 1) [m] of poses (..., 6)."""
        return 0.5 * self.stroke_m + np.asarray(pose, dtype=np.float64)[..., 2:3]

    def forward(self, piston_positions: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Poses (..., 6) of piston positions (..., 1); the guess is not needed."""
        positions = np.asarray(piston_positions, dtype=np.float64)
        pose = np.zeros((*positions.shape[:-1], 6))
        pose[..., 2] = positions[..., 0] - 0.5 * self.stroke_m
        return pose
