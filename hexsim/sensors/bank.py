"""Sensors: gain, offset, delay, white noise and quantisation, drawn from a seed before the run.

    measured = round((g s(t - T) + b + n) / q) q          g gain, b offset, T delay, n noise, q resolution (0 = none)

The same function measures one tick for the motion computer and a whole column for the log, so the log holds what the
motion computer saw.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics.resolved import Resolved

Array = NDArray[np.float64]


@compiled
def measure(true, noise, gain, offset, resolution):
    """One measurement of each channel (n,)."""
    out = np.empty(true.shape[0])
    for i in range(true.shape[0]):
        value = gain[i] * true[i] + offset[i] + noise[i]
        out[i] = np.rint(value / resolution) * resolution if resolution > 0.0 else value
    return out


@compiled
def measure_rows(true, noise, gain, offset, resolution):
    """Measurements of all rows (m, n)."""
    out = np.empty_like(true)
    for k in range(true.shape[0]):
        out[k] = measure(true[k], noise[k], gain, offset, resolution)
    return out


def delayed(values: Array, delay_s: Array, tick_s: float) -> Array:
    """Rows (m, n) as a sensor with delay (n,) [s] sees them, linear between ticks; the first row is held before the start."""
    if not np.any(delay_s):
        return values
    ticks = np.arange(len(values))
    columns = [
        np.interp(ticks - delay / tick_s, ticks, column) for column, delay in zip(values.T, delay_s, strict=True)
    ]
    return np.column_stack(columns)


class SensorBank:
    """All sensors of a machine for a run of `ticks` ticks of `tick_s`, with noise drawn from `seed`."""

    def __init__(self, resolved: Resolved, ticks: int, tick_s: float, seed: int) -> None:
        sensors, n = resolved.sensors, resolved.machine.n_legs
        self.tick_s = tick_s
        random = np.random.default_rng(seed)
        legs = resolved.leg_sensors
        self.position_gain, self.position_offset = legs["position_gain"], legs["position_offset_m"]
        self.pressure_gain, self.pressure_offset = legs["pressure_gain"], legs["pressure_offset_Pa"]
        self.position_delay, self.pressure_delay = legs["position_delay_s"], legs["pressure_delay_s"]
        self.position_resolution = sensors.position_resolution_m
        self.pressure_resolution = sensors.pressure_resolution_Pa
        self.position_noise = sensors.position_noise_m * random.standard_normal((ticks, n))
        self.pressure_noise = sensors.pressure_noise_Pa * random.standard_normal((ticks, n))
        self.supply_noise = sensors.pressure_noise_Pa * random.standard_normal((ticks, 1))
        self.supply_gain = np.array([sensors.supply_pressure_gain])
        axes = 3 if resolved.machine.is_hexapod else 1
        self.acceleration_noise = sensors.acceleration_noise_m_s2 * random.standard_normal((ticks, axes))
        self.acceleration_gain = np.full(axes, sensors.acceleration_gain)
        self.acceleration_offset = np.full(axes, sensors.acceleration_offset_m_s2)
        self.acceleration_delay = np.full(axes, sensors.acceleration_delay_s)
        self.acceleration_resolution = sensors.acceleration_resolution_m_s2
        self.angular_noise = sensors.angular_acceleration_noise_rad_s2 * random.standard_normal((ticks, 3))

    def position(self, tick: int, history: Array) -> Array:
        """Measured piston positions (n,) at a tick, from the true ones so far (tick + 1, n)."""
        true = self._at(tick, history, self.position_delay)
        return measure(
            true, self.position_noise[tick], self.position_gain, self.position_offset, self.position_resolution
        )

    def pressure(self, tick: int, history: Array) -> Array:
        """Measured bottom pressures (n,) [Pa] at a tick."""
        true = self._at(tick, history, self.pressure_delay)
        return measure(
            true, self.pressure_noise[tick], self.pressure_gain, self.pressure_offset, self.pressure_resolution
        )

    def supply(self, tick: int, true: float) -> float:
        """Measured supply pressure [Pa]."""
        value = self.supply_gain[0] * true + self.supply_noise[tick, 0]
        resolution = self.pressure_resolution
        return float(np.rint(value / resolution) * resolution if resolution > 0 else value)

    def _at(self, tick: int, history: Array, delay: Array) -> Array:
        if not delay.any():
            return history[tick]
        places = np.maximum(tick - delay / self.tick_s, 0.0)
        low = places.astype(int)
        share = places - low
        legs = np.arange(history.shape[1])
        return (1 - share) * history[low, legs] + share * history[np.minimum(low + 1, tick), legs]

    def positions(self, true: Array) -> Array:
        """Measured positions of a whole run (m, n)."""
        rows = slice(0, len(true))
        true = delayed(true, self.position_delay, self.tick_s)
        return measure_rows(
            true, self.position_noise[rows], self.position_gain, self.position_offset, self.position_resolution
        )

    def pressures(self, true: Array) -> Array:
        """Measured bottom pressures of a whole run (m, n) [Pa]."""
        rows = slice(0, len(true))
        true = delayed(true, self.pressure_delay, self.tick_s)
        return measure_rows(
            true, self.pressure_noise[rows], self.pressure_gain, self.pressure_offset, self.pressure_resolution
        )

    def supplies(self, true: Array) -> Array:
        """Measured supply pressure of a whole run (m,) [Pa]."""
        rows = slice(0, len(true))
        return measure_rows(
            true[:, None], self.supply_noise[rows], self.supply_gain, np.zeros(1), self.pressure_resolution
        )[:, 0]

    def accelerations(self, true: Array) -> Array:
        """Measured linear accelerations (m, 1 or 3)."""
        rows = slice(0, len(true))
        true = delayed(true, self.acceleration_delay, self.tick_s)
        return measure_rows(
            true,
            self.acceleration_noise[rows],
            self.acceleration_gain,
            self.acceleration_offset,
            self.acceleration_resolution,
        )

    def angular_accelerations(self, true: Array) -> Array:
        """Measured angular accelerations (m, 3)."""
        true = delayed(true, np.full(3, self.acceleration_delay[0]), self.tick_s)
        return true + self.angular_noise[: len(true)]
