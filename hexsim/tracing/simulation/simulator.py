"""Simulations that answer a log: same setpoints, same start."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hexsim.declaration import Machine
from hexsim.hydraulics import leg as equations
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import S
from hexsim.machine.geometry import machine_kinematics
from hexsim.mechanics.rigid_body import joint_wrenches
from hexsim.signals.log import Log
from hexsim.tracing.simulation import closed_loop as loop
from hexsim.tracing.simulation import motion
from hexsim.tracing.simulation.rig import Rig, rig_of

Array = np.ndarray
REST_M = 2.0e-5  # [m] a log that begins this near its setpoint begins at rest
START_S = 0.02  # [s] of the log that give position and speed at its beginning


def simulate_log(machine: Machine, log: Log, feedback: int, supply: Array | None = None) -> dict[str, Array]:
    """Outputs as the sensors show them, without noise; NaN after a divergence.

    position, volts, pressure (n_legs, n); supply (n,); acceleration (1, n) of a bench, (6, n) of a platform: x, y, z, angular.
    supply: (n,) pressure that drives the legs instead of the simulated supply [Pa].
    """
    rig, resolved = rig_of(machine, feedback)
    if (finer := samples_of_sample(log.rate, rig.controller.rate_Hz)) > 1:
        out = simulate_log(machine, log.finer(finer), feedback, None if supply is None else np.repeat(supply, finer))
        return {name: rows[..., ::finer] for name, rows in out.items()}
    k, nothing = log.n_legs, np.zeros((log.n_legs, log.n))
    inputs = loop.Inputs(
        setpoint=nothing if log.setpoint is None else log.setpoint,
        volts=nothing if log.volts is None else log.volts,
        position=log.position,
        supply=np.zeros(0) if supply is None else supply,
        near_rest=log.near_rest,
        rate_Hz=float(log.rate),
        first_tick=log.tick_phase(max(round(log.rate / rig.controller.rate_Hz), 1)),
        start_s=log.offset_s,
    )
    out = np.empty((3 * k + 1 + len(rig.sensors.acceleration), log.n))
    room = loop.room_for(start_state(rig, resolved, log), k, len(rig.sensors.acceleration), log.n)
    loop.run(rig, inputs, room, out)
    rows = np.split(out, [k, 2 * k, 3 * k, 3 * k + 1])
    names = ("position", "volts", "pressure", "supply", "acceleration")
    return dict(zip(names, rows, strict=True)) | {"supply": out[3 * k]}


def samples_of_sample(rate_Hz: float, controller_Hz: float) -> int:
    """Samples of the simulation for one of a log: a slow log is simulated with all ticks of its controller."""
    least = int(np.ceil(controller_Hz / rate_Hz * (1.0 - 1e-6)))
    if least <= 1:
        return 1
    even = (k for k in range(least, 4 * least + 1) if abs(k * rate_Hz / controller_Hz % 1.0) < 1e-6)
    return next(even, least)


def start_of(log: Log, gain: Array, offset: Array) -> tuple[Array, Array]:
    """Positions [m] and speeds [m/s] (n_legs,) at the beginning of a log: at rest if the first samples are at the setpoints.

    gain, offset (n_legs,): of the position sensors, y_m = gain y + offset.
    """
    first = log.position[:, :2].mean(axis=1)
    if log.setpoint is not None and np.all(np.abs(log.setpoint[:, 0] - first) < REST_M):
        return (log.setpoint[:, 0] - offset) / gain, np.zeros(log.n_legs)
    head = max(int(START_S * log.rate), 4)
    speed, first = np.polyfit(log.time[:head] - log.time[0], log.position[:, :head].T, 1)
    return (first - offset) / gain, speed / gain


def start_state(rig: Rig, resolved: Resolved, log: Log) -> Array:
    """Load at the first positions, at rest or in steady motion; pressures that carry it."""
    y, v = start_of(log, *rig.sensors.position.T[:2])
    thrust, down, load = load_at(rig, resolved, y, v)
    ps = rig.supply[S.PRESSURE]
    legs = np.zeros((log.n_legs, motion.LEG_STATES))
    for own, row, position, speed, force in zip(legs, rig.legs, y, v, thrust, strict=True):
        own[motion.LEG_P1] = motion.carrying_pressure(row, position, speed, ps, force)
        own[motion.LEG_P2] = ps
        if row[P.SPOOL_OMEGA] > 0.0:
            own[motion.LEG_X] = equations.commanded_spool(row, 0.0, 0.0)
    travel = down / rig.load.spring.omega**2 if rig.load.spring.mass > 0 else 0.0
    return np.concatenate([[ps, travel, 0.0], legs.ravel(), load])


def load_at(rig: Rig, resolved: Resolved, y: Array, v: Array) -> tuple[Array, float, Array]:
    """(thrusts (n_legs,) [N] that carry the load without acceleration, gravity along its z axis [m/s2], its states)."""
    body, gravity = rig.load.body, np.array(rig.load.gravity)
    if len(y) == 1:
        return -(body.carried + body.sprung) * gravity[2:], float(gravity[2]), np.array([y[0], v[0]])
    kinematics = machine_kinematics(resolved.machine)
    pose = kinematics.forward(y)
    rotation, jacobian = kinematics.rotation(pose), kinematics.jacobian(pose)
    twist, own = np.linalg.solve(jacobian, v), rotation.T @ gravity
    at_rest = joint_wrenches(body, np.zeros((1, 6)), np.zeros((1, 3)), own[None], np.array([-body.sprung * own[2]]))[0]
    thrust = kinematics.static_leg_forces(pose, kinematics.from_platform_frame(pose, at_rest))
    place = pose[:3] + np.array([0.0, 0.0, kinematics.neutral_height_m])
    turned = Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]]
    return thrust, float(own[2]), np.concatenate([place, turned, twist[:3], rotation.T @ twist[3:]])
