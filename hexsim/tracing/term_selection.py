"""Numbers of the terms of a balance of one's own by least squares, places of hinges, and where a term acts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear, minimize_scalar

from hexsim.tracing import rules
from hexsim.tracing.term_columns import OwnBalance, RunData, Term, at_place, variants

Array = np.ndarray
Chosen = tuple[Term, ...]
RARE = 0.15  # share of the samples below which a term acts rarely
ACTS = 0.05  # of a column's largest value: beyond it the term acts


def solve(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> Array:
    """Coefficients of declared terms (pulled to their declared values by their uncertainty) and chosen candidates."""
    rows, right, scale = _system(balance, runs, chosen)
    return np.linalg.lstsq(rows, right, rcond=None)[0] / scale


def solve_physical(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> Array:
    """`solve` with every candidate on the side of nothing that physics allows."""
    rows, right, scale = _system(balance, runs, chosen)
    signs = np.array([0] * len(balance.terms) + [term.sign for term in chosen])
    bounds = np.where(signs > 0, 0.0, -np.inf), np.where(signs < 0, 0.0, np.inf)
    return lsq_linear(rows, right, bounds).x / scale


def _system(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> tuple[Array, Array, Array]:
    """Rows (m + pulls, k), right side and scale (k,) of the least squares, in standard deviations; solution / scale."""
    A = np.vstack([run.matrix(chosen) for run in runs])
    b = np.concatenate([run.target for run in runs])
    pulls = [(i, t) for i, t in enumerate(balance.terms) if t.declared is not None and t.uncertainty > 0]
    scale = np.sqrt(np.mean(A**2, axis=0))
    for i, term in pulls:  # a term that a run does not have stays where it is declared
        scale[i] = scale[i] or 1.0 / term.uncertainty
    scale = np.maximum(scale, 1e-300)
    rough = b - A @ (np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale)
    sigma = max(float(np.std(rough)), 1e-300)
    rows, right = [A / sigma], [b / sigma]
    for i, term in pulls:
        prior = np.zeros((1, A.shape[1]))
        prior[0, i] = 1.0 / term.uncertainty
        rows.append(prior)
        right.append(np.array([(term.declared or 0.0) / term.uncertainty]))
    return np.vstack(rows) / scale, np.concatenate(right), scale


def residual(run: RunData, coefficients: Array, chosen: Chosen) -> Array:
    return run.target - run.matrix(chosen) @ coefficients


def losses_of(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> list[Array]:
    """Squared residual of every run (m,), predicted from the other runs, by its target's variance."""
    losses = []
    for i, run in enumerate(runs):
        others = [other for j, other in enumerate(runs) if j != i]
        left = residual(run, solve(balance, others, chosen), chosen)
        losses.append(left**2 / (float(np.var(run.target)) or 1.0))
    return losses


def physical(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> bool:
    """Every chosen candidate has the sign that physics asks for."""
    coefficients = solve(balance, runs, chosen)[len(balance.terms) :]
    return all(term.sign * value >= 0 for term, value in zip(chosen, coefficients, strict=True))


def acts(run: RunData, term: Term) -> Array:
    """Where a term acts (m,) bool."""
    size = np.abs(run.column(term))
    return size > ACTS * max(float(size.max()), 1e-300)


def shown_once(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> dict[str, str]:
    """Candidates that one run alone shows, of which they would take much: name -> run. No name: nothing can score them."""
    found = {}
    for term in balance.candidates:
        if term.name in {one.name for one in chosen}:
            continue
        trial = (*chosen, best_placed(balance, runs, chosen, term))
        sizes = sizes_of(trial[-1], runs)
        if np.sum(sizes > ACTS * sizes.max()) == 1 and physical(balance, runs, trial):
            run = runs[int(np.argmax(sizes))]
            before, after = (rms(residual(run, solve(balance, runs, own), own)) for own in (chosen, trial))
            found |= {term.name: run.name} if after**2 < (1.0 - rules.EXPLAINS) * before**2 else {}
    return found


def best_placed(balance: OwnBalance, runs: Sequence[RunData], beside: Chosen, term: Term) -> Term:
    """A term, a hinge at the place that leaves least of these runs."""
    if term.over is None:
        return term

    best = min(variants(_anywhere(term), runs), key=lambda one: squares_left(balance, runs, (*beside, one)))
    return placed(balance, runs, beside, best)


def squares_left(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> float:
    """Sum of the squared residuals of all runs with these terms, fitted to them."""
    coefficients = solve(balance, runs, chosen)
    return sum(float(np.sum(residual(run, coefficients, chosen) ** 2)) for run in runs)


def sizes_of(term: Term, runs: Sequence[RunData]) -> Array:
    """Sum of the squares of a term's column in every run, (n_runs,)."""
    return np.array([float(np.sum(run.column(term) ** 2)) for run in runs])


def placed(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen, term: Term) -> Term:
    """A hinge at the place that leaves least, between its neighbours on the grid of places."""
    if term.over is None or term.place is None:
        return term
    plain = at_place(term, term.place)
    grid = [one.place for one in variants(_anywhere(plain), runs)]
    k = int(np.argmin([abs(place - term.place) for place in grid if place is not None]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]

    def left(place: float) -> float:
        return squares_left(balance, runs, (*chosen, at_place(term, float(place))))

    if low is None or high is None or not high > low:
        return term
    found = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * (high - low)})
    return at_place(term, float(found.x)) if found.fun < left(term.place) else term


def _anywhere(term: Term) -> Term:
    return Term(name=term.name, unit=term.unit, sign=term.sign, over=term.over, column_at=term.column_at)


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
