"""What the violations of the balances are when nothing is missing: the refitted machine simulated, with sensor noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.readers.one_grid import as_read
from hexsim.signals.channels import SETTLE_S
from hexsim.signals.log import Log
from hexsim.signals.weak_form import HALF_WIDTH_S
from hexsim.tracing.balances.balance import Balance
from hexsim.tracing.memory import remembered

Array = np.ndarray
REACH_S = 3.0 * HALF_WIDTH_S  # of the widest window of a balance and what delays move it by, [s]
FILLED_WELL = 2  # samples: so short a gap is filled as well as a sample is known


def with_noise(log: Log, noise: dict[str, float], resolution: float, rng: np.random.Generator) -> Log:
    """White noise on every sample; the position is rounded as its transducer rounds."""

    def noisy(rows: Array | None, kind: str) -> Array | None:
        return None if rows is None else rows + noise[kind] * rng.standard_normal(rows.shape)

    position = noisy(log.position, "position_m")
    if resolution > 0:
        sharp = np.sqrt(max(noise["position_m"] ** 2 - resolution**2 / 12, 0.0))
        position = resolution * np.round((log.position + sharp * rng.standard_normal(log.position.shape)) / resolution)
    own = replace(
        log,
        position=position,
        pressure=noisy(log.pressure, "pressure_bottom_Pa"),
        pressure_top=noisy(log.signal("pressure_top"), "pressure_top_Pa"),
        pressure_difference=noisy(log.signal("pressure_difference"), "pressure_difference_Pa"),
        supply=noisy(log.supply, "pressure_supply_Pa"),
        acceleration=noisy(log.acceleration, "acceleration_m_s2"),
        angular=noisy(log.angular, "angular_acceleration_rad_s2"),
    )
    return as_read(log, own)


def used(log: Log, residual: Array) -> Array:
    """The samples of a residual that count."""
    return residual[..., used_samples(log)]


def used_samples(log: Log, every: int = 1) -> slice:
    """Places of the samples that count, or of some of them."""
    return slice(int((SETTLE_S + 0.1) * log.rate), log.n - int(REACH_S * log.rate), every)


def window_weights(log: Log) -> Array:
    """Weights (n_used,) of a residual's samples: 0 where a window sees a repaired stretch, else as large as keeps the sum."""

    def weights() -> Array:
        good = used(log, log.whole(REACH_S, FILLED_WELL))
        return good / np.sqrt(max(good.mean(), 1.0 / log.n))

    return remembered(log, "weights", weights)


def null_squares(
    balances: Sequence[Balance],
    quiet: Sequence[Log],
    clean: Sequence[Sequence[Array]],
    machine: Machine,
    noise: dict[str, float],
    seed: int,
) -> list[tuple[Array, Array]]:
    """Mean squares of every balance in one null run, over all logs together: (whole, of the noise alone), (n_places,) each.

    clean: a balance, a log: the residual without noise (reversals, sampling); it is taken out of the second.
    """
    rng = np.random.default_rng(seed)
    noisy = [with_noise(log, noise, machine.sensors.position_resolution_m, rng) for log in quiet]
    found = []
    for balance, own in zip(balances, clean, strict=True):
        residuals = [used(log, balance.residual(log, machine)) for log in noisy]
        count = sum(r.shape[-1] for r in residuals)
        whole = sum(np.sum(r**2, axis=-1) for r in residuals)
        apart = sum(np.sum((r - c) ** 2, axis=-1) for r, c in zip(residuals, own, strict=True))
        found.append((np.asarray(whole) / count, np.asarray(apart) / count))
    return found
