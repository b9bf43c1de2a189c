"""Motion that a fit has not seen: each group of stretches is predicted from the others, in density and in the model's own error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.likelihood import Coefficients, Fit, finite, fit

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """density: log predictive density of each group. rests: of each stretch (n, channels), predicted from the other groups."""

    problem: Problem
    groups: list[str]
    density: Array
    rests: list[Array]
    fits: list[Fit]

    def losses(
        self,
        channel: int,
        *,
        n_blocks: int = 16,  # of a stretch, whose losses are compared; neighbours may be correlated over three
    ) -> Array:
        """Mean square of every block of every stretch."""
        found = []
        for stretch, rest in zip(self.problem.stretches, self.rests, strict=True):
            seen = rest[stretch.weight[:, channel] > 0, channel]
            found += [
                float(np.mean(part**2))
                for part in np.array_split(seen, min(n_blocks, max(len(seen) // 8, 1)))
                if len(part)
            ]
        return np.array(found)

    def rms(self, channel: int) -> float:
        return float(np.sqrt(np.mean(self.losses(channel)))) if len(self.losses(channel)) else 0.0


def held_out(whole: Fit, evaluations: int = 15) -> HeldOut:
    """Numbers and spectra from all groups but one, begun at those of all; then this group.

    Raises HexsimError where a group cannot be predicted because it is alone.
    """
    problem = whole.problem
    groups = list(dict.fromkeys(stretch.group for stretch in problem.stretches))
    if len(groups) < 2:
        raise HexsimError("the logs are too short to hold a part of them out: give more motion")
    fits = []
    for group in groups:
        others = [k for k, stretch in enumerate(problem.stretches) if stretch.group != group]
        fits.append(
            fit(
                problem,
                others,
                whole.theta,
                whole.spectra,
                evaluations,
                with_spread=False,
                white=False,
                keep_local=True,
            )
        )
    return predicted(problem, fits)


def predicted(
    problem: Problem,
    fits: Sequence[Fit],
    *,
    lost_residual: float = 1e30,  # residual of a run that leaves the finite numbers
) -> HeldOut:
    """Each group by the fit that has not seen it. fits: in the order of the groups."""
    groups = list(dict.fromkeys(stretch.group for stretch in problem.stretches))
    rests: list[Array] = [np.zeros((0, 0))] * len(problem.stretches)
    density = []
    for group, own in zip(groups, fits, strict=True):
        inside = [k for k, stretch in enumerate(problem.stretches) if stretch.group == group]
        density.append(log_density(problem, inside, own))
        for k, rest in zip(inside, problem.residuals(own.theta, inside), strict=True):
            rests[k] = np.clip(np.where(np.isfinite(rest), rest, lost_residual), -lost_residual, lost_residual)
    return HeldOut(problem=problem, groups=groups, density=np.array(density), rests=rests, fits=list(fits))


def log_density(problem: Problem, at: list[int], own: Fit) -> float:
    """Of stretches with the numbers and spectra of a fit to others."""
    data = Coefficients(problem, at)
    left = finite(data.residuals(own.theta))
    return float(
        sum(
            own.spectra[c].log_density(data.log_f[j], np.abs(left[j]) ** 2, data.weight[j])
            for j, (_, c) in enumerate(data.places)
        )
    )


def mean_over_error(
    d: Array,
    *,
    lags: int = 3,  # blocks over which neighbours may be correlated
) -> float:
    """t of a mean whose neighbours are correlated (Newey and West 1987)."""
    n, e = len(d), d - d.mean()
    variance = float(np.mean(e * e))
    for lag in range(1, min(lags + 1, n)):
        variance += 2.0 * (1.0 - lag / (lags + 1.0)) * float(np.sum(e[lag:] * e[:-lag])) / n
    return float(d.mean() / math.sqrt(max(variance, 1e-30 * float(np.mean(d * d)) + 1e-300) / n))
