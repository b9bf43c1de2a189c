"""Simulations of a hexapod that answer a log: same setpoints, same start."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics import leg as equations
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import S
from hexsim.machine.geometry import machine_kinematics
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.plant.mjcf import leg_bodies, legs_at_platform
from hexsim.signals.log import MeasuredLog
from hexsim.tracing.simulation import hexapod_simulation as hs
from hexsim.tracing.simulation import leg_simulation as ls
from hexsim.tracing.simulation.bench_simulator import REST_M, START_S, STEP_S, friction_step

Array = np.ndarray


@lru_cache(maxsize=8)
def _kinematics(geometry: tuple, stroke: float) -> HexapodKinematics:
    return HexapodKinematics.from_geometry(**dict(geometry), stroke_m=stroke)


def kinematics_of(machine: Machine) -> HexapodKinematics:
    """The machine's kinematics, kept between calls."""
    if machine.geometry is None:
        return machine_kinematics(machine)  # raises with the right sentence
    return _kinematics(tuple(machine.geometry.model_dump().items()), machine.cylinder.stroke_m)


@dataclass(frozen=True, kw_only=True)
class PlatformLoad:
    """The rigid load: mass that moves [kg], mass that is carried [kg], centre (3,) and inertia about it (3, 3)."""

    mass: float
    carried: float
    centre: Array
    inertia: Array


def platform_load(resolved: Resolved) -> PlatformLoad:
    """Platform and, at its joints, the legs as far as they have mass (as in the plant's tendon model)."""
    load = resolved.load
    assert load.platform_mass_kg is not None and load.platform_inertia_kg_m2 is not None
    mass, centre = load.platform_mass_kg, np.array(load.centre_of_mass_m, dtype=float)
    inertia, carried = np.diag(np.array(load.platform_inertia_kg_m2, dtype=float)), mass
    if load.leg_mass_kg > 0:
        kinematics = kinematics_of(resolved.machine)
        neutral = float(kinematics.leg_lengths(np.zeros(6))[0])
        matrix, legs_carried = legs_at_platform(kinematics, leg_bodies(resolved, neutral))
        lump, height = matrix[2, 2], matrix[0, 4] / matrix[2, 2]
        own = np.diag(np.diag(matrix)[3:] - lump * height**2 * np.array([1.0, 1.0, 0.0]))
        both = (mass * centre + lump * np.array([0, 0, height])) / (mass + lump)
        inertia = inertia + own + _steiner(mass, centre - both) + _steiner(lump, np.array([0, 0, height]) - both)
        mass, centre, carried = mass + lump, both, carried + legs_carried
    return PlatformLoad(mass=mass, carried=carried, centre=centre, inertia=inertia)


def _steiner(mass: float, arm: Array) -> Array:
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def load_row(resolved: Resolved) -> tuple[Array, Array]:
    """The load's numbers for the compiled simulation, and the inverse of its inertia."""
    load, row = platform_load(resolved), np.zeros(hs.N_LOAD)
    row[hs.MASS] = load.mass
    row[hs.WEIGHT : hs.WEIGHT + 3] = load.carried * resolved.gravity_m_s2
    row[hs.CENTRE : hs.CENTRE + 3] = load.centre
    row[hs.INERTIA : hs.INERTIA + 9] = load.inertia.ravel()
    if resolved.payload_modes:
        mode = resolved.payload_modes[0]
        row[hs.PAYLOAD_MASS], row[hs.PAYLOAD_DAMPING] = mode.mass_kg, mode.damping_ratio
        row[hs.PAYLOAD_OMEGA] = 2 * np.pi * mode.frequency_Hz
    return row, np.linalg.inv(load.inertia)


def leg_sensor_rows(resolved: Resolved) -> tuple[Array, Array]:
    """Sensors of the legs (6, N_SENSORS), and the shared ones (N_SENSORS,)."""
    rows, leg, shared = np.zeros((6, ls.N_SENSORS)), resolved.leg_sensors, resolved.sensors
    rows[:, ls.Y_GAIN], rows[:, ls.Y_OFFSET] = leg["position_gain"], leg["position_offset_m"]
    rows[:, ls.Y_DELAY], rows[:, ls.P_DELAY] = leg["position_delay_s"], leg["pressure_delay_s"]
    rows[:, ls.P_GAIN], rows[:, ls.P_OFFSET] = leg["pressure_gain"], leg["pressure_offset_Pa"]
    row = np.zeros(ls.N_SENSORS)
    row[ls.PS_GAIN] = shared.supply_pressure_gain
    row[ls.A_GAIN], row[ls.A_OFFSET] = shared.acceleration_gain, shared.acceleration_offset_m_s2
    row[ls.A_DELAY] = shared.acceleration_delay_s
    return rows, row


