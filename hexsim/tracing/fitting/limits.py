"""Effects that are limits: a largest speed of a spool, a largest flow of a pump.

A limit that no motion takes does nothing, however near it is: it has no column there, and no refit moves it. So what
looks for one begins at the largest that the logs show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing.fitting.fit import Fit, evaluate
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.problems.problem import FitProblem

Array = np.ndarray


def limits_of(possible: Sequence[Candidate], fit: Fit) -> list[Candidate]:
    """The limits among these candidates that are not in the fit, each once."""
    there = {own.effect.name for own in fit.candidates}
    named = {own.label: own for own in reversed(possible) if own.effect.limit and own.effect.name not in there}
    return list(named.values())


def reached(fit: Fit, candidate: Candidate, problem: FitProblem, alarm: float) -> float:
    """The largest limit that moves the rests of a problem by an alarm [its unit], beside what the fit has; its lower bound
    where none does. Its other numbers are as they are looked for."""
    size = candidate.effect.parameters[0]

    def rests(limit: float) -> list[Array]:
        values = (*fit.values, candidate.start() | {size.name: limit})
        return evaluate(replace(fit, candidates=(*fit.candidates, candidate), values=values), problem).misfit

    low, high = size.bounds
    free = rests(high)
    for _ in range(8):  # halvings of six decades: to 6 %
        middle = float(np.sqrt(low * high))
        shown = sum(float(np.sum((own - was) ** 2)) for own, was in zip(rests(middle), free, strict=True)) > alarm
        low, high = (middle, high) if shown else (low, middle)
    return low
