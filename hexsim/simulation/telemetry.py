"""The telemetry that a served machine sends: its sensors' readings at the log rate, a few rows a packet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.motion_computer.telemetry import MOST_ROWS, Telemetry, width
from hexsim.plant import Plant
from hexsim.plant.readout import platform_signals
from hexsim.simulation.live_sensors import LiveSensors, Readings

Array = NDArray[np.float64]


class TelemetryRows:
    """Collects rows of a plant whose sensors are read `rate_Hz` times a second, and packs them."""

    def __init__(self, plant: Plant, sensors: LiveSensors, rate_Hz: float) -> None:
        self.plant, self.sensors, self.rate_Hz = plant, sensors, rate_Hz
        self.sequence, self._first_s = 0, 0.0
        self._rows: list[Array] = []

    def add(self, time_s: float, tick: int, setpoint: Array, readings: Readings, volts: Array) -> None:
        """One row. setpoint, volts (n_legs,); readings: of this tick."""
        if not self._rows:
            self._first_s = time_s
        position, pressure, supply, top = readings
        rod_side = np.full(self.plant.n_legs, np.nan) if top is None else top
        row = np.concatenate([setpoint, position, pressure, rod_side, volts, [supply], *self._accelerations(tick)])
        self._rows.append(row)

    def _accelerations(self, tick: int) -> tuple[Array, Array]:
        """Linear and angular readings (3,) each."""
        plant, k, bank = self.plant, tick % self.sensors.noise_ticks, self.sensors.bank
        acceleration = plant.instant_acceleration()
        if not plant.machine.is_hexapod:
            return np.array([bank["acceleration"].next(acceleration[:1], k)[0], np.nan, np.nan]), np.full(3, np.nan)
        data = plant.data
        true = platform_signals(plant, data.qpos[None], data.qvel[None], acceleration[None])
        linear = bank["acceleration"].next(true.acceleration[0], k)
        return linear, bank["angular_acceleration"].next(true.angular_acceleration[0], k)

    def packets(self, rest: bool = False) -> list[bytes]:
        """Packets of full size that are due; with `rest` all that is left."""
        due = []
        while len(self._rows) >= MOST_ROWS or (rest and self._rows):
            rows, self._rows = np.array(self._rows[:MOST_ROWS]), self._rows[MOST_ROWS:]
            packet = Telemetry(
                n_legs=self.plant.n_legs, sequence=self.sequence, time_s=self._first_s, rate_Hz=self.rate_Hz, rows=rows
            )
            assert rows.shape[1] == width(self.plant.n_legs)
            due.append(packet.pack())
            self.sequence += 1
            self._first_s += len(rows) / self.rate_Hz
        return due
