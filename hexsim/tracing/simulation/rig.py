"""A machine as the numbers of the compiled simulation: legs, load, sensors, controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from hexsim.declaration import Machine
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.steps import StepRule, step_rule
from hexsim.machine.geometry import legs_beyond_body, moving_body, suspension
from hexsim.mechanics.rigid_body import RigidBody, Suspension, Vector, mass_matrix
from hexsim.sensors.bank import low_pass
from hexsim.signals.table import sensors

Array = np.ndarray
DECLARED_LOOP, LOGGED_VOLTS, OWN_TRANSDUCER = range(3)  # see `Controller`


class Load(NamedTuple):
    """What the legs carry: a mass on the axis of one leg, or a rigid platform on six; a payload on a spring.

    compliance: inverse mass matrix (6, 6) of a platform with its legs at neutral and the payload as it stands at rest.
    gravity: in the world [m/s2].
    """

    body: RigidBody
    compliance: Array
    gravity: Vector
    spring: Suspension


class Sensors(NamedTuple):
    """y_m = gain y(t - delay) + offset, behind a lag: rows (gain, offset, delay [s], lag [s]) of a leg, (n_legs, 4), and of an
    accelerometer; of a position three more, the ripple of its scale (`signals.ripple`).

    pressure: of the bottom chambers; top: of the rod sides.  filters: declared low-passes of position, pressures and linear
    accelerations as second-order sections (., 6), none where there are no rows.  imu_place [m], imu_rotation (3, 3): of the
    accelerometers in the platform frame.
    """

    position: Array
    pressure: Array
    top: Array
    acceleration: Array
    supply_gain: float
    filters: tuple[Array, Array, Array]
    imu_place: Vector
    imu_rotation: Array


class Controller(NamedTuple):
    """u = K (s - y_m) every 1/rate_Hz, at most limit_V, delay_ticks later, all (n_legs,).

    feedback: DECLARED_LOOP, on the position as the log shows it; LOGGED_VOLTS, held to the logged position, instead;
    OWN_TRANSDUCER, the declared loop on a transducer of its own, without the errors of the one that is logged.
    volts_share: of what logged volts quickly differ by from the loop's that acts, see `closed_loop`.
    """

    gain_V_per_m: Array
    delay_ticks: Array
    rate_Hz: float
    limit_V: Array
    feedback: int
    volts_share: float


class Rig(NamedTuple):
    """Everything that the compiled simulation knows of a machine.

    legs (n_legs, N_PARAMETERS).  geometry (n_legs, 7): base joint and platform joint (3 each), retracted length [m].
    supply (N_SUPPLY,).  rule: of the time step.
    """

    legs: Array
    geometry: Array
    supply: Array
    load: Load
    sensors: Sensors
    controller: Controller
    rule: StepRule


def rig_of(
    machine: Machine,
    feedback: int = DECLARED_LOOP,
    loaded: bool = False,
    rate_Hz: float = 1000.0,
    volts_share: float = 0.0,
) -> tuple[Rig, Resolved]:
    """The machine's numbers. feedback, volts_share: see `Controller`. loaded: with its additional mass.

    rate_Hz: of the samples.
    """
    resolved, controller = resolve(machine), machine.controller
    load, legs = load_of(resolved, loaded), resolved.mechanics
    rig = Rig(
        legs=resolved.rows,
        geometry=np.column_stack([legs.base_joints, legs.platform_joints, legs.retracted_length_m]),
        supply=resolved.supply,
        load=load,
        sensors=sensors_of(resolved, rate_Hz),
        controller=Controller(
            machine.of_legs("controller", "gain_V_per_m") * resolved.loop_gain,
            controller.computing_delay_ticks + resolved.loop_delay_ticks,
            float(controller.rate_Hz),
            machine.of_legs("valve", "voltage_max_V"),
            feedback,
            volts_share,
        ),
        rule=step_rule(resolved.rows, resolved.supply, leg_compliance(resolved, load), load.spring.omega),
    )
    return rig, resolved


def leg_compliance(resolved: Resolved, load: Load) -> Array:
    """Acceleration of each leg for a force on each, at mid stroke (n_legs, n_legs) [1/kg]: J M^-1 J'."""
    jacobian = resolved.mechanics.jacobian(np.zeros(6))
    return jacobian @ load.compliance @ jacobian.T


def load_of(resolved: Resolved, loaded: bool = False) -> Load:
    """Bodies; of payloads on springs the first."""
    modes = resolved.payload_modes
    spring = suspension(modes[0], resolved.gravity_m_s2) if modes else Suspension(0.0, 0.0, 0.0)
    body = moving_body(resolved, loaded)
    turns = any(body.inertia[0])
    matrix = mass_matrix(body, spring) + legs_beyond_body(resolved)
    compliance = np.linalg.inv(matrix) if turns else np.diag([1 / body.mass] * 3 + [0.0] * 3)
    x, y, z = (float(g) for g in resolved.gravity_m_s2)
    return Load(body=body, compliance=compliance, gravity=(x, y, z), spring=spring)


def filter_of(resolved: Resolved, stem: str, rate_Hz: float) -> Array:
    """Sections (., 6) of a sensor's low-pass; none where it is declared without, or above what samples can show."""
    fast = getattr(resolved.sensors, f"{sensors()[stem].filter}_Hz") >= 0.45 * rate_Hz
    sections = None if fast else low_pass(sensors()[stem], resolved, 1.0 / rate_Hz)
    return np.zeros((0, 6)) if sections is None else sections


def sensors_of(resolved: Resolved, rate_Hz: float) -> Sensors:
    """Gains, offsets, delays, lags, filters. Accelerometers of a platform: x, y, z and the three angular ones, without gain."""
    legs, shared = resolved.leg_sensors, resolved.sensors
    along = [shared.acceleration_gain, shared.acceleration_offset_m_s2, shared.acceleration_delay_s, 0.0]
    if resolved.machine.n_legs == 1:
        acceleration = np.array([along], dtype=float)
    else:
        across, turning = [along[0], 0.0, along[2], 0.0], [1.0, 0.0, along[2], 0.0]
        acceleration = np.array([across, across, along, turning, turning, turning], dtype=float)
    x, y, z = resolved.imu_place_m
    position, pressure = (
        np.column_stack([legs[f"{kind}_{key}"] for key in ("gain", f"offset_{unit}", "delay_s", "lag_s")])
        for kind, unit in (("position", "m"), ("pressure", "Pa"))
    )
    return Sensors(
        position=np.column_stack([position, resolved.position_ripple]),
        pressure=pressure,
        top=pressure,
        acceleration=acceleration,
        supply_gain=float(shared.supply_pressure_gain),
        filters=(
            filter_of(resolved, "position", rate_Hz),
            filter_of(resolved, "pressure_bottom", rate_Hz),
            filter_of(resolved, "acceleration", rate_Hz),
        ),
        imu_place=(float(x), float(y), float(z)),
        imu_rotation=Rotation.from_rotvec(resolved.imu_turn_rad).as_matrix(),
    )
