"""A balance of one's own as a problem of the inference: residual of a row = sum of terms less target, under the window.

Rows are taken every quarter window. A channel that was aligned keeps a small delay of each run beside the numbers, with a prior: what is
left of a wrong delay is no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Number, Stretch
from hexsim.inference.likelihood import Fit
from hexsim.tracing import rules
from hexsim.tracing.term_columns import OwnBalance, Point, Term, by_delay, run_data, variants
from hexsim.tracing.term_selection import Chosen, placed, rms

Array = np.ndarray


class LateRows(NamedTuple):
    """Rows of a regression whose delays are known to an error only."""

    late_s: float = 0.02  # [s] prior standard deviation of what an alignment leaves
    # phase that such a delay may make, 1 % of a mean square: rows of a higher frequency are left out
    top_rad: float = 0.1
    least_share: float = 0.1  # of a run's rows that must count


LATE = LateRows()


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of one run: target (n,), counted (n,) bool, dt [s]; columns are made once."""

    point: Point
    at: Array
    target: Array
    counted: Array
    dt: float
    kept: dict[Term, Array] = field(default_factory=dict)

    def column(self, term: Term) -> Array:
        if term not in self.kept:
            values = np.broadcast_to(term.column(self.point), (len(self.point.log.time),))[self.at]
            if not np.all(np.isfinite(values[self.counted])):
                raise HexsimError(f"term {term.name} is no number somewhere in run {self.point.log.name}")
            self.kept[term] = np.where(self.counted, np.nan_to_num(values), 0.0)
        return self.kept[term]


