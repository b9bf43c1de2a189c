"""Terms of a balance of one's own, evaluated on runs: columns, thinned to independent windows, and which cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from hexsim.errors import HexsimError
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing import rules
from hexsim.tracing.checks.sensor_agreement import agreement

Array = np.ndarray


class Clocks(NamedTuple):
    """Alignment of channels from other recorders."""

    parts: int = 4  # parts of a run that have a delay of their own: clocks of different recorders drift
    follows: float = 0.8  # least correlation of a channel with what it is aligned to
    jump_s: float = 0.15  # [s] a part whose delay is further from the others' median is taken to be wrong


CLOCKS = Clocks()

PLACES = (0.005, 0.01, 0.02, 0.03, 0.05, 0.075, *np.arange(0.1, 0.95, 0.05), 0.925, 0.95, 0.97, 0.98, 0.99, 0.995)
# quantiles of a signal at which a hinge or a threshold may lie: dense at the ends, where rare effects act


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """Aligned signals of one run. `mean` and `rate` are <w, x> and <w, dx/dt>; point["name"] is a raw channel.

    short: window for derivatives inside a product. rows: samples of the run that count, None for all. aligning: the
    samples on which channels are aligned, in the place of those that are scored.
    """

    log: Log
    window: Window
    shifts_s: Mapping[str, Array] = field(default_factory=dict)
    short: Window | None = None
    rows: slice | None = None
    aligning: bool = False

    def __getitem__(self, name: str) -> Array:
        if name not in self.log.columns:
            raise HexsimError(f"run {self.log.name} has no column {name}: it has {', '.join(sorted(self.log.columns))}")
        values = self.log.columns[name]
        if name not in self.shifts_s:
            return values
        place = np.arange(len(values))
        return np.interp(place + self.shifts_s[name] * self.log.rate, place, values)

    def scored(self) -> Array:
        """Samples that are scored: where channels were aligned on the first half of each part, the second half; of windows
        that see no filled stretch."""
        n = len(self.log.time)
        second = (np.arange(n) * 2 * CLOCKS.parts // n) % 2 == 1
        keep = second != self.aligning if len(self.shifts_s) else np.ones(n, dtype=bool)
        if self.rows is not None:
            keep &= np.isin(np.arange(n), np.arange(n)[self.rows])
        return keep & self.log.whole(self.window.half * self.window.dt, 2)

    def mean(self, x: Array) -> Array:
        return self.window.mean(np.asarray(x, dtype=float))

    def rate(self, x: Array) -> Array:
        return self.window.rate(np.asarray(x, dtype=float))

    def late(self, name: str, delay_s: float) -> Point:
        """The point with one channel read so much later."""
        own = self.shifts_s.get(name, np.zeros(len(self.log.time)))
        return replace(self, shifts_s={**self.shifts_s, name: own + delay_s})


Expression = Callable[[Point], Array]


def by_delay(left: Expression, channel: str) -> Expression:
    """What a delay of a channel does to what a balance leaves: the difference quotient over a sample either way."""

    def column(point: Point) -> Array:
        step = 1.0 / point.log.rate
        return (left(point.late(channel, -step)) - left(point.late(channel, step))) / (2.0 * step)

    return column


@dataclass(frozen=True, kw_only=True)
class Term:
    """One term of a balance. declared, uncertainty (standard deviation): of a declared term.

    sign: +1 or -1 where physics allows one only, 0 where both. over, column_at: a hinge or threshold whose place on the
    signal `over` is found; its column is column_at(point, place).
    """

    name: str
    unit: str
    column: Expression = lambda p: np.ones(len(p.log.time))
    declared: float | None = None
    uncertainty: float = 0.0
    sign: int = 0
    over: Expression | None = None
    column_at: Callable[[Point, float], Array] | None = None
    place: float | None = None


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
class Alignment:
    """Delay of a channel, sample by sample (n,) [s], and what is to be said of it."""

    delay_s: Array
    sentence: str


def aligned(window: Window, name: str, channel: Array, reference: Array, constant: bool = False) -> Alignment:
    """Delay of a channel against one that follows the same motion: one number for each part of the run, from the first
    half of the part. A part at standstill, or one that does not follow, has the delay of the others.

    constant: the median of the parts for all of them.

    HexsimError when no part follows (correlation below 0.8).
    """
    n, rate = len(channel), 1.0 / window.dt
    parts = np.array_split(np.arange(n), CLOCKS.parts)
    found = []
    for part in parts:
        half = part[: len(part) // 2]
        found.append(agreement(window.mean(reference[half]), window.mean(channel[half]), rate, 0.0, window.half))
    follows = [one.correlation >= CLOCKS.follows for one in found]
    if not any(follows):
        best = max(one.correlation for one in found)
        raise HexsimError(f"{name} does not follow its reference (correlation {best:.2f}): it cannot be aligned")
    middle = float(np.median([one.delay_s for one, good in zip(found, follows, strict=True) if good]))
    used = [good and abs(one.delay_s - middle) < CLOCKS.jump_s for one, good in zip(found, follows, strict=True)]
    delays = [one.delay_s if good and not constant else middle for one, good in zip(found, used, strict=True)]
    delay = np.concatenate([np.full(len(part), own) for part, own in zip(parts, delays, strict=True)])
    words = ", ".join(f"{1e3 * own:.0f}" for own in delays)
    words = f"{1e3 * middle:.0f}" if constant else words
    sentence = f"{name} is late by {words} ms{'' if constant else ' (a part of the run each)'}: moved"
    for part, good, one in zip(parts, used, found, strict=True):
        if not good:
            sentence += (
                f"; from {part[0] / rate:.0f} to {part[-1] / rate:.0f} s it does not follow (correlation "
                f"{one.correlation:.2f}, {1e3 * one.delay_s:.0f} ms): the others' median is taken"
            )
    return Alignment(delay_s=delay, sentence=sentence)


def late_by(window: Window, name: str, channel: Array, reference: Array) -> Array:
    """`aligned`, the delay alone."""
    return aligned(window, name, channel, reference).delay_s


@dataclass(frozen=True, kw_only=True, eq=False)
class RunData:
    """A run thinned to independent windows: target (m,), declared terms (m, k), signals (m,). keep: its samples (n,) bool."""

    name: str
    target: Array
    terms: Array
    signals: dict[str, Array]
    point: Point
    keep: Array
    _columns: dict[Term, Array] = field(default_factory=dict)

    def column(self, term: Term) -> Array:
        """Column of a candidate (m,), made once."""
        if term not in self._columns:
            self._columns[term] = np.broadcast_to(term.column(self.point), self.keep.shape)[self.keep]
            if not np.all(np.isfinite(self._columns[term])):
                raise HexsimError(f"candidate {term.name} is no number somewhere in run {self.name}")
        return self._columns[term]

    def matrix(self, chosen: Sequence[Term]) -> Array:
        """Declared terms and chosen candidates (m, k + c)."""
        return np.column_stack([self.terms, *(self.column(term) for term in chosen)])


def run_data(balance: OwnBalance, point: Point) -> RunData:
    """Evaluate target and declared terms, thinned to independent windows, where the run is scored."""
    n, half = len(point.log.time), point.window.half
    keep = np.zeros(n, dtype=bool)
    keep[half : n - half : max(1, half)] = True
    keep &= point.scored()
    if balance.valid is not None:
        keep &= balance.valid(point)
    if keep.sum() < 4 * rules.FOLDS:
        raise HexsimError(
            f"balance {balance.name}: run {point.log.name} has {int(keep.sum())} independent samples that count, "
            f"{4 * rules.FOLDS} are needed: give a longer run or a shorter window"
        )
    terms = [np.broadcast_to(term.column(point), (n,))[keep] for term in balance.terms]
    found = RunData(
        name=point.log.name, target=np.broadcast_to(balance.target(point), (n,))[keep], point=point, keep=keep,
        terms=np.column_stack(terms) if terms else np.zeros((int(keep.sum()), 0)),
        signals={"time_s": point.log.time[keep]} | {k: point.mean(point[k])[keep] for k in point.log.columns},
    )  # fmt: skip
    for what, rows in (("the target", found.target), *zip((t.name for t in balance.terms), found.terms.T, strict=True)):
        if not np.all(np.isfinite(rows)):
            raise HexsimError(f"balance {balance.name}: {what} of run {found.name} is no number somewhere")
    return found


def variants(term: Term, runs: Sequence[RunData]) -> list[Term]:
    """The term itself, or one for every place that a hinge may have."""
    if term.over is None or term.column_at is None or term.place is not None:
        return [term]
    signal = np.concatenate([term.over(run.point)[run.keep] for run in runs])
    even = np.linspace(np.min(signal), np.max(signal), 22)[1:-1]
    return [at_place(term, float(x)) for x in np.unique(np.concatenate([np.quantile(signal, PLACES), even]))]


def at_place(term: Term, place: float) -> Term:
    """A hinge at one place."""
    make = term.column_at
    assert make is not None
    return replace(term, column=lambda p: make(p, place), place=place)


def refused(balance: OwnBalance, runs: Sequence[RunData]) -> dict[str, str]:
    """Candidates that cannot be used, and why: all zero in a run, the target itself, or collinear with another.

    HexsimError for a term without a declared value that is all zero in a run.
    """
    for i, term in enumerate(balance.terms):
        empty = [run.name for run in runs if not np.any(run.terms[:, i])]
        if empty and not (term.declared is not None and term.uncertainty > 0):
            raise HexsimError(
                f"balance {balance.name}: term {term.name} is all zero in run {empty[0]}: declare its value and "
                "uncertainty, or leave the run out"
            )
    why: dict[str, str] = {}
    target, terms = np.concatenate([run.target for run in runs]), np.vstack([run.terms for run in runs])
    columns = {t.name: np.concatenate([run.column(t) for run in runs]) for t in balance.candidates if t.over is None}
    for term in balance.candidates:
        if (x := columns.get(term.name)) is None:
            continue
        empty = [run.name for run in runs if not np.any(run.column(term))]
        if empty:
            why[term.name] = f"{term.name} is all zero in {', '.join(empty)}: nothing can be said of it there"
        elif outside(target, x[:, None]) < rules.SAME:
            why[term.name] = f"{term.name} is the target itself: it explains nothing"
        elif terms.shape[1] and outside(x, terms) < rules.SAME:
            why[term.name] = f"{term.name} is a sum of declared terms: its number cannot be told from theirs"
    usable = [name for name in columns if name not in why]
    for a, one in enumerate(usable):
        for other in usable[a + 1 :]:
            if outside(columns[one], columns[other][:, None]) < rules.SAME:
                why[one] = why[other] = f"{one} and {other} are collinear: no data tell them apart; give one of them"
    return why


def outside(x: Array, columns: Array) -> float:
    """Share of the size of x (n,) that no sum of columns (n, k) has."""
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    rest = x - columns @ (np.linalg.lstsq(columns / scale, x, rcond=None)[0] / scale)
    return float(np.sqrt(np.sum(rest**2) / max(float(np.sum(x**2)), 1e-300)))
