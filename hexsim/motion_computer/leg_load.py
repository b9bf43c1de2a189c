"""The load as the legs see it about neutral: masses along the legs, and the forces that hold it at rest.

A leg of a platform moves the load of the others. About neutral, y being the pistons' distances from it,

    F = F_0 + M y'' + K y,     M = (J m^-1 J')^-1,     K = d(holding forces)/dy

M (n, n): force on a leg for the acceleration of each. Over the mass that a leg has in heave, F is an acceleration.

Away from neutral, for what forces do to the legs (`PoseLoad`): N(y) = M^-1 to first order in y, holding forces to second, and the
acceleration that the joints' geometry and the turning body give legs that no force moves, quadratic in their speeds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from compensation.compensator import MEASURED_TICKS
from hexsim.hydraulics.resolved import Resolved
from hexsim.machine.geometry import held_body
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.rigid_body import RigidBody, joint_wrenches, mass_matrix

Array = NDArray[np.float64]
NEUTRAL = np.zeros(6)
SPAN = 2 * MEASURED_TICKS + 1  # ticks of a parabola whose middle is as old as a measured load
SLOPE = np.linalg.pinv(np.vander(np.arange(SPAN) - MEASURED_TICKS, 3, increasing=True))[1]  # of a parabola, a tick


def leg_compliance(resolved: Resolved, pose: Array = NEUTRAL) -> Array:
    """Acceleration of each leg for a force on each, in a pose (n_legs, n_legs) [1/kg]: J M^-1 J'."""
    jacobian = platform_jacobian(resolved, pose)
    return jacobian @ np.linalg.pinv(mass_matrix(held_body(resolved))) @ jacobian.T  # a bench's mass does not turn


def platform_jacobian(resolved: Resolved, pose: Array = NEUTRAL) -> Array:
    """J (n_legs, 6) of l' = J (v, omega), both in the platform's frame. [1, m]"""
    mechanics = resolved.machine.mechanics
    rotation, jacobian = mechanics.rotation(pose), mechanics.jacobian(pose)
    return np.hstack([jacobian[:, :3] @ rotation, jacobian[:, 3:] @ rotation])


def holding_stiffness(
    resolved: Resolved,
    pose: Array = NEUTRAL,
    *,
    displaced_m: float = 1e-4,  # of a leg, for the derivative of the holding forces
) -> Array:
    """K (n_legs, n_legs) [N/m]: how the forces that hold the load change as each piston moves."""
    mechanics = resolved.machine.mechanics
    at, steps = mechanics.piston_positions(pose), displaced_m * np.eye(mechanics.n_legs)
    ends = [holding_forces(resolved, mechanics.forward(at + step)) for step in (*steps, *-steps)]
    there, back = np.split(np.array(ends), 2)
    return (there - back).T / (2 * displaced_m)


def holding_forces(resolved: Resolved, pose: Array = NEUTRAL) -> Array:
    """Axial forces (n_legs,) [N] that hold the load at rest: J' F = -weight."""
    still, mechanics = np.zeros(6), resolved.machine.mechanics
    wrench = platform_wrench(held_body(resolved), resolved.gravity_m_s2, mechanics, pose, still, still)
    return np.linalg.lstsq(mechanics.jacobian(pose).T, wrench, rcond=None)[0].astype(np.float64)


def platform_wrench(
    body: RigidBody, gravity_m_s2: Array, mechanics: Mechanics, pose: Array, twist: Array, twist_rate: Array
) -> Array:
    """Force and moment (6,) [N, N m] about the platform's origin that carry and move a body; all in the world's frame."""
    rotation = mechanics.rotation(pose)
    omega, gravity = np.ascontiguousarray((twist[3:] @ rotation)[None, :]), (gravity_m_s2 @ rotation)[None, :]
    motion = mechanics.to_platform_frame(pose, twist_rate)
    return mechanics.from_platform_frame(pose, joint_wrenches(body, motion[None, :], omega, gravity)[0])


def leg_drift(resolved: Resolved, pose: Array, speeds: Array) -> Array:
    """Accelerations (n_legs,) [m/s2] of legs that move at `speeds` (n_legs,) [m/s] and that no force accelerates."""
    mechanics, body = resolved.machine.mechanics, held_body(resolved)
    twist = np.linalg.solve(mechanics.jacobian(pose), speeds).astype(np.float64)
    wrench = mechanics.to_platform_frame(pose, platform_wrench(body, np.zeros(3), mechanics, pose, twist, np.zeros(6)))
    free = mechanics.from_platform_frame(pose, -np.linalg.solve(mass_matrix(body), wrench))
    return mechanics.leg_accelerations(pose, twist, free)


