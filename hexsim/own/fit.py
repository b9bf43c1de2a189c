"""Maximum likelihood in simulation: the numbers with which free runs come nearest to what was measured, with honest errors.

    minimise  sum over runs, outputs, samples ((measured - simulated) / noise)^2 + sum over priors ((theta - mean) / sd)^2

by scipy's trust region with the sensitivities of the simulation. A residual of a simulation is correlated over seconds, so that the
curvature of this sum alone gives errors that are many times too small. Errors here are the sandwich H^-1 (sum over windows of the scores
g g^T) H^-1, for windows of several lengths, of which the largest counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from hexsim.errors import HexsimError
from hexsim.own.model import Number
from hexsim.own.simulate import FreeRun, Record, Simulator

Array = np.ndarray
WINDOWS = (8, 16, 32)  # of a run, whose scores are taken as independent
FAR = 1e6  # residual [noise] of a run that left the finite numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """Numbers of the machine and of each run. errors: as `values`. rms: run -> output -> of the residual on scored samples."""

    simulator: Simulator
    names: list[str]
    values: Array
    errors: Array
    runs: list[str]
    cost: float
    noises: Array
    rms: dict[str, dict[str, float]]
    covariance: Array
    at_bound: list[str] = field(default_factory=list)

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)])


class Problem:
    """Runs and a model as one vector of residuals. theta: numbers of the machine, then those of each run."""

    def __init__(self, simulator: Simulator, records: Sequence[Record], noises: Array | None = None) -> None:
        self.simulator, self.records = simulator, list(records)
        self.numbers: list[Number] = []
        self.columns = np.zeros(
            (len(records), len(simulator.model.numbers)), dtype=int
        )  # theta's place of each number of each run
        for k, number in enumerate(simulator.model.numbers):
            for r, record in enumerate(records):
                if r == 0 or number.of_run:
                    self.numbers.append(
                        replace(number, name=f"{number.name} of {record.name}") if number.of_run else number
                    )
                self.columns[r, k] = len(self.numbers) - 1
        model = simulator.model
        self.noises = np.array(model.noises, dtype=float) if noises is None else noises
        for k in np.flatnonzero(~np.isfinite(self.noises)):
            seen = np.concatenate([record.measured[record.weight[:, k] > 0, k] for record in records])
            self.noises[k] = float(np.std(seen)) or 1.0 if len(seen) else 1.0
        self.low = np.array([number.low for number in self.numbers])
        self.high = np.array([number.high for number in self.numbers])
        self.scale = np.array([number.scale for number in self.numbers])
        self.start = np.array([number.start for number in self.numbers])
        self.prior = np.array([1.0 / number.sd if np.isfinite(number.sd) else 0.0 for number in self.numbers])
        self.mean = np.array([number.mean if np.isfinite(number.sd) else 0.0 for number in self.numbers])
        self._at: tuple[bytes, list[FreeRun]] | None = None

    def free_runs(self, theta: Array, slopes: bool) -> list[FreeRun]:
        key = theta.tobytes()
        if self._at is None or self._at[0] != key or (slopes and not self._at[1][0].slopes.any()):
            made = [self.simulator.run(record, theta[self.columns[r]], slopes) for r, record in enumerate(self.records)]
            self._at = (key, made)
        return self._at[1]

    def residuals(self, theta: Array) -> Array:
        parts = []
        for record, free in zip(self.records, self.free_runs(theta, False), strict=True):
            rest = (free.outputs - record.measured) / self.noises * record.weight
            parts.append(np.nan_to_num(rest, nan=FAR, posinf=FAR, neginf=-FAR).ravel())
        return np.concatenate([*parts, (theta - self.mean) * self.prior])

    def jacobian(self, theta: Array) -> Array:
        parts = []
        for r, (record, free) in enumerate(zip(self.records, self.free_runs(theta, True), strict=True)):
            slopes = free.slopes / self.noises[:, None] * record.weight[:, :, None]
            whole = np.zeros((record.n * len(self.noises), len(self.numbers)))
            own = np.nan_to_num(slopes.reshape(-1, slopes.shape[2]))
            np.add.at(whole.T, self.columns[r], own.T)
            parts.append(whole)
        return np.concatenate([*parts, np.diag(self.prior)])

    def rms(self, theta: Array) -> dict[str, dict[str, float]]:
        found = {}
        for record, free in zip(self.records, self.free_runs(theta, False), strict=True):
            rest = (free.outputs - record.measured) * record.weight
            count = record.weight.sum(axis=0)
            found[record.name] = {
                name: float(np.sqrt(np.sum(rest[:, k] ** 2) / count[k]))
                for k, name in enumerate(self.simulator.model.outputs)
                if count[k]
            }
        return found


def fit(
    simulator: Simulator, records: Sequence[Record], starts: int | None = None, begin: Array | None = None, most: int = 100,
    seed: int = 0,
) -> Fitted:  # fmt: skip
    """Fit the numbers of a model to runs. starts: searches, the further ones from numbers drawn about the start. begin: theta.

    Raises HexsimError where no run can be simulated from any start.
    """
    problem = Problem(simulator, records)
    if not any(record.weight.any() for record in records):
        raise HexsimError("no output of the model is in the logs: name an output as its column is named")
    rng, best = np.random.default_rng(seed), None
    for k in range(starts or simulator.model.tables.simulation.starts):
        theta = problem.start if begin is None else begin
        if k:
            theta = theta + 0.3 * problem.scale * rng.standard_normal(len(theta))
        if not problem.numbers:
            found = theta
            cost = 0.5 * float(np.sum(problem.residuals(theta) ** 2))
        else:
            made = searched(problem, inside(problem, theta), most)
            found, cost = made.x, float(made.cost)
        if best is None or cost < best[1]:
            best = (found, cost)
    assert best is not None
    theta, cost = best
    if not all(free.finite for free in problem.free_runs(theta, False)):
        raise HexsimError(
            "the simulation leaves the finite numbers with every number that was tried: check signs and starts, or give smaller steps"
        )
    return judged(problem, theta, cost)


def inside(problem: Problem, theta: Array) -> Array:
    """Within the bounds, a little."""
    room = np.minimum(1e-6 * problem.scale, 0.25 * (problem.high - problem.low))
    return np.clip(theta, problem.low + room, problem.high - room)


def searched(problem: Problem, theta: Array, most: int):
    return least_squares(
        problem.residuals, theta, jac=problem.jacobian, bounds=(problem.low, problem.high), x_scale=problem.scale,  # pyright: ignore[reportArgumentType]
        max_nfev=most, xtol=1e-10, ftol=1e-9, gtol=1e-12,
    )  # fmt: skip


def judged(problem: Problem, theta: Array, cost: float) -> Fitted:
    """Errors, figures and what lies at a bound."""
    covariance = covariance_of(problem, theta)
    near = 1e-4 * problem.scale
    at = [n.name for n, x, e in zip(problem.numbers, theta, near, strict=True) if x - n.low < e or n.high - x < e]
    return Fitted(
        simulator=problem.simulator, names=[number.name for number in problem.numbers], values=theta,
        errors=np.sqrt(np.diag(covariance)), runs=[record.name for record in problem.records], cost=cost,
        noises=problem.noises, rms=problem.rms(theta), covariance=covariance, at_bound=at,
    )  # fmt: skip


def covariance_of(problem: Problem, theta: Array) -> Array:
    """The sandwich of windows, the largest of several window lengths for each number."""
    if not problem.numbers:
        return np.zeros((0, 0))
    rest, slopes = problem.residuals(theta), problem.jacobian(theta)
    scale = problem.scale
    curvature = (slopes * scale).T @ (slopes * scale)
    inverse = np.linalg.pinv(curvature, hermitian=True, rcond=1e-13)
    ny, found = len(problem.noises), []
    for count in WINDOWS:
        middle, first = np.zeros_like(curvature), 0
        for record in problem.records:
            for rows in np.array_split(np.arange(first, first + record.n * ny), count):
                score = (slopes[rows] * scale).T @ rest[rows]
                middle += np.outer(score, score)
            first += record.n * ny
        total = count * len(problem.records)
        middle *= total / max(total - len(theta), 1)
        prior = np.diag((problem.prior * scale) ** 2)
        found.append(inverse @ (middle + prior) @ inverse)
    largest = np.max([np.sqrt(np.maximum(np.diag(one), 0.0)) for one in found], axis=0)
    last = found[np.argmax([np.trace(one) for one in found])]
    own = np.sqrt(np.maximum(np.diag(last), 1e-300))
    stretch = np.where(own > 0, largest / own, 1.0) * scale
    return last * np.outer(stretch, stretch)
