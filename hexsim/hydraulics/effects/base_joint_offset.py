"""A base joint off its declared place."""

from __future__ import annotations

from dataclasses import replace

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Shift the joints of these legs in the frame of the base."""
    joints = resolved.mechanics.base_joints.copy()
    joints[list(legs)] += [values["x_m"], values["y_m"], values["z_m"]]
    resolved.mechanics = replace(resolved.mechanics, base_joints=joints)


EFFECT = Effect(
    name="base_joint_offset",
    balance="platform",
    description="a joint on the base is off its declared place",
    source="welded frames without calibration: 0.5-3 mm",
    parameters=tuple(
        EffectParameter(name=name, unit="m", bounds=(-0.2, 0.2), typical=2.0e-3, default=0.0)
        for name in ("x_m", "y_m", "z_m")
    ),
    apply=apply,
    places="one leg",
    kinds=("hexapod",),
    vector=True,
    built_in=True,
)
