"""What a fit compares: the channels of the standard sensors, and how noisy each is."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.signals.table import kind_of, sensors, table

__all__ = ["SETTLE_S", "channel_arrays", "declared_noise", "kind_of", "measured_noise", "noise_of"]
Array = np.ndarray
COMPARED = (
    "position",
    "pressure_bottom",
    "pressure_top",
    "pressure_difference",
    "pressure_supply",
    "acceleration",
    "angular_acceleration",
)
SETTLE_S = 0.3  # [s] at the start of a run that no fit looks at: the unknown initial pressure


def declared_noise(machine: Machine) -> dict[str, float]:
    """One standard deviation a sample, noise and quantisation together, by kind of channel; 0 where nothing is declared."""
    noise = {}
    for stem in COMPARED:
        sensor = sensors()[stem]
        resolution = getattr(machine.sensors, sensor.resolution) if sensor.resolution else 0.0
        noise[sensor.signal.kind] = float(np.hypot(getattr(machine.sensors, sensor.noise), resolution / np.sqrt(12)))
    return noise


def measured_noise(x: Array) -> float:
    """Standard deviation of white noise under a smooth signal: sixth differences, median over the samples."""
    d = np.diff(x, 6)
    return float(1.4826 * np.median(np.abs(d - np.median(d))) / np.sqrt(924.0))


def channel_arrays(log: Log) -> dict[str, Array]:
    """The compared channels by column, of signals that are there for all legs or axes."""
    found: dict[str, Array] = {}
    for stem in COMPARED:
        rows = log.signal(stem)
        if rows is not None:
            found |= zip(table()[stem].columns(log.n_legs), np.atleast_2d(rows), strict=True)
    return found


def noise_of(machine: Machine, logs: list[Log]) -> dict[str, float]:
    """Noise by kind: as declared, or measured from the logs where nothing is declared."""
    noise = declared_noise(machine)
    for kind, value in noise.items():
        if value <= 0:
            rows = [
                row[np.round(log.sampled.get(name, np.arange(log.n))).astype(int)]  # between samples it is smooth
                for log in logs
                for name, row in channel_arrays(log).items()
                if kind_of(name) == kind
            ]
            noise[kind] = max((measured_noise(row) for row in rows), default=0.0)
            scale = max((float(np.ptp(row)) for row in rows), default=0.0)
            noise[kind] = max(noise[kind], 1e-6 * scale, 1e-12)
    return noise
