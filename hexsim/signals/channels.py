"""Which measured signals a fit compares, and how noisy each is."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import MeasuredLog

Array = np.ndarray
KINDS = ("position_m", "pressure_bottom_Pa", "pressure_supply_Pa", "acceleration_m_s2", "angular_acceleration_rad_s2")
SETTLE_S = 0.3  # [s] at the start of a run that no fit looks at: the unknown initial pressure


def declared_noise(machine: Machine) -> dict[str, float]:
    """One standard deviation a sample, noise and quantisation together, by kind of channel; 0 where nothing is declared."""
    s = machine.sensors
    pressure = float(np.hypot(s.pressure_noise_Pa, s.pressure_resolution_Pa / np.sqrt(12)))
    return {
        "position_m": float(np.hypot(s.position_noise_m, s.position_resolution_m / np.sqrt(12))),
        "pressure_bottom_Pa": pressure,
        "pressure_supply_Pa": pressure,
        "acceleration_m_s2": float(np.hypot(s.acceleration_noise_m_s2, s.acceleration_resolution_m_s2 / np.sqrt(12))),
        "angular_acceleration_rad_s2": s.angular_acceleration_noise_rad_s2,
    }


def measured_noise(x: Array) -> float:
    """Standard deviation of white noise under a smooth signal: sixth differences, median over the samples."""
    d = np.diff(x, 6)
    return float(1.4826 * np.median(np.abs(d - np.median(d))) / np.sqrt(924.0))


def channel_arrays(log: MeasuredLog) -> dict[str, Array]:
    """The measured channels by name, hexapod legs numbered: position_1_m, ..."""
    found: dict[str, Array] = {}
    many = log.n_legs > 1
    for kind, rows in (("position_m", log.position), ("pressure_bottom_Pa", log.pressure)):
        if rows is None:
            continue
        stem, unit = kind.rsplit("_", 1)
        for i, row in enumerate(rows):
            found[f"{stem}_{i + 1}_{unit}" if many else kind] = row
    if log.supply is not None:
        found["pressure_supply_Pa"] = log.supply
    for stem, unit, rows in (
        ("acceleration", "m_s2", log.acceleration),
        ("angular_acceleration", "rad_s2", log.angular),
    ):
        if rows is not None:
            for axis, row in zip("xyz" if many else ("",), rows, strict=True):
                found[f"{stem}_{axis}_{unit}" if many else f"{stem}_{unit}"] = row
    return found


def kind_of(channel: str) -> str:
    """The kind of a channel's name: position_3_m -> position_m."""
    for kind in sorted(KINDS, key=len, reverse=True):
        stem = kind.split("_")[0] if not kind.startswith(("pressure", "angular")) else "_".join(kind.split("_")[:2])
        if channel.startswith(stem):
            return kind
    raise KeyError(channel)


def noise_of(machine: Machine, logs: list[MeasuredLog]) -> dict[str, float]:
    """Noise by kind: as declared, or measured from the logs where nothing is declared."""
    noise = declared_noise(machine)
    for kind, value in noise.items():
        if value <= 0:
            rows = [row for log in logs for name, row in channel_arrays(log).items() if kind_of(name) == kind]
            noise[kind] = max((measured_noise(row) for row in rows), default=0.0)
            scale = max((float(np.ptp(row)) for row in rows), default=0.0)
            noise[kind] = max(noise[kind], 1e-6 * scale, 1e-12)
    return noise
