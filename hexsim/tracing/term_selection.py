"""Forward selection of the terms of a balance of one's own, scored on runs that the numbers have not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear, minimize_scalar
from scipy.stats import wilcoxon

from hexsim.tracing.term_columns import BLOCKS, OwnBalance, RunData, Term, at_place, variants

Array = np.ndarray
Chosen = tuple[Term, ...]
GAIN = 0.03  # least relative gain of the held-out loss for a term
MOST_TERMS = 8  # each must earn its place on runs it has not seen
TIE = 0.10  # candidates within this of the best gain are a tie
RARE = 0.15  # share of the samples below which a term acts rarely
ACTS = 0.05  # of a column's largest value: beyond it the term acts
OCCASIONS = 6  # least number of occasions on which a rare term acts
RARE_GAIN = 0.1  # least fall of the loss where a rare term acts
EVERY_RUN = 1.0 / 3.0  # fall of the loss in each held-out run that chance does not give: no further test
CHANCE = 0.01  # of signed ranks
SHOWN = 0.05  # of a column's largest sum of squares in a run: from there a run shows the term


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


def gain_of(before: Sequence[Array], after: Sequence[Array], runs: Sequence[RunData], term: Term) -> float:
    """Mean fall of the loss by a term if it earns its place, else 0: more than GAIN and two standard errors over blocks; or
    a third of the loss of every run; or, where it acts rarely, RARE_GAIN of the loss there, on occasions that chance does
    not give. A few blocks hold most of a rare effect: their scatter is no measure of chance."""
    blocks = [
        np.array([block.mean() for block in np.array_split(b - a, BLOCKS)]) for b, a in zip(before, after, strict=True)
    ]
    gains, whole = np.concatenate(blocks), float(np.mean([b.mean() for b in before]))
    mean, error = float(gains.mean()), float(np.std(gains)) / np.sqrt(len(gains))
    if mean > max(GAIN * whole, 2 * error):
        return mean
    if all(a.mean() < (1.0 - EVERY_RUN) * b.mean() for b, a in zip(before, after, strict=True)):
        return mean
    active = [acts(run, term) for run in runs]
    if not 0 < np.mean(np.concatenate(active)) < RARE or mean <= 0:
        return 0.0
    occasions, there = [], 0.0
    for b, a, on in zip(before, after, active, strict=True):
        at = np.flatnonzero(on)
        there += float(b[at].sum())
        for group in np.split(at, np.flatnonzero(np.diff(at) > 2) + 1):
            if len(group):
                occasions.append(float((b - a)[group].sum()))
    enough = len(occasions) >= OCCASIONS and sum(occasions) > RARE_GAIN * there
    by_chance = float(np.asarray(wilcoxon(occasions, alternative="greater"))[1]) if enough else 1.0
    return mean if by_chance < CHANCE else 0.0


def select(balance: OwnBalance, runs: Sequence[RunData]) -> tuple[Chosen, list[str]]:
    """Forward selection by leave-one-run-out; also the candidates that tie with the first chosen one."""
    chosen: Chosen = ()
    tied: list[str] = []
    losses = losses_of(balance, runs, chosen)
    trials_of = [one for term in balance.candidates for one in variants(term, runs)]
    while len(chosen) < MOST_TERMS:
        trials = earning(balance, runs, losses, chosen, others_of(trials_of, chosen))
        if not trials:
            break
        best, term = trials[-1]
        if not chosen:
            near = [one.name for gain, one in trials if gain > (1 - TIE) * best]
            tied = sorted(set(near) - {term.name})
        chosen = (*chosen, placed(balance, runs, chosen, term))
        losses = losses_of(balance, runs, chosen)
    return exchanged(balance, runs, chosen, trials_of), tied


def exchanged(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen, trials_of: Sequence[Term]) -> Chosen:
    """Each chosen term against every other candidate in its place: what was chosen while others were missing may have
    stood for one that comes later."""
    for k in range(len(chosen)):
        rest = (*chosen[:k], *chosen[k + 1 :])
        trials = earning(balance, runs, losses_of(balance, runs, chosen), rest, others_of(trials_of, chosen))
        if trials:
            other = placed(balance, runs, rest, trials[-1][1])
            chosen = (*chosen[:k], other, *chosen[k + 1 :])
    return chosen


def foretold(balance: OwnBalance, runs: Sequence[RunData], found: Sequence[Chosen]) -> list[Chosen]:
    """What each fold chooses, with what it could not choose: of two runs that show a bumper, a fold has one, on which to fit
    it or to score it. It counts as chosen where every fold that has two such runs or more chooses it, and the one run
    foretells the run that is held out: less is left where the term acts, and in all.
    """
    chosen = list(found)
    for term in {term.name: term for own in found for term in own}.values():
        sizes = sizes_of(term, runs)
        shows = sizes > SHOWN * sizes.max()
        tells = [int(shows.sum() - shown) > 1 for shown in shows]
        lacks = [all(one.name != term.name for one in own) for own in found]
        if not any(tells) or any(lack for lack, tell in zip(lacks, tells, strict=True) if tell):
            continue
        for i in (i for i, lack in enumerate(lacks) if lack):
            others = [run for j, run in enumerate(runs) if j != i]
            trial = (*chosen[i], best_placed(balance, others, chosen[i], term))
            before, after = (residual(runs[i], solve(balance, others, own), own) for own in (chosen[i], trial))
            on = acts(runs[i], trial[-1])
            less = rms(after) < rms(before) and on.any() and rms(after[on]) < (1.0 - RARE_GAIN) * rms(before[on])
            chosen[i] = trial if less and physical(balance, others, trial) else chosen[i]
    return chosen


def shown_once(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> dict[str, str]:
    """Candidates that one run alone shows, of which they would take a third: name -> run. No name: nothing can score them."""
    found = {}
    for term in balance.candidates:
        if term.name in {one.name for one in chosen}:
            continue
        trial = (*chosen, best_placed(balance, runs, chosen, term))
        sizes = sizes_of(trial[-1], runs)
        if np.sum(sizes > SHOWN * sizes.max()) == 1 and physical(balance, runs, trial):
            run = runs[int(np.argmax(sizes))]
            before, after = (rms(residual(run, solve(balance, runs, own), own)) for own in (chosen, trial))
            found |= {term.name: run.name} if after**2 < (1.0 - EVERY_RUN) * before**2 else {}
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


def others_of(trials_of: Sequence[Term], chosen: Chosen) -> list[Term]:
    """Terms, at all their places, but those of the chosen ones' names."""
    return [term for term in trials_of if term.name not in {one.name for one in chosen}]


def earning(
    balance: OwnBalance, runs: Sequence[RunData], losses: Sequence[Array], beside: Chosen, terms: Sequence[Term]
) -> list[tuple[float, Term]]:
    """Terms that earn their place beside others by falls of these losses, each with its gain, the best last."""
    found = []
    for term in terms:
        trial = (*beside, term)
        if (
            physical(balance, runs, trial)
            and (gain := gain_of(losses, losses_of(balance, runs, trial), runs, term)) > 0
        ):
            found.append((gain, term))
    return sorted(found, key=lambda trial: trial[0])


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
