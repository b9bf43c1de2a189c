"""Ties: which other effect of the library does as well as a named one, with the same other effects beside it.

Where the hypothesis stands, the column of every candidate is held against what the named effect does: how much of it is
left when declared parameters, the other effects and the candidate may move. What leaves little is refitted by simulation
in the place of the named effect. A tie is a refit within TIE_CHI2, whatever led the search to the named one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, effect_columns, parameter_columns, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, to_coordinate
from hexsim.tracing.fitting.screening import columns_of
from hexsim.tracing.fitting.selection import information, scale_of, try_candidate
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps.search import simulated_fit

Array = np.ndarray
TANGENT = (
    0.05  # share of the trial size at which tangents are taken: near a resonance the answer nonlinear_response soon
)


def without(fit: Fit, k: int, problem: SimulatedProblem) -> Fit:
    """The fitted machine with effect k taken away, nothing refitted, as seen by a problem."""
    bare = replace(
        fit,
        candidates=fit.candidates[:k] + fit.candidates[k + 1 :],
        values=fit.values[:k] + fit.values[k + 1 :],
    )
    return parameter_columns(start_fit_at(bare, problem), problem)


def flat(columns: Sequence[Array]) -> Array:
    """Columns of all logs as rows (n_columns, n)."""
    return np.concatenate([c.reshape(c.shape[0], -1) for c in columns], axis=1)


def stand_ins(
    fit: Fit, k: int, possible: Sequence[Candidate], problem: SimulatedProblem
) -> list[tuple[Candidate, float]]:
    """Candidates whose column does what effect k does, with the size that does it, the best first."""
    fit = parameter_columns(start_fit_at(fit, problem), problem)
    counts = [len(candidate.free()) for candidate in fit.candidates]
    first = sum(counts[:k])
    numbers = flat(effect_columns(fit, problem))
    assert fit.columns is not None
    beside = np.concatenate([flat(fit.columns), numbers[:first], numbers[first + counts[k] :]])
    size = fit.candidates[k].effect.parameters[0]
    does = numbers[first] * to_coordinate(size, fit.values[k][size.name])
    weak = np.concatenate([np.full(len(fit.priors), 3.0), np.full(len(beside) - len(fit.priors), 1e-6)])
    others = [c for c in possible if c.label not in {own.label for own in fit.candidates}]

    def left(columns: Array, ridge: Array) -> tuple[float, float]:
        A = columns @ columns.T + np.diag(ridge)
        b = columns @ does
        theta = np.linalg.lstsq(A, b, rcond=1e-12)[0]
        return float(does @ does - b @ theta), float(theta[-1]) if len(theta) else 0.0

    alone = left(beside, weak)[0]
    found: dict[str, tuple[float, Candidate, float]] = {}
    for candidate, columns in zip(others, columns_of(fit, others, problem, share=TANGENT), strict=True):
        own = np.concatenate([c.ravel() for c in columns]).astype(float)
        if not np.all(np.isfinite(own)) or not np.any(own):
            continue
        rest, theta = left(np.concatenate([beside, own[None]]), np.append(weak, 1e-6))
        if rest < rules.TIE_NEAR * alone and rest < found.get(candidate.label, (np.inf,))[0]:
            found[candidate.label] = (rest, candidate, theta)
    best = sorted(found.values(), key=lambda entry: entry[0])[: rules.TIES_TRIED]
    return [(candidate, theta) for _, candidate, theta in best]


def ties_of(fit: Fit, k: int, possible: Sequence[Candidate], problem: SimulatedProblem) -> dict[str, Fit]:
    """Effects that can stand for effect k: label -> the hypothesis with it, refitted on the whole runs."""
    head = problem.head(rules.TRIAGE_S)
    near = stand_ins(fit, k, possible, head)
    bare = without(fit, k, head) if near else fit
    tied = {}
    for candidate, size in near:
        opening = try_candidate(bare, candidate, size, head, rules.TRIAGE_STEPS)
        rival = None if opening is None else simulated_fit(opening, problem)
        if rival is not None and rival.chi2 - fit.chi2 < rules.TIE_CHI2 * scale_of(fit):
            tied[candidate.label] = rival
    return dict(sorted(tied.items()))


def with_ties(fit: Fit, possible: Sequence[Candidate], problem: SimulatedProblem) -> tuple[Fit, list[dict[str, Fit]]]:
    """The hypothesis and the ties of each of its effects; a physical cause goes before one that stands for any of its form."""
    ties = [ties_of(fit, k, possible, problem) for k in range(len(fit.candidates))]
    for k, tied in enumerate(ties):
        physical = [rival for rival in tied.values() if not rival.candidates[-1].effect.generic]
        if fit.candidates[k].effect.generic and physical:
            return with_ties(min(physical, key=information), possible, problem)
    return fit, ties
