"""Balances of a machine of one's own: terms screened with nested held-out runs.

A balance is a sum of terms, each a function of the measured signals under a window: target = sum c_i term_i. The
declared terms have a value and an uncertainty; candidates may be added. Every choice (terms, places of hinges,
coefficients) is made without the run it is scored on: for each run, forward selection on the others by leave-one-run-out,
then one score on the run itself. A term is named only if every fold chooses it and no held-out run gets worse; else the
verdict is "not attributable", or "unexplained" where no candidate helps.

What acts in a few samples only cannot take away 3 % of the whole: it is judged where it acts, by signed ranks over the
occasions on which it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.errors import HexsimError
from hexsim.tracing.term_columns import Alignment, OwnBalance, Point, RunData, Term, aligned, late_by, refused, run_data
from hexsim.tracing.term_selection import (
    GAIN,
    RARE,
    RARE_GAIN,
    Chosen,
    acts,
    foretold,
    placed,
    residual,
    rms,
    select,
    shown_once,
    sizes_of,
    solve,
    squares_left,
)

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
    """verdict: a sentence that begins "explained in part by", "not attributable", "unexplained" or "nothing missing".

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


def trace_own(balance: OwnBalance, points: Sequence[Point]) -> OwnVerdict:
    """Nested held-out runs, then the verdict. Needs at least three runs.

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
    balance = OwnBalance(
        name=balance.name, unit=balance.unit, target=balance.target, terms=balance.terms, candidates=usable
    )
    declared = np.array([term.declared or 0.0 for term in balance.terms])
    folds, without = [], [[other for other in runs if other is not run] for run in runs]
    selected = [select(balance, others) for others in without]
    found = foretold(balance, runs, [chosen for chosen, _ in selected])
    for run, others, chosen, (_, tied) in zip(runs, without, found, selected, strict=True):
        coefficients = solve(balance, others, chosen)
        before, after = residual(run, solve(balance, others, ()), ()), residual(run, coefficients, chosen)
        rare = [acts(run, term) for term in chosen if np.mean(acts(run, term)) < RARE]
        on = np.any(rare, axis=0) if rare else np.zeros(len(before), dtype=bool)
        names = [t.name for t in balance.terms] + [t.name for t in chosen]
        folds.append(
            Fold(
                held_out=run.name, chosen=tuple(t.name for t in chosen), tied=tuple(tied),
                declared=rms(residual(run, declared, ())), refit=rms(before), with_terms=rms(after),
                coefficients=dict(zip(names, map(float, coefficients), strict=True)),
                acting=(rms(before[on]), rms(after[on])) if on.any() else None,
            )
        )  # fmt: skip
    return verdict_of(balance, runs, tuple(folds), found, tuple(dict.fromkeys(why.values())))


def verdict_of(
    balance: OwnBalance, runs: Sequence[RunData], folds: tuple[Fold, ...], found: Sequence[Chosen], why: tuple[str, ...]
) -> OwnVerdict:
    """Named: in every fold, and no held-out run worse with the terms than without, and the gain over all runs > 3 %, or,
    of what acts rarely, > 10 % where it acts."""
    common = set.intersection(*(set(fold.chosen) for fold in folds))
    worse = [fold.held_out for fold in folds if fold.with_terms > fold.refit]
    before, after = (float(np.sqrt(np.mean([getattr(f, k) ** 2 for f in folds]))) for k in ("refit", "with_terms"))
    acting = [fold.acting for fold in folds if fold.acting is not None]
    gained = after < (1 - GAIN) * before
    gained |= bool(acting) and rms(np.array(acting)[:, 1]) < (1 - RARE_GAIN) * rms(np.array(acting)[:, 0])
    ties = sorted({name for fold in folds for name in fold.tied} - common)
    share = after / max(float(np.sqrt(np.mean([np.mean(run.target**2) for run in runs]))), 1e-300)
    named: tuple[str, ...] = ()
    alone = carried(runs, folds, found)
    if not any(fold.chosen for fold in folds):
        text = "unexplained: no candidate earns its place on runs it has not seen"
        text = "nothing missing" if share < GAIN else text
    elif common and not worse and gained:
        named = in_order(balance, runs, [next(t for own in found for t in own if t.name == name) for name in common])
        tie = f" (tied with {', '.join(ties)})" if ties else ""
        text = f"explained in part by {' + '.join(named)}{tie}: {before:.3g} -> {after:.3g} {balance.unit} held out"
        if acting:
            low, high = rms(np.array(acting)[:, 1]), rms(np.array(acting)[:, 0])
            text += f", {high:.3g} -> {low:.3g} where it acts"
    else:
        why_not = (
            [f"the folds choose {' / '.join(' + '.join(f.chosen) or 'nothing' for f in folds)}"] if not common else []
        )
        why_not += [f"run {', '.join(worse)} gets worse"] if worse else []
        why_not += [sentence for _, sentence in alone.values()]
        why_not += [f"gain {1 - after / before:.1%}"] if not why_not else []
        text = f"not attributable: {'; '.join(why_not)}"
    terms: Chosen = ()
    for name in named:
        own = next(term for chosen in found for term in chosen if term.name == name)
        terms = (*terms, placed(balance, runs, terms, own))
    signal, r2 = strongest_dependence(balance, runs, terms)
    left = f"; rest {after:.3g} {balance.unit} rms, {share:.1%} of the target"
    left += (
        f", most of all a function of {signal} (R2 {r2:.2f} on held-out runs)" if r2 > 0.1 else ", of no single signal"
    )
    return OwnVerdict(
        balance=balance.name, unit=balance.unit, folds=folds, named=named, verdict=text + left,
        coefficients=numbers(balance, runs, terms), rest_share=share, depends_on=(signal, r2),
        places=places_of(found, terms), refused=why, terms=terms,
        alone={name: run for name, (run, _) in alone.items() if not named} or shown_once(balance, runs, terms),
    )  # fmt: skip


def in_order(balance: OwnBalance, runs: Sequence[RunData], terms: Sequence[Term]) -> tuple[str, ...]:
    """Names of terms, first the one without which most is left."""

    def left_without(term: Term) -> float:
        return -squares_left(balance, runs, tuple(other for other in terms if other is not term))

    return tuple(term.name for term in sorted(terms, key=left_without))


def carried(runs: Sequence[RunData], folds: Sequence[Fold], found: Sequence[Chosen]) -> dict[str, tuple[str, str]]:
    """Why some folds do not choose what others do, one run holds most of what shows it: term -> (run, sentence)."""
    said = {}
    for name in sorted({term.name for chosen in found for term in chosen}):
        without = [fold.held_out for fold in folds if name not in fold.chosen]
        term = next(term for chosen in found for term in chosen if term.name == name)
        sizes = sizes_of(term, runs)
        most = int(np.argmax(sizes))
        if runs[most].name in without and sizes[most] > 0.5 * sizes.sum():
            at = "" if term.place is None else f" beyond {term.place:.4g}"
            text = f"{name}{at} acts most in run {runs[most].name} ({sizes[most] / sizes.sum():.0%} of it)"
            said[name] = (runs[most].name, f"{text}: the others alone do not show it")
    return said


def numbers(balance: OwnBalance, runs: Sequence[RunData], terms: Chosen) -> dict[str, tuple[float, float]]:
    """Coefficient and its spread of every term: a jackknife over the runs."""
    whole = solve(balance, runs, terms)
    parts = np.array([solve(balance, [r for r in runs if r is not run], terms) for run in runs])
    spread = np.sqrt((len(runs) - 1) / len(runs) * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
    names = [term.name for term in (*balance.terms, *terms)]
    return {n: (float(c), float(e)) for n, c, e in zip(names, whole, spread, strict=True)}


def places_of(found: Sequence[Chosen], terms: Chosen) -> dict[str, tuple[float, float]]:
    """Place of each named hinge, and how far it moves from fold to fold."""
    places = {}
    for term in terms:
        own = [one.place for chosen in found for one in chosen if one.name == term.name and one.place is not None]
        if term.place is not None and own:
            places[term.name] = (term.place, float(np.std(own)) if len(own) > 1 else float("nan"))
    return places


def strongest_dependence(balance: OwnBalance, runs: Sequence[RunData], chosen: Chosen) -> tuple[str, float]:
    """The signal whose curve (24 bins, narrow at the ends, learned on the other runs) explains most of the residual of a
    run: (name, R2)."""
    left = [residual(run, solve(balance, [r for r in runs if r is not run], chosen), chosen) for run in runs]
    best = ("none", 0.0)
    shares = np.concatenate([[0.005, 0.015, 0.03], np.linspace(0, 1, 19)[1:-1], [0.97, 0.985, 0.995]])
    for name in sorted(set.intersection(*(set(run.signals) for run in runs))):
        edges = np.quantile(np.concatenate([run.signals[name] for run in runs]), shares)
        n = len(edges) + 1
        places = [np.searchsorted(edges, run.signals[name]) for run in runs]
        lost = 0.0
        for i in range(len(runs)):
            place = np.concatenate([places[j] for j in range(len(runs)) if j != i])
            value = np.concatenate([left[j] for j in range(len(runs)) if j != i])
            curve = np.bincount(place, value, minlength=n) / np.maximum(np.bincount(place, minlength=n), 1)
            lost += float(np.sum((left[i] - curve[places[i]]) ** 2))
        r2 = 1.0 - lost / max(sum(float(np.sum(x**2)) for x in left), 1e-300)
        if r2 > best[1]:
            best = (name, r2)
    return best