def rows_of(balance: OwnBalance, point: Point) -> Rows | None:
    """None where too few rows of a run count."""
    n, half = len(point.log.time), point.window.half
    step = max(half // 2, 1)
    at = np.arange(n)[half : n - half : step]
    if point.rows is not None:
        at = at[np.isin(at, np.arange(n)[point.rows])]
    counted = point.log.whole(half * point.window.dt, 2)[at]
    if balance.valid is not None:
        counted = counted & balance.valid(point)[at]
    if counted.mean() < LATE.least_share or counted.sum() < 40:
        return None
    target = np.broadcast_to(balance.target(point), (n,))[at]
    if not np.all(np.isfinite(target[counted])):
        raise HexsimError(f"balance {balance.name}: the target of run {point.log.name} is no number somewhere")
    return Rows(point=point, at=at, target=np.where(counted, np.nan_to_num(target), 0.0), counted=counted,
                dt=step * point.window.dt)  # fmt: skip


class BalanceProblem:
    """See `hexsim.inference.contract.Problem`; linear in its numbers."""

    def __init__(
        self, balance: OwnBalance, rows: Sequence[Rows], terms: Sequence[Term], late: Sequence[tuple[int, Term]]
    ) -> None:
        self.channels, self.noises = (balance.name,), (float("nan"),)
        declared = {term.name for term in balance.terms}
        size = rms(np.concatenate([run.target[run.counted] for run in rows]))
        widths = [rms(np.concatenate([run.column(term)[run.counted] for run in rows])) or size or 1.0 for term in terms]
        self.numbers = [
            number_of(term, size / width, term.name in declared) for term, width in zip(terms, widths, strict=True)
        ]
        self.numbers += [
            Number(name=term.name, start=0.0, mean=0.0, sd=LATE.late_s, scale=LATE.late_s, unit="s", local=True) for _, term in late
        ]  # fmt: skip
        groups = min(rules.FOLDS, len(rows))
        top = LATE.top_rad / (2.0 * np.pi * LATE.late_s) if late else np.inf
        self.stretches = [
            Stretch(name=run.point.log.name, group=f"part {k % groups + 1}", dt=run.dt, weight=run.counted.astype(float)[:, None],
                    top_Hz=top)
            for k, run in enumerate(rows)
        ]  # fmt: skip
        self.rows = list(rows)
        self.x = []
        for r, run in enumerate(rows):
            delays = [run.column(term) if k == r else np.zeros(len(run.target)) for k, term in late]
            self.x.append(np.column_stack([*(run.column(term) for term in terms), *delays]))

    def residuals(self, theta: Array, at: Sequence[int]) -> list[Array]:
        return [(self.x[k] @ theta - self.rows[k].target)[:, None] for k in at]

    def slopes(self, theta: Array, at: Sequence[int]) -> list[Array]:
        del theta
        return [self.x[k][:, None, :] for k in at]


def number_of(term: Term, scale: float, declared: bool) -> Number:
    """A term's coefficient. A declared one has its prior; a candidate keeps its sign."""
    known = declared and term.declared is not None and term.uncertainty > 0
    low, high = (0.0 if term.sign > 0 else -np.inf), (0.0 if term.sign < 0 else np.inf)
    return Number(
        name=term.name, start=term.declared or 0.0, low=low, high=high, scale=scale, unit=term.unit,
        mean=(term.declared or 0.0) if known else np.nan, sd=term.uncertainty if known else np.nan,
    )  # fmt: skip


@dataclass(frozen=True)
class TermCandidate:
    """A candidate of the file, at one place if it is a hinge."""

    term: Term

    @property
    def title(self) -> str:
        return self.term.name

    @property
    def amplitude(self) -> Sequence[str]:
        return (self.term.name,)

    @property
    def begin(self) -> dict[str, float]:
        return {}

    @property
    def has_memory(self) -> bool:
        return False

    @property
    def place(self) -> str:
        return ""

    @property
    def numbers(self) -> Sequence[str]:
        return self.amplitude


class BalanceMachine:
    """A balance with its candidates, as the search asks for it."""

    def __init__(self, balance: OwnBalance, points: Sequence[Point]) -> None:
        self.balance = balance
        self.rows = [one for one in (rows_of(balance, point) for point in points) if one is not None]
        if len(self.rows) < 2:
            raise HexsimError(
                f"balance {balance.name}: {len(self.rows)} runs have enough rows that count; two are needed"
            )
        self.late = late_terms(balance, self.rows)
        self.data = [run_data(balance, run.point) for run in self.rows]
        self.candidates_of = [
            TermCandidate(term=one) for term in balance.candidates for one in variants(term, self.data)
        ]
        self._placed: dict[tuple[Term, ...], Chosen] = {}

    def of(self, terms: Sequence[Term], rows: Sequence[Rows] | None = None) -> BalanceProblem:
        return BalanceProblem(
            self.balance, rows or self.rows, terms, self.late if rows is None else late_terms(self.balance, rows)
        )

    def problem(self, chosen: Sequence[TermCandidate]) -> BalanceProblem:
        return self.of([*self.balance.terms, *self.placed(chosen)])

    def placed(self, chosen: Sequence[TermCandidate]) -> Chosen:
        """Terms of candidates, each hinge at its best place beside those before it."""
        key = tuple(one.term for one in chosen)
        if key and key not in self._placed:
            before = self.placed(chosen[:-1])
            self._placed[key] = (*before, placed(self.balance, self.data, before, key[-1]))
        return self._placed.get(key, ())

    def candidates(
        self, chosen: Sequence[TermCandidate], now: Fit
    ) -> tuple[BalanceProblem, list[tuple[TermCandidate, list[str]]]]:
        names = {one.title for one in chosen}
        offered = [one for one in self.candidates_of if one.title not in names]
        own = [distinct(one.term, k) for k, one in enumerate(offered)]
        del now
        problem = self.of([*self.balance.terms, *self.placed(chosen), *own])
        return problem, [(one, [term.name]) for one, term in zip(offered, own, strict=True)]

    def free_forms(self, chosen: Sequence[TermCandidate], now: Fit) -> Sequence[Sequence[TermCandidate]]:
        """None: a balance is a sum of terms that its file names."""
        del chosen, now
        return ()

    def loosened(self, effect: TermCandidate, chosen: Sequence[TermCandidate], now: Fit) -> TermCandidate:
        """The term itself: its form is the file's."""
        del chosen, now
        return effect


def distinct(term: Term, k: int) -> Term:
    return replace(term, name=f"{term.name} #{k}")


def late_terms(balance: OwnBalance, rows: Sequence[Rows]) -> list[tuple[int, Term]]:
    """What a small delay of each aligned channel does to the declared balance of each run."""

    def left(point: Point) -> Array:
        n = len(point.log.time)
        return np.broadcast_to(balance.target(point), (n,)) - sum(
            ((term.declared or 0.0) * term.column(point) for term in balance.terms), np.zeros(n)
        )

    return [
        (k, Term(name=f"delay of {channel} in {run.point.log.name}", unit="s", column=by_delay(left, channel)))
        for k, run in enumerate(rows) for channel in run.point.shifts_s
    ]  # fmt: skip
