"""Platform of a hexapod: r_J = sum f_i (u_i, r_i x u_i) - (F, M) of `mechanics.rigid_body`, six numbers  [N], [N m].

f_i = P1 A1 - Ps A2 - friction of each leg at the measured point, u_i and r_i in the platform frame, a and w' as the
accelerometers show them; without these from the positions, in weak form.
Legs whole (continuity quiet) but r_J violated: payload, inertia, joints, friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from hexsim.declaration import Machine
from hexsim.hydraulics.resolved import Resolved
from hexsim.machine.geometry import legs_beyond_body, moving_body, suspension
from hexsim.mechanics.rigid_body import add_ride_wrenches, joint_wrenches, point_accelerations, ride
from hexsim.signals.log import Log
from hexsim.signals.weak_form import WHOLE, Window
from hexsim.tracing.balances.balance import (
    Balance,
    SensedLeg,
    advanced,
    filter_delay_s,
    measured_point,
    position_settings,
    resolved_machine,
)
from hexsim.tracing.balances.force import Force, force_pressures, leg_thrust, thrust_key
from hexsim.tracing.memory import latest, remembered

Array = np.ndarray
ROWS = ("x", "y", "z", "roll", "pitch", "yaw")


class Platform(Balance):
    """Newton and Euler about the centre of the platform joints, in the platform frame."""

    name = "platform"
    unit = "N, N m"
    caption = "forces of the legs = inertia of the platform"
    order = 60
    one_cause = True

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return force_pressures(machine) if machine.is_hexapod else ()

    def places(self, log: Log) -> list[str]:
        return [f"platform {row}" for row in ROWS]

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        return wrench_residual(log, machine, at)[0]


class LegForce(Balance):
    """The platform's residual shared out to the legs: thrusts that would make up for it, J^-T r_J  [N]."""

    name = "force"
    unit = "N"
    caption = Force.caption
    order = 50
    learned_as = "force"
    shared_out = "platform"

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return Platform().needs(machine)

    def residual(self, log: Log, machine: Machine) -> Array:
        residual, lines = wrench_residual(log, machine)
        return np.linalg.solve(np.swapaxes(lines, -1, -2), residual.T[..., None])[..., 0].T


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatformMotion:
    """How the platform moved, from the pistons' positions alone; all in the platform frame.

    lines (n, 6, 6): rows (u_i, r_i x u_i) of the legs, wrench = thrusts . lines; rotation (n, 3, 3) to the world frame;
    omega (n, 3) [rad/s]; poses (n, 6). accelerations (n, 6): (a, w') under the window, None of a log whose accelerometers show them.
    """

    poses: Array
    lines: Array
    rotation: Array
    omega: Array
    accelerations: Array | None

    def gravity(self, resolved: Resolved) -> Array:
        """(n, 3) in the platform frame [m/s2]."""
        return resolved.gravity_m_s2 @ self.rotation


def platform_motion(log: Log, resolved: Resolved, sensed: Sequence[SensedLeg]) -> PlatformMotion:
    """Forward kinematics and velocities of every sample under the window, once for a log and its position sensors."""
    kinematics = resolved.mechanics
    built = tuple(
        np.asarray(array).tobytes()
        for array in (kinematics.base_joints, kinematics.platform_joints, kinematics.retracted_length_m)
    )
    settings = tuple(position_settings(resolved, i) for i in range(6))

    def moved() -> PlatformMotion:
        lengths = np.stack([leg.mean_y for leg in sensed]).T
        near = remembered(log, "poses", lambda: kinematics.forward(lengths))  # of joints and sensors nearby
        poses = kinematics.forward(lengths, near)
        jacobian, rotation = kinematics.jacobian(poses), kinematics.rotation(poses)
        directions = jacobian[:, :, :3] @ rotation
        arms = np.cross(kinematics.platform_joints, directions)
        twist = np.linalg.solve(jacobian, np.stack([leg.mean_v for leg in sensed]).T[..., None])[..., 0]
        omega = np.einsum("nba,nb->na", rotation, twist[:, 3:])
        weak = None
        if log.acceleration is None or log.angular is None:  # not all six
            sharp, window = kinematics.forward(np.stack([leg.y for leg in sensed]).T, poses).T, Window(log.rate)
            change = kinematics.twist_rate(poses, window.rate(sharp).T, window.second_rate(sharp).T)
            weak = kinematics.to_platform_frame(poses, change)
        return PlatformMotion(
            poses=poses, lines=np.concatenate([directions, arms], axis=-1), rotation=rotation, omega=omega, accelerations=weak
        )  # fmt: skip

    return remembered(log, ("platform", built, settings), moved)


