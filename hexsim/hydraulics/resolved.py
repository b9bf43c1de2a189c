"""The numbers of a machine that effects may change, ready for the plant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hexsim.declaration import Load, Machine, Sensors
from hexsim.mechanics.mechanics import Mechanics


@dataclass(kw_only=True)
class PayloadMode:
    """A mass on a spring and damper that rides on the platform along one axis (flexible or sloshing payload)."""

    mass_kg: float
    frequency_Hz: float
    damping_ratio: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.5)


@dataclass(kw_only=True)
class Resolved:
    """What effects may change, ready for the plant.

    rows: (n_legs, N_PARAMETERS) hydraulics; supply: (N_SUPPLY,); load and sensors as declared or changed;
    gravity_m_s2: (3,) in the world frame; leg_sensors: per-leg gains, offsets and delays, name -> (n_legs,).
    loop_gain, loop_delay_ticks (n_legs,): of the controllers as they run, against the declared ones.
    mechanics: legs as they are built; the motion computer has those of the machine file.
    imu_turn_rad, imu_place_m (3,): how the accelerometers are turned (rotation vector) and shifted against [sensors].
    position_ripple (n_legs, 3): amplitude and pitch [m], phase [rad] of the position transducers' scales.
    oil_temperature_degC: temperature for which rows and supply hold (only a power unit changes it).
    """

    machine: Machine
    rows: np.ndarray
    supply: np.ndarray
    load: Load
    sensors: Sensors
    gravity_m_s2: np.ndarray
    mechanics: Mechanics
    payload_modes: list[PayloadMode] = field(default_factory=list)
    leg_sensors: dict[str, np.ndarray] = field(default_factory=dict)
    loop_gain: np.ndarray = field(init=False)
    loop_delay_ticks: np.ndarray = field(init=False)
    position_ripple: np.ndarray = field(init=False)
    oil_temperature_degC: float = 35.0
    imu_turn_rad: np.ndarray = field(default_factory=lambda: np.zeros(3))
    imu_place_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        self.loop_gain, self.loop_delay_ticks = np.ones(len(self.rows)), np.zeros(len(self.rows))
        self.position_ripple = np.tile([0.0, 1e-3, 0.0], (len(self.rows), 1))
