"""The mechanics of a declared machine."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hexsim.declaration.geometry import JointCircles, JointTables
from hexsim.errors import HexsimError
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.single_leg import SingleLegKinematics


@lru_cache(maxsize=64)
def declared_mechanics(
    geometry: JointCircles | JointTables | None,
    strokes_m: tuple[float, ...],
    *,
    most_condition: float = 1e6,  # condition number beyond which no leg forces hold a platform
) -> Mechanics:
    """Joints, lengths and limits of a hexapod from its [geometry], of a bench without one; kept between calls."""
    if geometry is None:
        return SingleLegKinematics.of_stroke(strokes_m[0])
    made = HexapodKinematics.from_joints(
        *geometry.joints, geometry.neutral_leg_length_m, strokes_m, geometry.leg_zero_offsets_m
    )
    if not made.condition_number(np.zeros(6)) < most_condition:
        raise HexsimError(
            "[geometry] the legs cannot hold the platform in its neutral pose, it is singular: move the joints"
        )
    return made
