"""Joints of a leg off their declared places: the motion computer's kinematics are not the machine's."""

from __future__ import annotations

from dataclasses import replace

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved

ENDS = {"base": "base_joints", "platform": "platform_joints"}
KEYS = tuple(f"{end}_{axis}_m" for end in ENDS for axis in "xyz")


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """Move the joints of the built machine."""
    for end, name in ENDS.items():
        joints = getattr(resolved.mechanics, name).copy()
        joints[list(legs)] += [values[f"{end}_{axis}_m"] for axis in "xyz"]
        resolved.mechanics = replace(resolved.mechanics, **{name: joints})


EFFECT = Effect(
    name="joint_displacement",
    balance="platform",
    description="a leg's joints are off their declared places",
    source="drawing against machine: 0.2-2 mm",
    parameters=tuple(
        EffectParameter(name=key, unit="m", bounds=(-0.1, 0.1), typical=1e-3, default=0.0) for key in KEYS
    ),
    apply=apply,
    kinds=("hexapod",),
    vector=True,
    of_build=True,
)
