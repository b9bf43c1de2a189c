"""The sensors of a machine in a run: gain, offset, delay, lag, filter, white noise and quantisation, drawn from a seed before it.

A filter is a Butterworth low-pass of the declared order and cut-off, by the bilinear rule at the rate of the ticks. The same
function measures one tick for the motion computer and a whole column for the log, so the log holds what the
motion computer saw.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.compiled import allocating, compiled
from hexsim.errors import HexsimError
from hexsim.hydraulics.resolved import Resolved
from hexsim.signals.lag import lagged
from hexsim.signals.ripple import rippled
from hexsim.signals.sensor import ERRORS, Sensor
from hexsim.signals.table import STANDARD, sensors

Array = NDArray[np.float64]


@compiled
def reading(true, noise, gain, offset, resolution):
    """One measurement of one channel."""
    value = gain * true + offset + noise
    return np.rint(value / resolution) * resolution if resolution > 0.0 else value


@allocating
def measure(true, noise, gain, offset, resolution):
    """One measurement of each channel (n,)."""
    out = np.empty(true.shape[0])
    for i in range(true.shape[0]):
        out[i] = reading(true[i], noise[i], gain[i], offset[i], resolution[i])
    return out


@allocating
def measure_rows(true, noise, gain, offset, resolution):
    """Measurements of all rows (m, n)."""
    out = np.empty_like(true)
    for k in range(true.shape[0]):
        for i in range(true.shape[1]):
            out[k, i] = reading(true[k, i], noise[k, i], gain[i], offset[i], resolution[i])
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


def noise_of_ticks(
    ticks: int,
    n: int,
    tick_s: float,
    random: np.random.Generator,
    rate_Hz: float = 1000.0,  # independent readings a second: [sensors] declares noises for a log at 1 kHz
) -> Array:
    """Noise (ticks, n) of standard deviation 1: white up to half of `rate_Hz`, whatever the ticks.

    Slower ticks sample it, faster ones read the same value again: raising the rate of a log or of a controller takes no
    noise out of the band in which people feel.
    """
    which = (np.arange(ticks) * min(1.0, rate_Hz * tick_s) + 1e-9).astype(int)
    return random.standard_normal((int(which[-1]) + 1 if ticks else 0, n))[which]


class Transducers:
    """All transducers of one sensor: errors (n,), a place for each leg or axis, and noise (ticks, n)."""

    def __init__(
        self, sensor: Sensor, resolved: Resolved, ticks: int, tick_s: float, random: np.random.Generator
    ) -> None:
        n = len(sensor.signal.columns(resolved.machine.n_legs))
        errors = {error: np.full(n, value) for error, value in _errors(sensor, resolved).items()}
        self.tick_s = tick_s
        self.gain, self.offset, self.delay = errors["gain"], errors["offset"], errors["delay"]
        self.lag = errors["lag"]
        self.resolution = errors["resolution"]
        self.noise = errors["noise"] * noise_of_ticks(ticks, n, tick_s, random)
        self.sections = low_pass(sensor, resolved, tick_s)
        self.ripple = getattr(resolved, sensor.ripple).T.copy() if sensor.ripple else np.zeros((3, n))
        self._memory: list[Array] = []  # of lag and filter
        self._next = 0  # tick that the filter has not seen yet

    @cached_property
    def is_direct(self) -> bool:
        """Whether they read the present value, without delay, lag, filter or ripple."""
        return not (self.delay.any() or self.smooths or self.ripple[0].any())

    @property
    def smooths(self) -> bool:
        """Whether the past acts on, through a lag or a filter."""
        return self.sections is not None or bool(self.lag.any())

    def at(self, tick: int, history: Array) -> Array:
        """What they read (n,) at a tick, from the true values so far (tick + 1, n). Ticks in rising order."""
        if self.is_direct:
            return measure(history[tick], self.noise[tick], self.gain, self.offset, self.resolution)
        first = self._next if self.smooths else tick
        true = history[first : tick + 1]
        if self.delay.any():
            places = np.maximum(np.arange(first, tick + 1)[:, None] - self.delay / self.tick_s, 0.0)
            low = places.astype(int)
            share, columns = places - low, np.arange(history.shape[1])
            true = (1 - share) * history[low, columns] + share * history[np.minimum(low + 1, tick), columns]
        self._next = tick + 1
        return self.read(self.filtered(true)[-1], tick)

    def restart(self) -> None:
        """Forget what lag and filter have seen."""
        self._memory, self._next = [], 0

    def filtered(self, rows: Array) -> Array:
        """The next true rows (m, n) behind scale, lag and filter, which begin at rest at the first row of all."""
        return self._through(rows, self._memory)

    def _through(self, rows: Array, memory: list[Array]) -> Array:
        """Rows of ticks behind scale, lag and filter. memory: empty before the first row; it is brought up to date."""
        if self.ripple[0].any():
            rows = rippled(rows, *self.ripple)
        if not self.smooths:
            return rows
        rest = np.zeros((0, 2, 1)) if self.sections is None else scipy.signal.sosfilt_zi(self.sections)[:, :, None]
        memory[:] = memory or [np.tile(rows[0], (2, 1)), rest * rows[0]]
        out = rows.copy()
        lagged(out, self.lag, self.tick_s, memory[0])
        if self.sections is not None:
            out, memory[1] = scipy.signal.sosfilt(self.sections, out, axis=0, zi=memory[1])
        return out

    def read(self, true: Array, tick: int) -> Array:
        """The same without delay, ripple, lag and filter; noise of that tick."""
        return measure(true, self.noise[tick], self.gain, self.offset, self.resolution)

    def next(self, true: Array, tick: int) -> Array:
        """What they read of the next true values (n,), without delay; noise of that tick."""
        return self.read(self.filtered(true[None])[0], tick)

    def rows(self, true: Array) -> Array:
        """What they read in a whole run (m, n), tick by tick."""
        true = self._through(delayed(true, self.delay, self.tick_s), [])
        return measure_rows(true, self.noise[: len(true)], self.gain, self.offset, self.resolution)


def low_pass(sensor: Sensor, resolved: Resolved, tick_s: float) -> Array | None:
    """Second-order sections of the transducer's filter, None without one."""
    cut_off = getattr(resolved.sensors, f"{sensor.filter}_Hz") if sensor.filter else 0.0
    if cut_off <= 0.0:
        return None
    if cut_off * tick_s >= 0.5:
        raise HexsimError(
            f"sensors.{sensor.filter}_Hz = {cut_off:g} must be below half of the rate of {1 / tick_s:g} Hz at which "
            "the transducer is read: lower it, or raise sensors.log_rate_Hz"
        )
    order = getattr(resolved.sensors, f"{sensor.filter}_order")
    return np.asarray(scipy.signal.butter(order, cut_off, fs=1.0 / tick_s, output="sos"))


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
        if resolved.machine.cylinder.rod_side == "valve":
            stem = "pressure_top"
            self._standard[stem] = Transducers(sensors()[stem], resolved, ticks, tick_s, self._own_random(stem))

    def _own_random(self, stem: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(stem.encode())])

    def __getitem__(self, stem: str) -> Transducers:
        return self._standard[stem]

    def position(self, tick: int, history: Array) -> Array:
        """Measured piston positions (n,) at a tick, from the true ones so far (tick + 1, n)."""
        return self["position"].at(tick, history)

    def pressure(self, tick: int, history: Array) -> Array:
        """Measured chamber pressures (n,) [Pa] at a tick."""
        return self["pressure_bottom"].at(tick, history)

    def pressure_top(self, tick: int, history: Array) -> Array | None:
        """Measured pressures (n,) [Pa] of rod sides on a valve at a tick; None where there are none."""
        return self["pressure_top"].at(tick, history) if "pressure_top" in self._standard else None

    def supply(self, tick: int, true: float) -> float:
        """Measured supply pressure [Pa]."""
        return float(self["pressure_supply"].read(np.array([true]), tick)[0])

    def rows(self, stem: str, true: Array) -> Array:
        """What a standard sensor reads in a whole run (m, n)."""
        return self[stem].rows(true)

    def extra(self, truth: Mapping[str, Array]) -> dict[str, Array]:
        """Stem -> readings (m, n) of the machine's other sensors, tick by tick, from the true signals."""
        read = {}
        if "pressure_top" in self._standard:
            read["pressure_top"] = self["pressure_top"].rows(truth["true_pressure_top"])
        for stem in self.resolved.machine.extra_sensors:
            sensor = sensors()[stem]
            if sensor.source in truth:
                true = truth[sensor.source]
                read[stem] = Transducers(sensor, self.resolved, len(true), self.tick_s, self._own_random(stem)).rows(
                    true
                )
        return read
