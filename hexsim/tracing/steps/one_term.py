"""One term under two names: a hose and a dead volume add one constant to the capacity of a chamber, C = V/E.

What the logs know is the term; its number reads under either name. With j the columns of the hypothesis in the balances, j'
those of the same machine under the other name, and v the other name's own column, the other number is

    d size' = sum t d theta,     t = (j - j') v / |v|^2,     of the named effect's own number t = j v / |v|^2,

so that the error of V has that of the bulk modulus in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing.fitting.fit import Fit, all_columns, effect_columns, start_fit_at
from hexsim.tracing.fitting.normal import flat
from hexsim.tracing.fitting.parameters import Candidate, to_coordinate, to_value
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.state import NamedEffect, Reading

Array = np.ndarray


def with_readings(
    effects: Sequence[NamedEffect], fit: Fit, possible: Sequence[Candidate], balances: BalanceProblem
) -> list[NamedEffect]:
    """Effects of a fit, each with those of its ties that are the same term (`Effect.term`) under another name."""
    found = []
    for effect in effects:
        own, k = effect.candidate, fit.candidates.index(effect.candidate)
        others = [c for c in possible if own.effect.term and c.effect.term == own.effect.term]
        # of a leg beside all legs the value is a sum, and no number of the fit
        others = [c for c in others if c.label in effect.tied_with and fit.values[k] == effect.values]
        found.append(replace(effect, readings=tuple(read_as(fit, k, other, balances) for other in others)))
    return found


def read_as(fit: Fit, k: int, name: Candidate, balances: BalanceProblem) -> Reading:
    """Effect k of a fit, which has one number, under another name: the number that does the same in the balances."""
    number, (size,) = name.effect.parameters[0], fit.candidates[k].free()
    place = fit.places(k).start

    def under_it(value: float) -> Fit:
        values = (*fit.values[:k], {number.name: value}, *fit.values[k + 1 :])
        return replace(fit, candidates=(*fit.candidates[:k], name, *fit.candidates[k + 1 :]), values=values)

    here = flat(all_columns(start_fit_at(fit, balances), balances))
    does = here[place] * to_coordinate(size, fit.values[k][size.name])
    own = flat(effect_columns(start_fit_at(under_it(number.typical), balances), balances, only=k))[0]
    coordinate = float(own @ does) / float(own @ own)
    there = flat(all_columns(start_fit_at(under_it(to_value(number, coordinate)), balances), balances))
    there[place] = 0.0
    turned = (here - there) @ own / (own @ own)
    error = float("nan") if fit.covariance is None else float(np.sqrt(max(turned @ fit.covariance @ turned, 0.0)))
    value = to_value(number, coordinate)
    errors = {number.name: abs(to_value(number, coordinate + error) - value)}
    return Reading(candidate=name, values={number.name: value}, standard_errors=errors)
