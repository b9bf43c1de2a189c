"""A machine of one's own as a folder: balances.toml with its balances, mapping.toml, logs.

What balances.toml may say: see `hexsim.own.declaration`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.own.declaration import BalanceTable, Declaration, TermTable
from hexsim.own.files import model_file
from hexsim.own.folder import declared, logs_of
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing import rules
from hexsim.tracing.own.alignment import Sentences, refined
from hexsim.tracing.own.expressions import formula, plain
from hexsim.tracing.term_columns import OwnBalance, Point, Term, aligned, by_delay


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnMachine:
    """Balances and runs of a folder. sentences: a run -> what was repaired and moved. signs: a balance -> candidates that would take
    much with the other sign, beside other delays."""

    name: str
    balances: tuple[OwnBalance, ...]
    fit: tuple[Point, ...]
    validate: tuple[Point, ...]
    sentences: dict[str, list[str]]
    declaration: Declaration
    signs: dict[str, list[str]] = field(default_factory=dict)


def load_own(folder: Path, fit: Sequence[str] = (), validate: Sequence[str] = ()) -> OwnMachine:
    """The machine of a folder with its runs read and aligned. HexsimError for what cannot be used."""
    asked, where = declared(folder), model_file(folder)
    if not asked.balances:
        raise HexsimError(f"{where}: it has no [[balances]]")
    names = {key: str(value) if isinstance(value, str) else repr(value) for key, value in asked.constants.items()}
    logs, held_out = logs_of(
        folder / asked.runs.folder, folder, fit or asked.runs.fit, validate or asked.runs.validate_on
    )
    sentences: dict[str, list[str]] = {}
    late: Sentences = {}
    points = [point_of(log, asked, names, sentences, late) for log in logs]
    scored = [point_of(log, asked, names, sentences, late) for log in held_out]
    balances = tuple(balance_of(table, names, str(where)) for table in asked.balances)
    beside = [balance_of(fitted_beside(table), names, str(where)) for table in asked.balances]
    constant = [channel for channel, align in asked.align.items() if align.constant]
    signs: dict[str, list[str]] = {}
    points, scored = refined(beside, points, scored, constant, late, signs)
    for run, of_channel in late.items():
        sentences[run].extend(of_channel.values())
    return OwnMachine(
        name=asked.name or folder.resolve().name, balances=balances, fit=in_parts(points, sentences),
        validate=tuple(scored), sentences=sentences, declaration=asked, signs=signs,
    )  # fmt: skip


def point_of(
    log: Log, asked: Declaration, names: dict[str, str], sentences: dict[str, list[str]], late: Sentences
) -> Point:
    """The run with its late channels moved, what is to be said of it, and of each channel in `late`."""
    said = sentences.setdefault(log.name, list(log.losses))
    runs = asked.runs
    short = Window(log.rate, runs.short_window_s or runs.window_s)
    bare = Point(log=log, window=Window(log.rate, runs.window_s), short=short)
    shifts = {}
    for channel, align in asked.align.items():
        if channel not in log.columns:
            said.append(f"{channel} is not in this run: nothing to align")
            continue
        look, where = Window(log.rate, align.window_s), f"[align.{channel}]"
        seen = plain(align.channel or channel, where, names)(Point(log=log, window=look, short=look))
        if not np.ptp(seen) > 0:
            said.append(f"{channel} stands still: nothing to align")
            continue
        reference = plain(align.reference, where, names)(Point(log=log, window=look, short=look))
        found = aligned(look, f"{channel} of run {log.name}", seen, reference, align.constant)
        shifts[channel] = found.delay_s
        late.setdefault(log.name, {})[channel] = found.sentence
    return Point(log=bare.log, window=bare.window, short=bare.short, shifts_s=shifts)


def in_parts(points: Sequence[Point], sentences: dict[str, list[str]]) -> tuple[Point, ...]:
    """Three runs or more as they are; fewer cut into contiguous parts, which stand for runs."""
    if len(points) >= 3:
        return tuple(points)
    found = []
    for point in points:
        n, name = len(point.log.time), point.log.name
        sentences[name].append(
            f"{len(points)} runs are too few to hold one out twice: {name} is cut into {rules.FOLDS} parts"
        )
        for k in range(rules.FOLDS):
            rows = slice(k * n // rules.FOLDS, (k + 1) * n // rules.FOLDS)
            whole = Log(name=f"{name} part {k + 1}", kind=point.log.kind, time=point.log.time, rate=point.log.rate,
                        columns=point.log.columns, repaired=point.log.repaired)  # fmt: skip
            found.append(Point(log=whole, window=point.window, short=point.short, shifts_s=point.shifts_s, rows=rows))
    return tuple(found)


def fitted_beside(table: BalanceTable) -> BalanceTable:
    """The balance with those candidates that can be fitted beside a delay: no other delay, no place to be found."""
    fixed = [one for one in table.candidates if not one.late and (one.place is not None or not _axis(one))]
    return table.model_copy(update={"candidates": fixed})


def balance_of(table: BalanceTable, names: dict[str, str], where: str) -> OwnBalance:
    """Functions of a point for the formulas of a balance."""
    place = f"{where} balance {table.name}"
    target = formula(table.target, place, names)
    terms = tuple(term_of(one, names, place) for one in table.terms)
    declared = [(one.declared or 0.0, term) for one, term in zip(table.terms, terms, strict=True)]

    def left(point: Point) -> np.ndarray:
        return target(point) - sum((c * term.column(point) for c, term in declared), np.zeros(len(point.log.time)))

    candidates = tuple(
        Term(name=one.name, unit=one.unit, column=by_delay(left, one.late), sign=one.sign)
        if one.late
        else term_of(one, names, place)
        for one in table.candidates
    )
    valid = None
    if table.valid is not None:
        inside = plain(table.valid, place, names)
        valid = lambda point: inside(point) > 0.0  # noqa: E731
    return OwnBalance(name=table.name, unit=table.unit, target=target, terms=terms, candidates=candidates, valid=valid)


def term_of(table: TermTable, names: dict[str, str], where: str) -> Term:
    """A term; a hinge or a threshold with its place to be found, or given."""
    where = f"{where} term {table.name}"
    common = {"name": table.name, "unit": table.unit, "declared": table.declared, "uncertainty": table.uncertainty,
              "sign": table.sign}  # fmt: skip
    given = _axis(table)
    if not given:
        return Term(column=formula(table.column, where, names), **common)
    if len(given) > 1:
        raise HexsimError(f"{where}: give one of above, below and step")
    over, factor = plain(getattr(table, given[0]), where, names), plain(table.column, where, names)

    def column_at(point: Point, place: float) -> np.ndarray:
        x = over(point) - place
        shape = {"above": np.maximum(x, 0.0), "below": np.maximum(-x, 0.0), "step": (x > 0).astype(float)}[given[0]]
        return point.mean(factor(point) * shape)

    if table.place is not None:
        at = table.place
        return Term(column=lambda p: column_at(p, at), **common)
    return Term(over=over, column_at=column_at, **common)


def _axis(table: TermTable) -> list[str]:
    """What gives a hinge or a threshold its place."""
    return [key for key in ("above", "below", "step") if getattr(table, key) is not None]
