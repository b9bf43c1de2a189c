"""The sensors of a machine in a run: gain, offset, delay, white noise and quantisation, drawn from a seed before the run.

The same function measures one tick for the motion computer and a whole column for the log, so the log holds what the
motion computer saw.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics.resolved import Resolved
from hexsim.signals.sensor import ERRORS, Sensor
from hexsim.signals.table import STANDARD, sensors

Array = NDArray[np.float64]


@compiled
def measure(true, noise, gain, offset, resolution):
    """One measurement of each channel (n,)."""
    out = np.empty(true.shape[0])
    for i in range(true.shape[0]):
        value = gain[i] * true[i] + offset[i] + noise[i]
        out[i] = np.rint(value / resolution[i]) * resolution[i] if resolution[i] > 0.0 else value
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


class Transducers:
    """All transducers of one sensor: errors (n,), a place for each leg or axis, and noise (ticks, n)."""

    def __init__(
        self, sensor: Sensor, resolved: Resolved, ticks: int, tick_s: float, random: np.random.Generator
    ) -> None:
        n = len(sensor.signal.columns(resolved.machine.n_legs))
        errors = {error: np.full(n, value) for error, value in _errors(sensor, resolved).items()}
        self.tick_s = tick_s
        self.gain, self.offset, self.delay = errors["gain"], errors["offset"], errors["delay"]
        self.resolution = errors["resolution"]
        self.noise = errors["noise"] * random.standard_normal((ticks, n))

    def at(self, tick: int, history: Array) -> Array:
        """What they read (n,) at a tick, from the true values so far (tick + 1, n)."""
        true = history[tick]
        if self.delay.any():
            places = np.maximum(tick - self.delay / self.tick_s, 0.0)
            low = places.astype(int)
            share, columns = places - low, np.arange(history.shape[1])
            true = (1 - share) * history[low, columns] + share * history[np.minimum(low + 1, tick), columns]
        return self.read(true, tick)

    def read(self, true: Array, tick: int) -> Array:
        """The same without a delay; noise of that tick."""
        return measure(true, self.noise[tick], self.gain, self.offset, self.resolution)

    def rows(self, true: Array) -> Array:
        """What they read in a whole run (m, n)."""
        true = delayed(true, self.delay, self.tick_s)
        return measure_rows(true, self.noise[: len(true)], self.gain, self.offset, self.resolution)


def _errors(sensor: Sensor, resolved: Resolved) -> dict[str, Array | float]:
    """Error -> its value for all transducers or each of them, as declared or as an effect changed it."""
    found: dict[str, Array | float] = dict(ERRORS)
    extra = resolved.machine.extra_sensors.get(sensor.signal.stem, {})
    for error in ERRORS:
        if key := getattr(sensor, error):
            shared = getattr(resolved.sensors, key, ERRORS[error])
            found[error] = resolved.leg_sensors.get(key, shared) if sensor.signal.scope == "leg" else shared
        elif (key := sensor.extra_keys[error]) in extra:
            found[error] = extra[key]
    return found


class SensorBank:
    """All sensors of a machine for a run of `ticks` ticks of `tick_s`, with noise drawn from `seed`.

    `bank["position"]` are the transducers of that signal. The standard sensors draw from one stream of random numbers,
    each other one from its own.
    """

    def __init__(self, resolved: Resolved, ticks: int, tick_s: float, seed: int) -> None:
        self.tick_s, self.resolved, self.seed = tick_s, resolved, seed
        random = np.random.default_rng(seed)
        self._standard = {stem: Transducers(sensors()[stem], resolved, ticks, tick_s, random) for stem in STANDARD}

    def __getitem__(self, stem: str) -> Transducers:
        return self._standard[stem]

    def position(self, tick: int, history: Array) -> Array:
        """Measured piston positions (n,) at a tick, from the true ones so far (tick + 1, n)."""
        return self["position"].at(tick, history)

    def pressure(self, tick: int, history: Array) -> Array:
        """Measured chamber pressures (n,) [Pa] at a tick."""
        return self["pressure_bottom"].at(tick, history)

    def supply(self, tick: int, true: float) -> float:
        """Measured supply pressure [Pa]."""
        return float(self["pressure_supply"].read(np.array([true]), tick)[0])

    def rows(self, stem: str, true: Array) -> Array:
        """What a standard sensor reads in a whole run (m, n)."""
        return self[stem].rows(true)

    def extra(self, truth: Mapping[str, Array], log_s: float) -> dict[str, Array]:
        """Stem -> readings (m, n) of the machine's other sensors at the log's rows, `log_s` apart, from the true signals."""
        read = {}
        machine = self.resolved.machine
        of_rod_side = ("pressure_top",) if machine.cylinder.rod_side == "valve" else ()
        for stem in (*of_rod_side, *machine.extra_sensors):
            sensor = sensors()[stem]
            if sensor.source in truth:
                true = truth[sensor.source]
                random = np.random.default_rng([self.seed, zlib.crc32(stem.encode())])
                read[stem] = Transducers(sensor, self.resolved, len(true), log_s, random).rows(true)
        return read
