"""The workspace of a machine: how far each degree of freedom goes alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hexsim.mechanics.mechanics import DOF_NAMES, Mechanics

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Excursion:
    """How far one degree of freedom goes alone, the others neutral; and what ends it ("leg 3" or "singularity")."""

    dof: str
    unit: str
    minimum: float
    maximum: float
    minimum_limited_by: str
    maximum_limited_by: str


def _obstacles(kinematics: Mechanics, poses: Array) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """For rows of poses: reachable (n,) bool; first leg out of stroke (n,), -1 where none."""
    positions = kinematics.piston_positions(poses)
    outside = (positions < 0.0) | (positions > kinematics.stroke_m)
    leg = np.where(outside.any(axis=-1), np.argmax(outside, axis=-1), -1)
    return (leg < 0) & kinematics.on_neutral_branch(poses), leg


@lru_cache(maxsize=8)  # machines: a host's limits ask for the same ones again
def excursions(kinematics: Mechanics) -> tuple[Excursion, ...]:
    """How far each degree of freedom goes alone from neutral, both ways, to the first leg limit or singularity.

    Found by stepping outward and bisecting (to 1e-12 of the span); x y z in m, roll pitch yaw in rad.
    """
    span_m = float(np.max(np.asarray(kinematics.retracted_length_m))) + float(np.max(kinematics.stroke_m))
    table = []
    for dof in kinematics.dofs:
        index = DOF_NAMES.index(dof)
        span = span_m if index < 3 else np.pi
        ends = [_excursion(kinematics, index, sign * span) for sign in (-1.0, 1.0)]
        (low, low_by), (high, high_by) = ends
        unit = "m" if index < 3 else "rad"
        table.append(
            Excursion(
                dof=dof,
                unit=unit,
                minimum=low,
                maximum=high,
                minimum_limited_by=low_by,
                maximum_limited_by=high_by,
            )
        )
    return tuple(table)


def _excursion(
    kinematics: Mechanics,
    index: int,
    span: float,
    *,
    scan_steps: int = 2000,  # steps outward, before bisection
) -> tuple[float, str]:
    direction = np.zeros(6)
    direction[index] = 1.0
    steps = np.linspace(0.0, span, scan_steps + 1)
    reachable, _ = _obstacles(kinematics, steps[:, None] * direction)
    if reachable.all():
        return float(span), "none"
    first = int(np.argmin(reachable))
    inside, outside = steps[first - 1], steps[first]
    while abs(outside - inside) > 1e-12 * abs(span):
        middle = 0.5 * (inside + outside)
        ok, _ = _obstacles(kinematics, middle * direction[None, :])
        inside, outside = (middle, outside) if ok[0] else (inside, middle)
    leg = int(_obstacles(kinematics, outside * direction[None, :])[1][0])
    return float(inside), f"leg {leg + 1}" if leg >= 0 else "singularity"
