"""A machine as the numbers of the compiled simulation: legs, load, sensors, controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import S
from hexsim.machine.geometry import machine_kinematics, platform_body, suspension
from hexsim.mechanics.rigid_body import RigidBody, Suspension, mass_matrix

Array = np.ndarray
STEP_S = 1.7e-4  # [s] integration step; RK4 needs step * (F_c + F_s)/(v_s m) < 2.7. Error: 0.013 of the sensors' noise


class Load(NamedTuple):
    """What the legs carry: a mass on the axis of one leg, or a rigid platform on six.

    compliance (6, 6): inverse mass matrix of a platform.  base, joints (6, 3) [m], retracted (6,) [m]: its legs; empty for
    a mass on an axis.
    """

    body: RigidBody
    compliance: Array
    gravity: Array
    suspension: Suspension
    base: Array
    joints: Array
    retracted: Array


class Sensors(NamedTuple):
    """y_m = gain y(t - delay) + offset. Positions and pressures (n_legs,), accelerations (n_axes,); delays [s]."""

    position_gain: Array
    position_offset: Array
    position_delay: Array
    pressure_gain: Array
    pressure_offset: Array
    pressure_delay: Array
    supply_gain: float
    acceleration_gain: Array
    acceleration_offset: Array
    acceleration_delay: float


class Controller(NamedTuple):
    """u = K (s - y_m) every 1/rate_Hz, at most limit_V. follows: the logged volts, held to the logged position, instead."""

    gain_V_per_m: float
    rate_Hz: float
    limit_V: float
    follows: bool


class Rig(NamedTuple):
    """Everything that the compiled simulation knows of a machine. legs (n_legs, N_PARAMETERS), supply (N_SUPPLY,)."""

    legs: Array
    supply: Array
    load: Load
    sensors: Sensors
    controller: Controller


def rig_of(machine: Machine, feedback: int = 0) -> tuple[Rig, Resolved]:
    """The machine's numbers. feedback: 0 the declared position loop, 1 the logged volts."""
    resolved, controller = resolve(machine), machine.controller
    legs = resolved.rows
    legs[:, P.ACT_BRISTLE] = np.where(legs[:, P.BRISTLE_STIFFNESS] > 0.0, 0.0, -1.0)
    rig = Rig(
        legs=legs,
        supply=resolved.supply,
        load=load_of(resolved),
        sensors=sensors_of(resolved),
        controller=Controller(
            controller.gain_V_per_m, float(controller.rate_Hz), machine.valve.voltage_max_V, bool(feedback)
        ),
    )
    return rig, resolved


def load_of(resolved: Resolved) -> Load:
    """Bodies and joints; of payloads on springs the first."""
    modes = resolved.payload_modes
    spring = suspension(modes[0]) if modes else Suspension(0.0, 0.0, 0.0)
    if resolved.machine.geometry is None:
        mass = float(resolved.load.moving_mass_kg or 0.0)
        body = RigidBody(mass, mass, spring.mass, np.zeros(3), np.zeros((3, 3)))
        none = np.empty((0, 3))
        return Load(body, np.empty((0, 0)), resolved.gravity_m_s2, spring, none, none, np.zeros(1))
    kinematics = machine_kinematics(resolved.machine)
    body = platform_body(resolved, kinematics)
    return Load(
        body=body,
        compliance=np.linalg.inv(mass_matrix(body)),
        gravity=resolved.gravity_m_s2,
        suspension=spring,
        base=kinematics.base_joints,
        joints=kinematics.platform_joints,
        retracted=np.asarray(kinematics.retracted_length_m),
    )


def sensors_of(resolved: Resolved) -> Sensors:
    """Gains, offsets and delays. The accelerometers of a platform: x, y, z and the three angular ones, which have no gain."""
    legs, shared = resolved.leg_sensors, resolved.sensors
    gain, offset = shared.acceleration_gain, shared.acceleration_offset_m_s2
    one = resolved.machine.geometry is None
    return Sensors(
        position_gain=legs["position_gain"],
        position_offset=legs["position_offset_m"],
        position_delay=legs["position_delay_s"],
        pressure_gain=legs["pressure_gain"],
        pressure_offset=legs["pressure_offset_Pa"],
        pressure_delay=legs["pressure_delay_s"],
        supply_gain=float(shared.supply_pressure_gain),
        acceleration_gain=np.array([gain] if one else [gain, gain, gain, 1.0, 1.0, 1.0], dtype=float),
        acceleration_offset=np.array([offset] if one else [0.0, 0.0, offset, 0.0, 0.0, 0.0], dtype=float),
        acceleration_delay=float(shared.acceleration_delay_s),
    )


def friction_step(legs: Array, pressure_Pa: float) -> Array:
    """Largest step of the friction [N] at a reversal, a row of legs: what makes it stiff."""
    level = np.maximum(legs[..., P.COULOMB_EXTEND], legs[..., P.COULOMB_RETRACT])
    level = level + np.maximum(legs[..., P.STATIC_EXTEND], legs[..., P.STATIC_RETRACT])
    return level + legs[..., P.SEAL_FRICTION] * pressure_Pa + np.abs(legs[..., P.RIPPLE_FORCE])


def substeps(rig: Rig, rate: float) -> int:
    """Steps a log sample: the friction's corner must stay stable on the mass of a leg, a twelfth of a platform's."""
    level = float(friction_step(rig.legs, rig.supply[S.PRESSURE]).max())
    alone = len(rig.legs) == 1
    stiffest = level / (rig.legs[:, P.SHARPNESS].min() * rig.load.body.mass / (1.0 if alone else 12.0))
    step = min(STEP_S if alone else 1.5 * STEP_S, 2.2 / max(stiffest, 1e-9))
    return int(np.ceil(1.0 / (rate * step) - 1e-9))
