"""IMU off its declared place: it shows a + alpha x r + omega x (omega x r)."""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """In the platform frame."""
    resolved.imu_place_m = resolved.imu_place_m + np.array([values["x_m"], values["y_m"], values["z_m"]])


EFFECT = Effect(
    name="imu_position",
    balance="sensor",
    description="the IMU is off its declared place",
    source="mounting: 10-100 mm",
    parameters=tuple(
        EffectParameter(name=name, unit="m", bounds=(-5.0, 5.0), typical=0.03, default=0.0)
        for name in ("x_m", "y_m", "z_m")
    ),
    apply=apply,
    places="machine",
    kinds=("hexapod",),
    vector=True,
    built_in=True,
)
