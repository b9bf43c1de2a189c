"""Motions, and samples of them, that can be believed: clear of the cushions, and where small differences do not grow.

Near a standstill a difference grows, of noise as of a number. There a simulation promises much, and no trace gets it.
And numbers whose promise hangs on a nuisance effect that does nearly the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from hexsim.machine import Machine
from hexsim.signals.channels import kind_of
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, coordinates_of
from hexsim.tracing.fitting.rest_priors import is_held
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray
COARSE = 3.0  # times the step of the finite differences


def enters_a_cushion(machine: Machine, position_m: Array) -> bool:
    """Whether a piston, by its positions (n_legs, n), comes into a cushion. Setpoints are clear of them; a slow spool overshoots."""
    stroke_m, cushion_m = (np.array(machine.of_legs("cylinder", name)) for name in ("stroke_m", "cushion_length_m"))
    return bool(np.any(position_m < cushion_m[:, None]) or np.any(position_m > (stroke_m - cushion_m)[:, None]))


def calm_samples(problem: SimulatedProblem) -> Array:
    """Samples (n_used,) of the first log at which the spread of the accelerations is within five times their noise."""
    rows = [k for k, name in enumerate(problem.channels(0)) if "acceleration" in name]
    limit = rules.CERTAIN * np.array([problem.noise[kind_of(problem.channels(0)[k])] for k in rows])[:, None]
    return np.all(problem.input_uncertainty[0][rows, problem.settle(0) :] < limit, axis=0)


def reproduced(columns: Array, coarse: Array, spread: Array, rate_Hz: float) -> Array:
    """Samples (n,) at which columns (k, n_channels, n) hardly depend on the step of their finite differences.

    coarse: the columns with another step; spread (k,): how far a coordinate may be off now. Two numbers that do the same
    have the same columns. Where a small difference grows they have not, and the difference would pass for knowledge.
    """

    def size(rows: Array) -> Array:
        return uniform_filter1d(rows**2, max(round(rules.SPREAD_S * rate_Hz), 1), axis=-1, mode="nearest")

    off = size(columns - coarse)
    matters = off * spread[:, None, None] ** 2 > rules.TELLABLE
    return ~np.any(matters & (off > rules.SLIGHT * size(coarse)), axis=(0, 1))


def hangs_on(now: Fit, after: Fit, places: Sequence[int]) -> tuple[str, ...]:
    """Of coordinates, the nuisance effect that the logs do not show now and that goes with them after a motion; else "".

    Its part of what both do is told by what little their columns differ, in which the rest weighs most: a valve's delay beside a
    spool of 2 kHz. Where the next refit keeps it, the error stays about as it is, where not, it is less than promised.
    """
    assert now.covariance is not None and after.covariance is not None
    here, size, sd = coordinates_of(now), np.sqrt(np.diag(now.covariance)), np.sqrt(np.diag(after.covariance))
    labels = [""] * len(now.priors) + [c.label if is_held(c) else "" for c in now.candidates for _ in c.free()]
    unseen = [k for k, label in enumerate(labels) if label and abs(here[k]) < size[k]]
    found = []
    for place in places:
        together = {k: abs(after.covariance[place, k]) / max(sd[place] * sd[k], 1e-300) for k in unseen}
        most = max(together, key=lambda k: together[k], default=None)
        found.append(labels[most] if most is not None and together[most] > rules.TRADES else "")
    return tuple(found)
