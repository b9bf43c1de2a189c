"""Inclined base: the axis stands at an angle to the vertical."""

from __future__ import annotations

import scipy

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Turn gravity by the angle about the y axis, on from where other effects have turned it."""
    base = scipy.spatial.transform.Rotation.from_rotvec([0.0, values["angle_rad"], 0.0])
    resolved.gravity_m_s2 = base.inv().apply(resolved.gravity_m_s2)


EFFECT = Effect(
    name="incline",
    balance="force",
    description="the machine's axis is inclined to the vertical",
    source="installation; a cylinder mounted at a slant",
    parameters=(EffectParameter(name="angle_rad", unit="rad", bounds=(0.0, 1.5707963), typical=0.3, power=2.0),),
    apply=apply,
    places="platform",
)
