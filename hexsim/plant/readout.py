# pyright: reportCallIssue=false, reportAttributeAccessIssue=false
# (numba's intrinsics are called without their typing context; MuJoCo's bindings carry no types)
"""From the states of a run to physical signals: legs, oil, platform. Vectorised over the rows of a run."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics import chamber, leg, rod_side, supply
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import POWER_UNIT, S, U
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.points import imu_reading, mounting
from hexsim.mechanics.rigid_body import rotated, rotated_back, rotation_of
from hexsim.plant.callbacks import (
    MPa,
    chamber_state,
    leg_state,
    memory_of,
    offset,
    pointer_to,
    supply_pressure,
    supply_state,
)
from hexsim.plant.plant import Plant
from hexsim.plant.states import A

Array = NDArray[np.float64]


@dataclass(kw_only=True)
class LegSignals:
    """Each (m, n_legs), SI; supply_Pa (m,)."""

    position: Array
    velocity: Array
    pressure_bottom: Array
    pressure_top: Array
    spool: Array
    flow: Array
    friction: Array
    force: Array
    supply_Pa: Array


@dataclass(kw_only=True)
class PlatformSignals:
    """pose (m, 6) relative to neutral, twist (m, 6) in the world frame, accelerations (m, 3) in the platform frame.

    On a bench the acceleration is along the leg, (m, 1), the angular one (m, 0).
    """

    pose: Array
    twist: Array
    acceleration: Array
    angular_acceleration: Array

    def omega(self, kinematics: Mechanics) -> Array:
        """Angular velocity (m, 3) along the platform's axes."""
        return kinematics.to_platform_frame(self.pose, self.twist)[:, 3:]


@compiled
def _leg_rows(rows, layout, which, act, y, v, volts, time, out):
    """Fill out (7, m, n): P1, P2, spool, flow, friction, force, supply. rows: (versions, n, ...), which: (m,)."""
    _, n, width = rows.shape
    for k in range(y.shape[0]):
        states = offset(pointer_to(act), k * act.shape[1])
        for i in range(n):
            p = offset(pointer_to(rows), (which[k] * n + i) * width)
            places = offset(pointer_to(layout), i * layout.shape[1])
            Ps = supply_pressure(p, places, states)
            P1, P2, place, _, z = leg_state(places, states, Ps)
            x, memory = leg.metering_spool(p, volts[k, i], time[k], place), memory_of(places, states)
            out[0, k, i], out[1, k, i], out[2, k, i], out[6, k, i] = P1, P2, x, Ps
            out[3, k, i] = leg.inflow_bottom(p, y[k, i], v[k, i], volts[k, i], x, P1, P2, Ps, time[k], memory)
            out[4, k, i] = leg.friction_force(p, y[k, i], v[k, i], P1, z, P2, time[k])
            out[5, k, i] = leg.leg_force(p, y[k, i], v[k, i], volts[k, i], P1, P2, Ps, z, time[k], memory)


def leg_signals(plant: Plant, time: Array, qpos: Array, qvel: Array, act: Array, volts: Array) -> LegSignals:
    """Signals of all legs from the states of a run, rows (m, ...)."""
    y, v = leg_motion(plant, qpos, qvel)
    out = np.empty((7, *y.shape))
    rows, _, which = versions(plant, time)
    _leg_rows(*map(np.ascontiguousarray, (rows, plant.layout, which, act, y, v, volts, time)), out)
    return LegSignals(
        position=y,
        velocity=v,
        pressure_bottom=out[0],
        pressure_top=out[1],
        spool=out[2],
        flow=out[3],
        friction=out[4],
        force=out[5],
        supply_Pa=out[6, :, 0],
    )


