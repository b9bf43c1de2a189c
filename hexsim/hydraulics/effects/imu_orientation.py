"""IMU turned against the platform's axes: it shows R' a and R' alpha, R of the rotation vector (x, y, z)."""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Small turns add up."""
    resolved.imu_turn_rad = resolved.imu_turn_rad + np.array([values["x_rad"], values["y_rad"], values["z_rad"]])


EFFECT = Effect(
    name="imu_orientation",
    balance="sensor",
    description="the IMU is turned against the platform's axes",
    source="mounting by eye: 0.5-3 deg",
    parameters=tuple(
        EffectParameter(name=name, unit="rad", bounds=(-3.2, 3.2), typical=0.02, default=0.0)
        for name in ("x_rad", "y_rad", "z_rad")
    ),
    apply=apply,
    places="machine",
    kinds=("hexapod",),
    vector=True,
    built_in=True,
)