def accelerations_of(log: Log, resolved: Resolved, motion: PlatformMotion) -> Array:
    """(a, w') (n, 6) of the platform's origin, in its frame: as its accelerometers show them, else from the positions, under the
    window."""
    found = felt_by_imu(log, resolved, motion.omega) if motion.accelerations is None else motion.accelerations
    return np.ascontiguousarray(found)


def felt_by_imu(log: Log, resolved: Resolved, omega: Array) -> Array:
    """Accelerations (n, 6) of the platform's origin, in its frame, from what the IMU reads where it is mounted.

    omega (n, 3) [rad/s]: of the platform, in its frame.
    """
    assert log.acceleration is not None and log.angular is not None
    sensors = resolved.sensors
    shown = log.acceleration - np.array([0.0, 0.0, sensors.acceleration_offset_m_s2])[:, None]
    late = sensors.acceleration_delay_s, sensors.acceleration_delay_s + filter_delay_s(resolved, "acceleration")
    moved = [(late[1], row) for row in shown / sensors.acceleration_gain] + [(late[0], row) for row in log.angular]
    read = np.stack([advanced(row, delay * log.rate) for delay, row in moved], axis=-1)
    if not (resolved.imu_turn_rad.any() or resolved.imu_place_m.any()):
        return read
    turned = Rotation.from_rotvec(resolved.imu_turn_rad)
    a, turning = turned.apply(read[:, :3]), turned.apply(read[:, 3:])
    place = resolved.imu_place_m
    a = a - np.cross(turning, place) - np.cross(omega, np.cross(omega, place))
    return np.concatenate([a, turning], axis=1)


def wrench_residual(log: Log, machine: Machine, at: slice = WHOLE) -> tuple[Array, Array]:
    """r_J (6, n) under the window, and the legs' lines (n, 6, 6) in the platform frame: wrench = thrusts . lines."""
    resolved, window = resolved_machine(machine), Window(log.rate, at=at)
    body = moving_body(resolved, log.loaded)
    points = [measured_point(log, machine, resolved, i) for i in range(6)]
    motion = platform_motion(log, resolved, [point.sensed for point in points])
    thrusts = np.empty((log.n, 6))
    for i, (row, point) in enumerate(zip(resolved.rows, points, strict=True)):
        thrusts[:, i] = latest(log, ("thrust", i), thrust_key(resolved, i), partial(leg_thrust, row, point))
    wrench = (thrusts[:, None] @ motion.lines)[:, 0].T
    acceleration, gravity = accelerations_of(log, resolved, motion), motion.gravity(resolved)
    asked = joint_wrenches(body, acceleration, motion.omega, gravity) + acceleration @ legs_beyond_body(resolved)
    for mode in resolved.payload_modes:
        spring = suspension(mode, resolved.gravity_m_s2)
        felt = (point_accelerations(spring.place, acceleration, motion.omega) - gravity) @ np.array(spring.axis)
        travel, rate = ride(spring, felt, log.rate)
        add_ride_wrenches(asked, spring, acceleration, motion.omega, gravity, travel, rate)
    if motion.accelerations is not None:  # under the window already
        return window.mean(wrench) - asked.T[:, at], motion.lines[at]
    return window.mean(wrench - asked.T), motion.lines[at]


def shown_accelerations(log: Log, machine: Machine) -> Array:
    """(6, n) as the accelerometers show them, else from the positions, under the window."""
    if log.acceleration is not None and log.angular is not None:
        return np.concatenate([log.acceleration, log.angular])
    resolved = resolved_machine(machine)
    sensed = [measured_point(log, machine, resolved, i).sensed for i in range(6)]
    return accelerations_of(log, resolved, platform_motion(log, resolved, sensed)).T


def felt_by_load(log: Log, machine: Machine) -> Array:
    """Acceleration less gravity (3, n) at the centre of mass, in the platform frame  [m/s2]."""
    resolved = resolved_machine(machine)
    sensed = [measured_point(log, machine, resolved, i).sensed for i in range(6)]
    motion = platform_motion(log, resolved, sensed)
    acceleration = accelerations_of(log, resolved, motion)
    centre = moving_body(resolved, log.loaded).centre
    return (point_accelerations(centre, acceleration, motion.omega) - motion.gravity(resolved)).T


BALANCES = (LegForce(), Platform())