@dataclass(frozen=True, kw_only=True)
class PoseLoad:
    """What the legs' forces do in any pose: y'' = N(y) (f - F_0 - h(y)) / m + b(y'), y from neutral, from the declared body and
    geometry.

    load: at neutral. by_place (n, n, n) [1/m]: derivatives of N by each leg. bend (n, n, n) [1/(m s2)]: half the second ones of h/m.
    drift (n, n, n) [1/m]: b by pairs of speeds.
    """

    load: ExpectedLoad
    by_place: Array
    bend: Array
    drift: Array

    @classmethod
    def of(
        cls,
        resolved: Resolved,
        load: ExpectedLoad,
        *,
        pose_share: float = 0.125,  # of the stroke: of a leg, for how they and the mobility change over the workspace
    ) -> PoseLoad:
        mechanics, n = resolved.machine.mechanics, len(load.neutral)
        reach = pose_share * float(np.min(mechanics.stroke_m))
        steps = reach * np.eye(n)
        there, back = (
            [mechanics.forward(load.neutral + sign * step) for step in steps] for sign in (1.0, -1.0)
        )  # poses with one leg out and in
        pairs = list(zip(there, back, strict=True))
        mobility = [leg_compliance(resolved, a) - leg_compliance(resolved, b) for a, b in pairs]
        stiffness = [holding_stiffness(resolved, a) - holding_stiffness(resolved, b) for a, b in pairs]
        moving = [[leg_drift(resolved, NEUTRAL, one + other) for other in np.eye(n)] for one in np.eye(n)]
        alone = np.array([leg_drift(resolved, NEUTRAL, one) for one in np.eye(n)])
        drift = 0.5 * (np.array(moving) - alone[:, None] - alone[None])
        return cls(
            load=load,
            by_place=np.stack(mobility, axis=-1) * (load.mass_kg / (2.0 * reach)),
            bend=0.5 * np.stack(stiffness, axis=-1) / (2.0 * reach * load.mass_kg),
            drift=np.moveaxis(drift, -1, 0),
        )

    def at(self, positions: Array, speeds: Array) -> tuple[Array, Array]:
        """At positions (n,) [m], speeds (n,) [m/s]: mobility over each leg's own (n, n), and the load (n,) [m/s2] of each for held
        forces of the others: that of place and speeds."""
        away = positions - self.load.neutral
        mobility = self.load.mobility + self.by_place @ away
        held = self.load.stiffness @ away + (self.bend @ away) @ away
        own = np.diag(mobility)
        return mobility / own[:, None], (mobility @ held - (self.drift @ speeds) @ speeds) / own


@dataclass(frozen=True, kw_only=True)
class ExpectedLoad:
    """What each leg of a platform carries of the motion asked of all of them, from the declared body and geometry.

    inertia (n, n) [1], stiffness (n, n) [1/s2]: M and K over the mean mass of a leg while all move alike, mass_kg;
    neutral (n,) [m]. over_weight: that mass' weight over the mean force of a leg at rest.
    """

    inertia: Array
    stiffness: Array
    neutral: Array
    mass_kg: float
    over_weight: float

    @classmethod
    def of(cls, resolved: Resolved) -> ExpectedLoad | None:
        """None for a bench, whose leg carries its own mass alone."""
        mechanics = resolved.machine.mechanics
        if not mechanics.has_platform:
            return None
        neutral, inertia = mechanics.neutral_positions, np.linalg.inv(leg_compliance(resolved))
        stiffness = holding_stiffness(resolved)
        mass = inertia.sum() / mechanics.n_legs
        weight = mass * float(np.linalg.norm(resolved.gravity_m_s2))
        held = float(np.abs(holding_forces(resolved, NEUTRAL)).mean())
        return cls(
            inertia=inertia / mass, stiffness=stiffness / mass, neutral=neutral, mass_kg=mass, over_weight=weight / held
        )

    @cached_property
    def mobility(self) -> Array:
        """Acceleration (n, n) of each leg for a force on each, times mass_kg [1]."""
        return np.linalg.inv(self.inertia).astype(np.float64)

    def accelerations(self, setpoints: Array, tick_s: float) -> Array:
        """Load (m, n) [m/s2] at each tick of setpoints (m, n) [m]; at both ends that of the tick beside."""
        load = np.zeros_like(setpoints)
        if len(setpoints) > 2:
            steps = setpoints[1:] - setpoints[:-1]
            load[1:-1] = (steps[1:] - steps[:-1]) @ (self.inertia.T / tick_s**2)
            load[0], load[-1] = load[1], load[-2]
        return load + (setpoints - self.neutral) @ self.stiffness.T
