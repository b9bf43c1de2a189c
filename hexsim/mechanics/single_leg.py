"""Kinematics of a bench: one vertical leg. Its pose has one degree of freedom, z: the piston's travel from mid stroke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.mechanics.mechanics import Mechanics

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SingleLegKinematics(Mechanics):
    """One leg under a mass that it moves along z."""

    n_legs: ClassVar[int] = 1
    dofs: ClassVar[tuple[str, ...]] = ("z",)
    axes: ClassVar[tuple[str, ...]] = ("leg",)
    moving_body: ClassVar[str] = "load"

    @classmethod
    def of_stroke(
        cls,
        stroke_m: float,
        *,
        drawn_strokes: float = 1.5,  # of a leg that is retracted, over its stroke: no length is declared
    ) -> SingleLegKinematics:
        """Neutral at half stroke."""
        retracted = drawn_strokes * stroke_m
        return cls(
            base_joints=np.zeros((1, 3)),
            platform_joints=np.zeros((1, 3)),
            retracted_length_m=retracted,
            stroke_m=stroke_m,
            neutral_height_m=retracted + 0.5 * stroke_m,
        )

    def piston_positions(self, pose: ArrayLike) -> Array:
        """Piston positions (..., 1) [m] of poses (..., 6)."""
        return 0.5 * self.stroke_m + np.asarray(pose, dtype=np.float64)[..., 2:3]

    def forward(self, piston_positions: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Poses (..., 6) of piston positions (..., 1); the guess is not needed."""
        positions = np.asarray(piston_positions, dtype=np.float64)
        pose = np.zeros((*positions.shape[:-1], 6))
        pose[..., 2] = positions[..., 0] - 0.5 * self.stroke_m
        return pose
