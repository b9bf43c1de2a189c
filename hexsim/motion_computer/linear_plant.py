"""The plant of a declared machine as a linear one: valve volts in, pistons, pressures and platform out.

Legs as in `loop_model` (own states s_i, forces F_i), joined by the load about a pose at rest (`leg_load`):

    s_i' = A_i s_i + b_i u_i,    y'' = C (F - K y),    C = J M^-1 J'

y: the pistons' distances from the pose. Each valve stands open a little beyond its lap, as in `loop_model`: shut, an
overlapped valve has no gain. Left out: dry friction, delay and hysteresis of the valve, its slew, payloads on springs as
states (they are held), a supply that droops, and terms of the order of the speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.leg_load import holding_forces, holding_stiffness, leg_compliance, platform_jacobian
from hexsim.motion_computer.loop_model import L, leg_at, leg_slopes
from hexsim.signals.table import table

Array = NDArray[np.float64]
STATES: dict[int, str] = {
    L.P1: "pressure_bottom",
    L.P2: "pressure_top",
    L.X: "spool",
    L.RATE: "spool",
    L.Y: "position",
    L.V: "velocity",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPlant:
    """x' = A x + B u, y = C x + D u, all deviations from the operating point. Names end in their unit.

    A (n, n), B (n, legs), C (outputs, n), D (outputs, legs).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def linear_plant(machine: Machine, pose: Array, extends: bool = True) -> LinearPlant:
    """The plant about a pose (6,) from neutral, every valve open a little one way. Raises HexsimError out of reach."""
    resolved, mechanics = resolve(machine), machine.mechanics
    n, positions, supply_Pa = machine.n_legs, mechanics.inverse(pose), machine.supply.pressure_Pa
    forces, sign = holding_forces(resolved, pose), 1.0 if extends else -1.0
    legs = [
        leg_slopes(*leg_at(p, force, supply_Pa, sign, position), supply_Pa)
        for p, force, position in zip(resolved.rows, forces, positions, strict=True)
    ]
    count = 6 * n  # every leg with all of its states; those that it has not go at the end
    A, B, F = np.zeros((count, count)), np.zeros((count, n)), np.zeros((n, count + n))
    for i, (slopes, _) in enumerate(legs):
        own = slice(6 * i, 6 * i + 6)
        A[own, own], B[own, i] = slopes[:, : L.VOLTS], slopes[:, L.VOLTS]
        F[i, own], F[i, count + i] = slopes[L.V, : L.VOLTS], slopes[L.V, L.VOLTS]
    F[:, L.Y : count : 6] -= holding_stiffness(resolved, pose)
    accelerations = leg_compliance(resolved, pose) @ F
    A[L.V :: 6], B[L.V :: 6] = accelerations[:, :count], accelerations[:, count:]
    kept = [6 * i + place for i, (_, there) in enumerate(legs) for place in there]
    names = [_state_names(place, n) for place in range(6)]
    outputs, read = _outputs(machine, pose, accelerations)
    return LinearPlant(
        A=A[np.ix_(kept, kept)],
        B=B[kept],
        C=read[:, kept],
        D=read[:, count:],
        states=tuple(names[place % 6][place // 6] for place in kept),
        inputs=table()["valve"].columns(n),
        outputs=outputs,
    )


def _state_names(place: int, n: int) -> tuple[str, ...]:
    signal = table()[STATES[place]]
    if place != L.RATE:
        return signal.columns(n)
    return tuple(f"spool_velocity{mark}_m_s" for mark in ([""] if n == 1 else [f"_{i + 1}" for i in range(n)]))


def _outputs(machine: Machine, pose: Array, accelerations: Array) -> tuple[tuple[str, ...], Array]:
    """Names, and rows over states and volts: pistons, chambers, and of a platform its pose and what its sensors feel.

    Accelerations are those of the motion, without gravity, in the platform's frame.
    """
    n, mechanics, resolved = machine.n_legs, machine.mechanics, resolve(machine)
    every = np.eye(accelerations.shape[1])
    count = 6 * n
    rows: dict[str, Any] = {"position": every[L.Y : count : 6], "pressure_bottom": every[L.P1 : count : 6]}
    if machine.cylinder.rod_side == "valve":
        rows["pressure_top"] = every[L.P2 : count : 6]
    if not mechanics.has_platform:
        rows["acceleration"] = accelerations
    else:
        rates = mechanics.twist(np.tile(pose, (6, 1)), np.eye(6)).T  # twist for the rate of each coordinate
        rows["platform"] = np.linalg.solve(mechanics.jacobian(pose) @ rates, rows["position"])
        felt = np.linalg.solve(platform_jacobian(resolved, pose), accelerations)
        rows["acceleration"], rows["angular_acceleration"] = felt[:3], felt[3:]
    names = [name for stem in rows for name in table()[stem].columns(n)]
    return tuple(names), np.vstack(list(rows.values()))