def versions(plant: Plant, time: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Rows that held during the run (versions, n_legs, ...), the supply's (versions, ...), and which one at each time.

    Faults and the oil's temperature change them; `Plant.history` has when.
    """
    since, rows, supplies = zip(*plant.history, strict=True)
    which = np.searchsorted(since, time + 0.5 * plant.context.tick_s, side="right") - 1
    return np.array(rows), np.array(supplies), np.maximum(which, 0)


def leg_motion(plant: Plant, qpos: Array, qvel: Array) -> tuple[Array, Array]:
    """Piston positions and velocities (m, n_legs)."""
    if not plant.is_tendon:
        return qpos[:, plant.slides] - plant.rows[:, P.LENGTH_OFFSET], qvel[:, plant.slide_speeds]
    pose, twist, _ = platform_motion(plant, qpos, qvel, qvel)
    return plant.kinematics.piston_positions(pose), plant.kinematics.leg_velocities(pose, twist)


@compiled
def _platform_rows(qpos, qvel, qacc, height, pose, twist, along):
    """Fill poses and twists (m, 6), and linear accelerations along the platform's axes (m, 3)."""
    for k in range(qpos.shape[0]):
        r, s, t = rotation = rotation_of((qpos[k, 3], qpos[k, 4], qpos[k, 5], qpos[k, 6]))
        pose[k, 0], pose[k, 1], pose[k, 2] = qpos[k, 0], qpos[k, 1], qpos[k, 2] - height
        pose[k, 3], pose[k, 4] = np.arctan2(t[1], t[2]), np.arcsin(min(max(-t[0], -1.0), 1.0))
        pose[k, 5] = np.arctan2(s[0], r[0])
        twist[k, 0], twist[k, 1], twist[k, 2] = qvel[k, 0], qvel[k, 1], qvel[k, 2]
        twist[k, 3], twist[k, 4], twist[k, 5] = rotated(rotation, (qvel[k, 3], qvel[k, 4], qvel[k, 5]))
        along[k, 0], along[k, 1], along[k, 2] = rotated_back(rotation, (qacc[k, 0], qacc[k, 1], qacc[k, 2]))


def platform_motion(plant: Plant, qpos: Array, qvel: Array, qacc: Array) -> tuple[Array, Array, Array]:
    """Pose relative to neutral, twist in the world frame (m, 6); linear acceleration in the platform frame (m, 3)."""
    pose, twist, along = np.empty((len(qpos), 6)), np.empty((len(qpos), 6)), np.empty((len(qpos), 3))
    height = plant.kinematics.neutral_height_m
    _platform_rows(*map(np.ascontiguousarray, (qpos, qvel, qacc)), height, pose, twist, along)
    return pose, twist, along


def platform_signals(plant: Plant, qpos: Array, qvel: Array, qacc: Array) -> PlatformSignals:
    """MuJoCo's free joint: linear part in the world, angular part in the body's frame. A bench has one direction."""
    if not plant.kinematics.has_platform:
        pose, still = plant.kinematics.forward(leg_motion(plant, qpos, qvel)[0]), np.zeros((len(qpos), 0))
        return PlatformSignals(
            pose=pose, twist=np.pad(qvel[:, :1], ((0, 0), (2, 3))), acceleration=qacc[:, :1], angular_acceleration=still
        )
    pose, twist, along = platform_motion(plant, qpos, qvel, qacc)
    return PlatformSignals(pose=pose, twist=twist, acceleration=along, angular_acceleration=qacc[:, 3:6])


def imu_motion(resolved: Resolved, instant: PlatformSignals, omega: Array) -> tuple[Array, Array]:
    """Accelerations (m, 3) that the IMU feels where it is mounted: R' (a + alpha x r + omega x (omega x r)) and R' alpha.

    omega (m, 3) [rad/s] in the platform frame.
    """
    imu = resolved.sensors
    rotation = turned(resolved.imu_turn_rad) @ mounting(imu.imu_orientation_deg)
    place = resolved.imu_place_m + np.array(imu.imu_position_m)
    return imu_reading(instant.acceleration, instant.angular_acceleration, omega, place, rotation)


def turned(vector_rad: Array) -> Array:
    """Matrix (3, 3) of a turn about a vector (3,) by its length."""
    quaternion, matrix = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(9)
    mujoco.mju_quatIntegrate(quaternion, np.asarray(vector_rad, dtype=float), 1.0)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


@compiled
def _void_rows(rows, which, y, states, is_top, out):
    """Fill out (m, n): volume of vapour [m3] in bottom chambers or rod sides in these states (m, n) [Pa]."""
    for k in range(y.shape[0]):
        for i in range(y.shape[1]):
            if states[k, i] < chamber.VAPOUR:
                p = rows[which[k], i]
                if is_top:
                    room = rod_side.capacity(p, y[k, i], chamber.VAPOUR)
                else:
                    room = leg.chamber_capacity(p, y[k, i], chamber.VAPOUR)
                out[k, i] = chamber.void(states[k, i], room)


def voids(plant: Plant, time: Array, positions: Array, act: Array) -> dict[str, tuple[Array, float]]:
    """Volumes of oil that cavitated: name -> (volume of vapour (m,) [m3], area of the piston that pulls it [m2] or 0)."""
    rows, supplies, which = versions(plant, time)
    found, tops = {}, plant.rod_side_places
    chambers = [("bottom chamber", plant.pressure_places, P.AREA_BOTTOM), ("rod side", np.maximum(tops, 0), P.AREA_TOP)]
    for name, at, area in chambers:
        out, is_top = np.zeros(positions.shape), area == P.AREA_TOP
        _void_rows(rows, which, positions, act[:, at] * MPa, is_top, out)
        for i in np.flatnonzero(out.any(axis=0) & ((tops >= 0) | (not is_top))):
            found[f"leg {i + 1}, {name}," if plant.n_legs > 1 else name] = out[:, i], float(plant.rows[i, area])
    if plant.has_supply_states:
        last, s = int(plant.layout[-1, A.PRESSURE]), supplies[-1]
        capacities = {"the supply line": (last, supply.line_capacity)}
        if s[S.MODEL] == POWER_UNIT:
            pump = int(plant.layout[-1, A.SUPPLY]) + U.PUMP_PRESSURE
            capacities = {
                "the manifold": (last, supply.manifold_capacity),
                "the pump side": (pump, supply.pump_side_capacity),
            }
        for name, (at, capacity) in capacities.items():
            void = np.maximum(chamber.VAPOUR - act[:, at] * MPa, 0.0) * capacity(s, chamber.VAPOUR)
            if void.any():
                found[name] = void, 0.0
    return found


# Columns of a power unit. Flows and powers of all legs together.
POWER_UNIT_COLUMNS = (
    "motor_speed",
    "pump_flow_m3_s",
    "line_flow_m3_s",
    "pump_pressure_Pa",
    "oil_temperature_degC",
    "relief_flow_m3_s",
    "accumulator_oil_m3",
    "accumulator_energy_J",
    "supply_demand_m3_s",
    "motor_power_W",
    "heat_W",
    "platform_power_W",
)


@compiled
def _power_unit_rows(supplies, rows, layout, h, which, act, y, v, volts, time, out):
    """Fill out (12, m), in the order of POWER_UNIT_COLUMNS. h (m,): time step."""
    _, n, width = rows.shape
    for k in range(y.shape[0]):
        s, states = (
            offset(pointer_to(supplies), which[k] * supplies.shape[1]),
            offset(pointer_to(act), k * act.shape[1]),
        )
        places = offset(pointer_to(layout), (layout.shape[0] - 1) * layout.shape[1])
        speed, flow, line_flow, pump_pressure, temperature, pressure = supply_state(places, states)
        demand, work = supply.burst_flow(s, pressure), 0.0
        heat = supply.power_unit_heat(s, speed, line_flow, pump_pressure, pressure)
        for i in range(n):
            p = offset(pointer_to(rows), (which[k] * n + i) * width)
            places = offset(pointer_to(layout), i * layout.shape[1])
            Ps = supply_pressure(p, places, states)
            P1, P2, place, _, z = leg_state(places, states, Ps)
            s2 = chamber_state(places, states, Ps)[1]
            x, memory = leg.metering_spool(p, volts[k, i], time[k], place), memory_of(places, states)
            inflow = leg.inflow_bottom(p, y[k, i], v[k, i], volts[k, i], x, P1, P2, Ps, time[k], memory)
            asked = leg.supply_demand_in_step(p, y[k, i], v[k, i], x, P1, s2, Ps, h[k])
            demand += asked
            heat += leg.heat(p, y[k, i], v[k, i], x, P1, s2, Ps, z, inflow, asked, h[k], time[k])
            friction = leg.friction_force(p, y[k, i], v[k, i], P1, z, P2, time[k])
            force = P1 * p[P.AREA_BOTTOM] - P2 * p[P.AREA_TOP] - friction
            work += force * v[k, i]
        out[0, k], out[1, k], out[2, k], out[3, k], out[4, k] = speed, flow, line_flow, pump_pressure, temperature
        out[5, k] = supply.relief_flow(s, pump_pressure)
        out[6, k] = supply.accumulator_oil(s, pump_pressure)
        out[7, k] = supply.accumulator_energy(s, pump_pressure)
        out[8, k] = demand
        out[9, k] = supply.motor_power(s, speed, flow, pump_pressure)
        out[10, k] = heat
        out[11, k] = work


def power_unit_signals(
    plant: Plant, time: Array, qpos: Array, qvel: Array, act: Array, volts: Array, timestep: Array
) -> dict[str, Array]:
    """Signals (m,) of the power unit by POWER_UNIT_COLUMNS; empty without one. timestep (m,) [s].

    heat_W: all that goes into the oil, friction of the cylinders too. platform_power_W: hydraulic forces less friction
    times piston velocities.
    """
    if plant.resolved.supply[S.MODEL] != POWER_UNIT:
        return {}
    y, v = leg_motion(plant, qpos, qvel)
    out = np.empty((len(POWER_UNIT_COLUMNS), len(y)))
    rows, supplies, which = versions(plant, time)
    arrays = (supplies, rows, plant.layout, timestep, which, act, y, v, volts, time)
    _power_unit_rows(*map(np.ascontiguousarray, arrays), out)
    return dict(zip(POWER_UNIT_COLUMNS, out, strict=True))
