"""Base out of level: gravity is turned against the base by small angles about its x and y axes."""

from __future__ import annotations

import scipy

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Turn gravity back by what the base is turned."""
    base = scipy.spatial.transform.Rotation.from_rotvec([values["about_x_rad"], values["about_y_rad"], 0.0])
    resolved.gravity_m_s2 = base.inv().apply(resolved.gravity_m_s2)


EFFECT = Effect(
    name="gravity_direction",
    balance="platform",
    description="the base is out of level",
    source="floors and frames: 1-20 mrad",
    parameters=tuple(
        EffectParameter(name=name, unit="rad", bounds=(-1.5, 1.5), typical=0.01, default=0.0)
        for name in ("about_x_rad", "about_y_rad")
    ),
    apply=apply,
    places="platform",
    kinds=("hexapod",),
    vector=True,
)
