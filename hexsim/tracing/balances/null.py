"""What the violations of the balances are when nothing is missing: the refitted machine simulated, with sensor noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.channels import SETTLE_S
from hexsim.signals.log import MeasuredLog
from hexsim.tracing.balances import Balance

Array = np.ndarray
END_S = 0.05  # [s] at the end of a run that windows do not see whole


def with_noise(log: MeasuredLog, noise: dict[str, float], resolution: float, rng: np.random.Generator) -> MeasuredLog:
    """White noise on every channel; the position is rounded as its transducer rounds."""

    def noisy(rows: Array | None, kind: str) -> Array | None:
        return None if rows is None else rows + noise[kind] * rng.standard_normal(rows.shape)

    position = noisy(log.position, "position_m")
    if resolution > 0:
        sharp = np.sqrt(max(noise["position_m"] ** 2 - resolution**2 / 12, 0.0))
        position = resolution * np.round((log.position + sharp * rng.standard_normal(log.position.shape)) / resolution)
    return replace(
        log,
        position=position,
        pressure=noisy(log.pressure, "pressure_bottom_Pa"),
        supply=noisy(log.supply, "pressure_supply_Pa"),
        acceleration=noisy(log.acceleration, "acceleration_m_s2"),
        angular=noisy(log.angular, "angular_acceleration_rad_s2"),
    )


def used(log: MeasuredLog, residual: Array) -> Array:
    """The samples of a residual that count."""
    return residual[..., int((SETTLE_S + 0.1) * log.rate) : log.n - int(END_S * log.rate)]


def null_rms(
    balance: Balance, quiet: Sequence[MeasuredLog], machine: Machine, noise: dict[str, float], seeds: int
) -> tuple[Array, Array]:
    """(sigma, rms of each seed) of a balance, (n_places,) and (seeds, n_places), over all logs together.

    sigma: what noise alone does, the noise-free residual (reversals, sampling) taken out.
    """
    resolution = machine.sensors.position_resolution_m
    clean = [used(log, balance.residual(log, machine)) for log in quiet]
    count = sum(c.shape[-1] for c in clean)
    total, apart = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        noisy = [used(log, balance.residual(with_noise(log, noise, resolution, rng), machine)) for log in quiet]
        total.append(np.sqrt(sum(np.sum(r**2, axis=-1) for r in noisy) / count))
        apart.append(sum(np.sum((r - c) ** 2, axis=-1) for r, c in zip(noisy, clean, strict=True)) / count)
    return np.sqrt(np.mean(apart, axis=0)), np.stack(total)
