"""Balances of a machine of one's own: which terms are missing, by the one inference, and their numbers.

A balance is a sum of terms, each a function of the measured signals under a window: target = sum c_i term_i. The declared terms have a
value and an uncertainty; candidates may be added. A candidate is named by the log predictive density of runs that its number has not
seen (`hexsim.inference`). Numbers are least squares over the runs, their errors a jackknife over runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.notebook import Notebook
from hexsim.inference.search import Found, search
from hexsim.inference.verdict import needed
from hexsim.tracing import rules
from hexsim.tracing.dependence import hats, knots_of, r2_of
from hexsim.tracing.term_columns import Alignment, OwnBalance, Point, RunData, Term, aligned, late_by, refused, run_data
from hexsim.tracing.term_rows import BalanceMachine
from hexsim.tracing.term_selection import RARE, Chosen, acts, residual, rms, shown_once, solve

__all__ = ["Alignment", "OwnBalance", "OwnVerdict", "Point", "Term", "aligned", "late_by", "run_data", "trace_own"]
Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Fold:
    """What happened with one run held out: rms of the residual before, refitted, with the chosen terms; what was chosen.

    acting: the same three where rare chosen terms act, None without such.
    """

    held_out: str
    declared: float
    refit: float
    with_terms: float
    chosen: tuple[str, ...]
    tied: tuple[str, ...]
    coefficients: dict[str, float]
    acting: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class OwnVerdict:
    """verdict: a sentence that begins "explained in part by", "unexplained" or "nothing missing".

    rest_share: rms of the residual on held-out runs by that of the target; depends_on: strongest (signal, held-out R2).
    places: hinge -> (place, spread over folds). refused: candidates left out, a sentence each. terms: what was named,
    what takes most first. alone: of a term that is not named the run that holds most of what shows it.
    """

    balance: str
    unit: str
    folds: tuple[Fold, ...]
    named: tuple[str, ...]
    verdict: str
    rest_share: float
    depends_on: tuple[str, float]
    coefficients: dict[str, tuple[float, float]]
    places: dict[str, tuple[float, float]]
    refused: tuple[str, ...]
    terms: Chosen
    alone: dict[str, str]


def trace_own(balance: OwnBalance, points: Sequence[Point], notes: Notebook | None = None) -> OwnVerdict:
    """Nested held-out runs, then the verdict. Needs at least three runs. notes: as in `search`.

    Candidates that are all zero in a run, the target itself or collinear with another are left out by name.
    """
    if len(points) < 3:
        raise HexsimError(
            f"balance {balance.name}: {len(points)} runs are too few to hold one out twice; give three or more"
        )
    names = [term.name for term in (*balance.terms, *balance.candidates)]
    if len(set(names)) < len(names):
        raise HexsimError(f"balance {balance.name}: two terms are called {max(names, key=names.count)}")
    runs = [run_data(balance, point) for point in points]
    why = refused(balance, runs)
    usable = tuple(term for term in balance.candidates if term.name not in why)
    balance = replace(balance, candidates=usable)
    machine = BalanceMachine(balance, points)
    found = search(machine, notes=notes)
    terms, traded = of_its_sign(balance, runs, machine.placed([step.candidate for step in found.steps]))
    tied = [*traded, *(tie.split(", odds")[0] for step in found.steps for tie in step.tied)]
    tied += [one.title for one in found.refused if one.verdict == "likely"]
    folds = folds_of(balance, runs, terms, tuple(tied))
    return verdict_of(balance, runs, folds, found, terms, traded, tuple(dict.fromkeys(why.values())))


def of_its_sign(balance: OwnBalance, runs: Sequence[RunData], terms: Chosen) -> tuple[Chosen, list[str]]:
    """Terms whose number over all frequencies has the sign that physics allows, and names of the others: these trade with the rest."""
    traded = []
    while terms:
        values = solve(balance, runs, terms)[len(balance.terms) :]
        wrong = [term for term, value in zip(terms, values, strict=True) if term.sign * value < 0]
        if not wrong:
            break
        traded.append(wrong[-1].name)
        terms = tuple(term for term in terms if term is not wrong[-1])
    return terms, traded


def folds_of(balance: OwnBalance, runs: Sequence[RunData], terms: Chosen, tied: tuple[str, ...]) -> tuple[Fold, ...]:
    """Each run predicted with the numbers of the others."""
    declared, folds = np.array([term.declared or 0.0 for term in balance.terms]), []
    for run in runs:
        others = [other for other in runs if other is not run]
        coefficients = solve(balance, others, terms)
        before, after = residual(run, solve(balance, others, ()), ()), residual(run, coefficients, terms)
        rare = [acts(run, term) for term in terms if np.mean(acts(run, term)) < RARE]
        on = np.any(rare, axis=0) if rare else np.zeros(len(before), dtype=bool)
        names = [term.name for term in (*balance.terms, *terms)]
        folds.append(
            Fold(
                held_out=run.name, chosen=tuple(term.name for term in terms), tied=tied,
                declared=rms(residual(run, declared, ())), refit=rms(before), with_terms=rms(after),
                coefficients=dict(zip(names, map(float, coefficients), strict=True)),
                acting=(rms(before[on]), rms(after[on])) if on.any() else None,
            )
        )  # fmt: skip
    return tuple(folds)


def verdict_of(
    balance: OwnBalance, runs: Sequence[RunData], folds: tuple[Fold, ...], found: Found, terms: Chosen, traded: Sequence[str],
    why: tuple[str, ...],
) -> OwnVerdict:  # fmt: skip
    """The search's names with what they take of each run, and what the rest depends on."""
    before, after = (float(np.sqrt(np.mean([getattr(f, k) ** 2 for f in folds]))) for k in ("refit", "with_terms"))
    share = after / max(float(np.sqrt(np.mean([np.mean(run.target**2) for run in runs]))), 1e-300)
    acting = [fold.acting for fold in folds if fold.acting is not None]
    likely = [
        f"{one.title} ({one.nats:.0f} nats; {one.why})"
        for one in found.refused
        if one.verdict == "likely" and one.nats > needed(1)
    ]
    if terms:
        names = [
            step.title + (f" (tied with {', '.join(step.tied)})" if step.tied else "")
            for step in found.steps
            if step.title not in traded
        ]
        text = f"explained in part by {' + '.join(names)}: {before:.3g} -> {after:.3g} {balance.unit} held out"
        if acting:
            low, high = rms(np.array(acting)[:, 1]), rms(np.array(acting)[:, 0])
            text += f", {high:.3g} -> {low:.3g} where it acts"
    elif share < rules.SLIGHT:
        text = "nothing missing"
    else:
        text = "unexplained: no candidate earns its place on runs it has not seen"
    text += f"; likely, not proven: {', '.join(likely[:2])}" if likely and share >= rules.SLIGHT else ""
    text += f"; {' and '.join(traded)} and the named ones trade: no run moves them apart" if traded else ""
    signal, r2 = strongest_dependence(balance, runs, terms)
    left = f"; rest {after:.3g} {balance.unit} rms, {share:.1%} of the target"
    left += (
        f", most of all a function of {signal} (R2 {r2:.2f} on held-out runs)" if r2 > 0.1 else ", of no single signal"
    )
    return OwnVerdict(
        balance=balance.name, unit=balance.unit, folds=folds, named=tuple(term.name for term in terms), verdict=text + left,
        coefficients=numbers(balance, runs, terms), rest_share=share, depends_on=(signal, r2),
        places={term.name: (term.place, float("nan")) for term in terms if term.place is not None}, refused=why, terms=terms,
        alone=shown_once(balance, runs, terms),
    )  # fmt: skip


def numbers(balance: OwnBalance, runs: Sequence[RunData], terms: Chosen) -> dict[str, tuple[float, float]]:
    """Coefficient and its spread of every term: a jackknife over the runs."""
    whole = solve(balance, runs, terms)
    parts = np.array([solve(balance, [r for r in runs if r is not run], terms) for run in runs])
    spread = np.sqrt((len(runs) - 1) / len(runs) * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
    names = [term.name for term in (*balance.terms, *terms)]
    return {n: (float(c), float(e)) for n, c, e in zip(names, whole, spread, strict=True)}


def strongest_dependence(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> tuple[str, float]:
    """The signal whose curve, learned on other runs, explains most of the residual of a run: (name, R2)."""
    left = [residual(run, solve(balance, [r for r in runs if r is not run], chosen), chosen) for run in runs]
    r, best = np.concatenate(left), ("none", 0.0)
    of_run = np.repeat(np.arange(len(runs)), [len(own) for own in left])
    for name in sorted(set.intersection(*(set(run.signals) for run in runs))):
        x = np.concatenate([run.signals[name] for run in runs])
        if np.ptp(x) > 0.0:
            best = max(best, (name, float(r2_of(hats(x, knots_of(x)), r, of_run))), key=lambda one: one[1])
    return best
