"""Balances of a machine of one's own: terms screened with nested held-out runs.

A balance is a sum of terms, each a function of the measured signals under a window: target = sum c_i term_i. The
declared terms have a value and an uncertainty; candidates may be added. Every choice (terms, coefficients) is made
without the run it is scored on: for each run, forward selection on the others by leave-one-run-out, then one score on
the run itself. A term is named only if every fold chooses it and no held-out run gets worse; else the verdict is "not
attributable", or "unexplained" where no candidate helps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hexsim.errors import HexsimError
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.checks.sensor_agreement import agreement

Array = np.ndarray
GAIN = 0.03  # least relative gain of the held-out loss for a term
MOST_TERMS = 3
TIE = 0.10  # candidates within this of the best gain are a tie
PARTS = 4  # parts of a run that have a delay of their own: clocks of different recorders drift
BLOCKS = 6  # blocks a run, for the standard error of a gain


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """Aligned signals of one run. `mean` and `rate` are <w, x> and <w, dx/dt>; point["name"] is a raw channel."""

    log: Log
    window: Window
    shifts_s: Mapping[str, Array] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        values = self.log.columns[name]
        if name not in self.shifts_s:
            return values
        place = np.arange(len(values))
        return np.interp(place + self.shifts_s[name] * self.log.rate, place, values)

    def scored(self) -> Array:
        """The second half of each part: the first half served to align the channels."""
        n = len(self.log.time)
        return (np.arange(n) * 2 * PARTS // n) % 2 == 1

    def mean(self, x: Array) -> Array:
        return self.window.mean(np.asarray(x, dtype=float))

    def rate(self, x: Array) -> Array:
        return self.window.rate(np.asarray(x, dtype=float))


Expression = Callable[[Point], Array]


@dataclass(frozen=True, kw_only=True)
class Term:
    """One term of a balance. declared, uncertainty (standard deviation): of a declared term.

    sign: +1 or -1 where physics allows one only, 0 where both.
    """

    name: str
    unit: str
    column: Expression
    declared: float | None = None
    uncertainty: float = 0.0
    sign: int = 0


@dataclass(frozen=True, kw_only=True)
class OwnBalance:
    """target = sum of declared terms (+ candidates), in `unit`. valid: which samples count (None = all)."""

    name: str
    unit: str
    target: Expression
    terms: tuple[Term, ...]
    candidates: tuple[Term, ...]
    valid: Callable[[Point], Array] | None = None


@dataclass(frozen=True, kw_only=True)
class Fold:
    """What happened with one run held out: rms of the residual before, refitted, with the chosen terms; what was chosen."""

    held_out: str
    declared: float
    refit: float
    with_terms: float
    chosen: tuple[str, ...]
    tied: tuple[str, ...]
    coefficients: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class OwnVerdict:
    """verdict: a sentence that begins "explained in part by", "not attributable", "unexplained" or "nothing missing".

    rest_share: rms of the residual on held-out runs by that of the target; depends_on: strongest (signal, held-out R2).
    """

    balance: str
    unit: str
    folds: tuple[Fold, ...]
    named: tuple[str, ...]
    verdict: str
    rest_share: float
    depends_on: tuple[str, float]
    coefficients: dict[str, tuple[float, float]]


def late_by(window: Window, name: str, channel: Array, reference: Array) -> Array:
    """Delay [s] of a channel against one that follows the same motion, sample by sample (n,): one number for each
    part of the run, from the first half of the part.

    HexsimError when the two do not belong together (correlation below 0.8).
    """
    n, rate = len(channel), 1.0 / window.dt
    delay = np.empty(n)
    for part in np.array_split(np.arange(n), PARTS):
        half = part[: len(part) // 2]
        found = agreement(window.mean(reference[half]), window.mean(channel[half]), rate, 0.0, window.half)
        if found.correlation < 0.8:
            raise HexsimError(
                f"{name} does not follow its reference (correlation {found.correlation:.2f}): it cannot be aligned"
            )
        delay[part] = found.delay_s
    return delay


@dataclass(frozen=True, kw_only=True, eq=False)
class RunData:
    """Columns of a run: target (m,), declared terms (m, k), candidates (m, c)."""

    name: str
    target: Array
    terms: Array
    candidates: Array
    signals: dict[str, Array]


def run_data(balance: OwnBalance, point: Point) -> RunData:
    """Evaluate all columns, thinned to independent windows, where the run is scored."""
    n, half = len(point.log.time), point.window.half
    keep = np.zeros(n, dtype=bool)
    keep[half : n - half : max(1, half)] = True
    keep &= point.scored()
    if balance.valid is not None:
        keep &= balance.valid(point)

    def columns(terms: Sequence[Term]) -> Array:
        return (
            np.column_stack([term.column(point)[keep] for term in terms]) if terms else np.zeros((int(keep.sum()), 0))
        )

    return RunData(
        name=point.log.name, target=balance.target(point)[keep], terms=columns(balance.terms),
        candidates=columns(balance.candidates),
        signals={"time_s": point.log.time[keep]} | {k: point.mean(point[k])[keep] for k in point.log.columns},
    )  # fmt: skip


def solve(balance: OwnBalance, runs: Sequence[RunData], chosen: Sequence[int]) -> Array:
    """Coefficients of declared terms (pulled to their declared values by their uncertainty) and chosen candidates."""
    A = np.vstack([np.column_stack([run.terms, run.candidates[:, list(chosen)]]) for run in runs])
    b = np.concatenate([run.target for run in runs])
    scale = np.maximum(np.sqrt(np.mean(A**2, axis=0)), 1e-300)
    rough = b - A @ (np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale)
    sigma = max(float(np.std(rough)), 1e-300)
    rows, right = [A / sigma], [b / sigma]
    for i, term in enumerate(balance.terms):
        if term.declared is not None and term.uncertainty > 0:
            prior = np.zeros(A.shape[1])
            prior[i] = 1.0 / term.uncertainty
            rows.append(prior[None])
            right.append(np.array([term.declared / term.uncertainty]))
    stacked = np.vstack(rows)
    return np.linalg.lstsq(stacked / scale, np.concatenate(right), rcond=None)[0] / scale


def residual(run: RunData, coefficients: Array, chosen: Sequence[int]) -> Array:
    return run.target - np.column_stack([run.terms, run.candidates[:, list(chosen)]]) @ coefficients


def block_losses(balance: OwnBalance, runs: Sequence[RunData], chosen: Sequence[int]) -> Array:
    """Mean square of the residual in blocks of every run, predicted from the other runs, by its variance."""
    losses = []
    for i, run in enumerate(runs):
        others = [other for j, other in enumerate(runs) if j != i]
        left = residual(run, solve(balance, others, chosen), chosen)
        weight = float(np.var(run.target)) or 1.0
        losses += [float(np.mean(block**2)) / weight for block in np.array_split(left, BLOCKS)]
    return np.array(losses)


def physical(balance: OwnBalance, runs: Sequence[RunData], chosen: Sequence[int]) -> bool:
    """Every chosen candidate has the sign that physics asks for."""
    coefficients = solve(balance, runs, chosen)[len(balance.terms) :]
    signs = [balance.candidates[i].sign for i in chosen]
    return all(sign * value >= 0 for sign, value in zip(signs, coefficients, strict=True))


def select(balance: OwnBalance, runs: Sequence[RunData]) -> tuple[list[int], list[str]]:
    """Forward selection by leave-one-run-out; also the candidates that tie with the first chosen one."""
    chosen: list[int] = []
    tied: list[str] = []
    losses = block_losses(balance, runs, chosen)
    while len(chosen) < MOST_TERMS:
        trials = []
        for i in range(len(balance.candidates)):
            if i in chosen or not physical(balance, runs, [*chosen, i]):
                continue
            gain = losses - block_losses(balance, runs, [*chosen, i])
            error = float(np.std(gain)) / np.sqrt(len(gain))
            if gain.mean() > max(GAIN * losses.mean(), 2 * error):
                trials.append((float(gain.mean()), i))
        if not trials:
            break
        best, index = max(trials)
        if not chosen:
            tied = [balance.candidates[i].name for gain, i in trials if gain > (1 - TIE) * best and i != index]
        chosen.append(index)
        losses = block_losses(balance, runs, chosen)
    return chosen, tied


def trace_own(balance: OwnBalance, points: Sequence[Point]) -> OwnVerdict:
    """Nested held-out runs, then the verdict. Needs at least three runs."""
    if len(points) < 3:
        raise HexsimError(
            f"balance {balance.name}: {len(points)} runs are too few to hold one out twice; give three or more"
        )
    runs = [run_data(balance, point) for point in points]
    declared = np.array([term.declared or 0.0 for term in balance.terms])
    folds = []
    for i, run in enumerate(runs):
        others = [other for j, other in enumerate(runs) if j != i]
        chosen, tied = select(balance, others)
        coefficients = solve(balance, others, chosen)
        folds.append(
            Fold(
                held_out=run.name, chosen=tuple(balance.candidates[k].name for k in chosen), tied=tuple(tied),
                declared=rms(residual(run, declared, [])), refit=rms(residual(run, solve(balance, others, []), [])),
                with_terms=rms(residual(run, coefficients, chosen)),
                coefficients=dict(zip([t.name for t in balance.terms] + [balance.candidates[k].name for k in chosen],
                                      map(float, coefficients), strict=True)),
            )
        )  # fmt: skip
    return verdict_of(balance, runs, tuple(folds))


def verdict_of(balance: OwnBalance, runs: Sequence[RunData], folds: tuple[Fold, ...]) -> OwnVerdict:
    """Named: in every fold, and no held-out run worse with the terms than without, and the gain over all runs > 3 %."""
    common = set.intersection(*(set(fold.chosen) for fold in folds))
    worse = [fold.held_out for fold in folds if fold.with_terms > fold.refit]
    before, after = (float(np.sqrt(np.mean([getattr(f, k) ** 2 for f in folds]))) for k in ("refit", "with_terms"))
    ties = sorted({name for fold in folds for name in fold.tied})
    share = after / max(float(np.sqrt(np.mean([np.mean(run.target**2) for run in runs]))), 1e-300)
    if not any(fold.chosen for fold in folds):
        named, text = (), "unexplained: no candidate earns its place on runs it has not seen"
        text = "nothing missing" if share < GAIN else text
    elif common and not worse and after < (1 - GAIN) * before:
        named = tuple(term.name for term in balance.candidates if term.name in common)
        tie = f" (tied with {', '.join(ties)})" if ties else ""
        text = f"explained in part by {' + '.join(named)}{tie}: {before:.3g} -> {after:.3g} {balance.unit} held out"
    else:
        named = ()
        why = [f"the folds choose {' / '.join(' + '.join(f.chosen) or 'nothing' for f in folds)}"] if not common else []
        why += [f"run {', '.join(worse)} gets worse"] if worse else []
        why += [f"gain {1 - after / before:.1%}"] if not why else []
        text = f"not attributable: {'; '.join(why)}"
    index = [i for i, term in enumerate(balance.candidates) if term.name in named]
    whole = solve(balance, runs, index)
    parts = np.array([solve(balance, [r for r in runs if r is not run], index) for run in runs])
    spread = np.sqrt(
        (len(runs) - 1) / len(runs) * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0)
    )  # jackknife over runs
    names = [term.name for term in balance.terms] + list(named)
    coefficients = {n: (float(c), float(e)) for n, c, e in zip(names, whole, spread, strict=True)}
    signal, r2 = strongest_dependence(balance, runs, index)
    left = f"; rest {after:.3g} {balance.unit} rms, {share:.1%} of the target"
    left += (
        f", most of all a function of {signal} (R2 {r2:.2f} on held-out runs)" if r2 > 0.1 else ", of no single signal"
    )
    return OwnVerdict(
        balance=balance.name, unit=balance.unit, folds=folds, named=named, verdict=text + left,
        coefficients=coefficients, rest_share=share, depends_on=(signal, r2),
    )  # fmt: skip


def strongest_dependence(balance: OwnBalance, runs: Sequence[RunData], chosen: Sequence[int]) -> tuple[str, float]:
    """The signal whose curve (20 bins, learned on the other runs) explains most of the residual of a run: (name, R2)."""
    left = [residual(run, solve(balance, [r for r in runs if r is not run], chosen), chosen) for run in runs]
    best = ("none", 0.0)
    for name in sorted(set.intersection(*(set(run.signals) for run in runs))):
        edges = np.quantile(np.concatenate([run.signals[name] for run in runs]), np.linspace(0, 1, 21)[1:-1])
        places = [np.searchsorted(edges, run.signals[name]) for run in runs]
        lost = 0.0
        for i in range(len(runs)):
            place = np.concatenate([places[j] for j in range(len(runs)) if j != i])
            value = np.concatenate([left[j] for j in range(len(runs)) if j != i])
            curve = np.bincount(place, value, minlength=20) / np.maximum(np.bincount(place, minlength=20), 1)
            lost += float(np.sum((left[i] - curve[places[i]]) ** 2))
        r2 = 1.0 - lost / max(sum(float(np.sum(x**2)) for x in left), 1e-300)
        if r2 > best[1]:
            best = (name, r2)
    return best


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
