"""Which of two effects that a rest cannot separate is the likelier: by what is left, held out too, and by their sizes.

    -2 log odds = J of the fit runs + J of the held-out runs + sum (log(number/typical)/log 3)^2 + log det(1 + S M)

M: precision of the effect's numbers, all other coordinates free; S: variance of what is expected of them, a factor of 3
about the typical size. The last term (Laplace) charges a number as far as the logs know it: a number that they do not see
costs nothing, so that of two forms of one thing neither is ahead by having fewer numbers.
"""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.effects import EffectParameter
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import start_fit_at
from hexsim.tracing.fitting.parameters import coordinate_bounds, to_coordinate
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.problems.problem import FitProblem

EXPECTED = float(np.log(3.0))  # standard deviation of the logarithm of a size about its typical one


def odds_against(found: RestFit, problem: FitProblem, unseen: FitProblem) -> float:
    """-2 log odds of the last effect of a hypothesis, but for a constant that all of them share: the less the likelier."""
    fit, candidate = found.fit, found.fit.candidates[-1]
    numbers, values = candidate.free(), fit.values[-1]
    at = [to_coordinate(number, values[number.name]) for number in numbers]
    sizes = [abs(x) ** (1.0 / number.power) for number, x in zip(numbers, at, strict=True) if is_size(number)]
    far = sum((np.log(max(x, 1e-9)) / EXPECTED) ** 2 for x in sizes)
    expected = np.array([variance(number, x) for number, x in zip(numbers, at, strict=True)])
    A, _ = rest_level.weighted_system(fit, found.columns, problem)
    others = len(A) - len(numbers)
    held = A.copy()
    held[range(others, len(A)), range(others, len(A))] += 1.0 / expected
    known = log_det(held) - log_det(A[:others, :others]) + float(np.sum(np.log(expected)))
    return found.cost + rest_level.cost_of_rows(start_fit_at(fit, unseen), unseen) + float(far) + known


def is_size(number: EffectParameter) -> bool:
    """Is it a number of one sign with a typical size? A phase is not."""
    return number.typical != 0.0


def variance(number: EffectParameter, coordinate: float) -> float:
    """Of what is expected of a number, about a fitted coordinate: not wider than its bounds."""
    low, high = coordinate_bounds(number)
    width = (high - low) ** 2 / 12.0
    return min(width, max(EXPECTED * abs(coordinate), 1e-6) ** 2) if is_size(number) else width


def log_det(A: np.ndarray) -> float:
    """Of a positive definite matrix whose coordinates have sizes of their own."""
    d = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return float(np.linalg.slogdet(A / d[:, None] / d + 1e-12 * np.eye(len(d)))[1] + 2.0 * np.sum(np.log(d)))