def start_state(resolved: Resolved, log: MeasuredLog, row: Array) -> Array:
    """Platform at the first positions, at rest if the log begins at the setpoints; pressures that carry it."""
    kinematics, n = kinematics_of(resolved.machine), resolved.rows
    head = max(int(START_S * log.rate), 4)
    gain, offset = resolved.leg_sensors["position_gain"], resolved.leg_sensors["position_offset_m"]
    first = log.position[:, :2].mean(axis=1)
    if log.setpoint is not None and np.all(np.abs(log.setpoint[:, 0] - first) < REST_M):
        first, speed = log.setpoint[:, 0], np.zeros(6)
    else:
        speed, first = np.polyfit(log.time[:head] - log.time[0], log.position[:, :head].T, 1)
    first, speed = (first - offset) / gain, speed / gain
    pose = kinematics.forward(first)
    jacobian, rotation = kinematics.jacobian(pose), kinematics.rotation(pose)
    twist = np.linalg.solve(jacobian, speed)
    state = np.zeros(hs.N_STATES)
    state[hs.PLACE : hs.PLACE + 3] = pose[:3] + np.array([0, 0, kinematics.neutral_height_m])
    state[hs.QUATERNION : hs.QUATERNION + 4] = _quaternion(rotation)
    state[hs.VELOCITY : hs.VELOCITY + 3] = twist[:3]
    state[hs.OMEGA : hs.OMEGA + 3] = rotation.T @ twist[3:]
    state[hs.SUPPLY] = resolved.supply[1]
    weight = row[hs.WEIGHT : hs.WEIGHT + 3] * (1 + row[hs.PAYLOAD_MASS] / row[hs.MASS])
    arm = rotation @ row[hs.CENTRE : hs.CENTRE + 3]
    thrust = kinematics.static_leg_forces(pose, np.concatenate([-weight, np.cross(arm, -weight)]))

    for i in range(6):
        p1, Ps = 0.5 * state[hs.SUPPLY], state[hs.SUPPLY]
        for _ in range(20):
            beyond = equations.force_beyond_pressure(n[i], first[i], speed[i], 0.0, p1, Ps, Ps, 0.0, 0.0)
            p1 = (thrust[i] - beyond) / n[i, P.AREA_BOTTOM]
        state[i * hs.LEG_STATES + hs.LEG_P1] = p1
        if n[i, P.SPOOL_OMEGA] > 0.0:
            state[i * hs.LEG_STATES + hs.LEG_X] = equations.commanded_spool(n[i], 0.0, 0.0)
    if row[hs.PAYLOAD_MASS] > 0:
        down = (rotation.T @ row[hs.WEIGHT : hs.WEIGHT + 3])[2] / row[hs.MASS]
        state[hs.TRAVEL] = down / row[hs.PAYLOAD_OMEGA] ** 2
    return state


def _quaternion(R: Array) -> Array:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return np.array([w, x, y, z])


def simulate_hexapod(machine: Machine, log: MeasuredLog, feedback: int, supply: Array | None = None) -> Array:
    """Outputs (N_OUTPUTS, n) as the sensors show them, without noise; NaN after a divergence."""
    resolved, kinematics = resolve(machine), kinematics_of(machine)
    rows = resolved.rows
    rows[:, P.ROD_SIDE_CHAMBER] = 0.0  # fits have the rod side at supply pressure
    row, inverse = load_row(resolved)
    sensors, shared = leg_sensor_rows(resolved)
    controller = machine.controller
    control = np.array([controller.gain_V_per_m, controller.rate_Hz, machine.valve.voltage_max_V, float(feedback)])
    out, nothing = np.empty((hs.N_OUTPUTS, log.n)), np.zeros((6, log.n))
    hs.run_hexapod(
        rows,
        resolved.supply,
        row,
        inverse,
        kinematics.base_joints,
        kinematics.platform_joints,
        np.asarray(kinematics.retracted_length_m),
        control,
        sensors,
        shared,
        log.setpoint if log.setpoint is not None else nothing,
        log.volts if log.volts is not None else nothing,
        log.position,
        np.zeros(0) if supply is None else supply,
        start_state(resolved, log, row),
        log.rate,
        substeps(rows, row, resolved.supply, log.rate),
        log.near_rest,
        out,
    )
    return out


def substeps(rows: Array, load: Array, supply: Array, rate: float) -> int:
    """Steps a log sample: the friction's corner on a sixth of the mass must stay stable."""
    level = float(friction_step(rows, supply[S.PRESSURE]).max())
    stiffest = level / (rows[:, P.SHARPNESS].min() * load[hs.MASS] / 12)
    return int(np.ceil(1.0 / (rate * min(1.5 * STEP_S, 2.2 / max(stiffest, 1e-9))) - 1e-9))
