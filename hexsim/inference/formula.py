"""A formula for what the library does not explain: the shortest that predicts motion held out, or none.

A formula has a length [nats], the log of how many there are of its size: it is a candidate among exp(length) compared ones. A linear
look ranks all of them; the best are fitted and held out; the look is repeated about the best fit, where it is sharp, until it shows
nothing that was not fitted. A formula stands if nothing else comes near: no other formula, no effect of the library, and beside it no
free form and no memory at its place. Names that a formula alone beats are none, unless its own form is open, too, and it is but a
slightly other form of them; a name is tied with a formula that is as likely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut
from hexsim.inference.likelihood import Fit
from hexsim.inference.notebook import Notebook
from hexsim.inference.remainder import OWN, Forms, looked_at, remainders, with_open_form
from hexsim.inference.search import MOST_TRIED, Found, fitted_with
from hexsim.inference.verdict import GATES, Judgment, comes_to, judge, needed

Array = np.ndarray


class Form(Protocol):
    """A formula at its place. length: see the module."""

    @property
    def candidate(self) -> Any: ...
    @property
    def length(self) -> float: ...
    @property
    def title(self) -> str: ...
    @property
    def exponent(self) -> str | None:
        """The name of an exponent that is fitted."""
        ...

    @property
    def standard(self) -> dict[float, str]:
        """Exponents that have formulas of their own, and the titles of these."""
        ...


class Machine(Forms, Protocol):
    """A machine with its formulas."""

    def forms(self, chosen: Sequence[Any], now: Fit, named: Sequence[Any] = ()) -> Sequence[Any]:
        """Every formula, once for each start of its numbers, but those that a chosen or named effect is."""
        ...

    def looks(
        self, chosen: Sequence[Any], every: Sequence[Any], about: Fit
    ) -> Iterator[tuple[Problem, list[tuple[Any, list[str]]]]]:
        """Models with some of them at amplitude 0, and each with the names of its amplitudes there. about: the motion."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Formula:
    """best: the likeliest formula. rivals: titles of what is as likely. why: no form, if not empty. open: it would be no name itself.
    instead: it predicts better than all names together. tied: formulas that are as likely as the one name, with the odds."""

    best: Judgment
    form: Any
    rivals: list[str]
    why: str
    fitted: list[Judgment]
    open: bool = False
    instead: bool = False
    tied: list[str] = field(default_factory=list)

    @property
    def proven(self) -> bool:
        return not self.why


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """score: nats to first order less the length. begins: where its fits begin, the likeliest start first."""

    form: Any
    score: float
    begins: list[dict[str, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """The model that a formula joins: effects in it, fitted and held out. about, others: a fit near the truth, and what is in it in
    the formula's place."""

    chosen: list[Any]
    now: Fit
    held: HeldOut
    about: Fit
    others: list[Any]

    def beside(self, best: Judgment) -> Ground:
        return replace(self, about=best.fitted, others=[best.candidate])


def formula_of(
    machine: Machine, found: Found, notes: Notebook | None = None, tell: Callable[[str], None] = lambda what: None
) -> Formula | None:
    """The formula for what the names leave, or instead of names that predict worse than it, or why there is none; None where nothing
    calls for one."""
    notes, chosen = notes or Notebook(), [step.candidate for step in found.steps]
    if chosen:
        least = nats_of(found.final_held, found.base_held) - sum(math.log(step.compared) for step in found.steps)
        ground = ground_of(found, [], found.base, found.base_held)
        instead = sought(machine, ground, notes, tell, least - needed(1), chosen)
        if instead is not None and instead.top > least + (needed(1) if len(chosen) == 1 else -needed(1)):
            rivals = [(" + ".join(one.title for one in chosen), math.inf)] if instead.top < least + needed(1) else []
            made = settled(machine, ground, instead, rivals)
            if not (made.open and slightly_other(made.best.after, found)):
                return replace(made, instead=True)
        tied = [] if instead is None or len(chosen) > 1 else as_likely(machine, ground, instead, found, least)
        if tied:
            return Formula(best=tied[0][1], form=tied[0][0], rivals=[], why="", fitted=[], tied=tied_with(tied, least))
    now, held = proven(machine, found, chosen, notes)
    ground = ground_of(found, chosen, now, held)
    judged = sought(machine, ground, notes, tell, needed(1))
    return None if judged is None else settled(machine, ground, judged, library(found, ground))


def as_likely(machine: Machine, ground: Ground, made: Sought, found: Found, least: float) -> list[tuple[Any, Judgment]]:
    """Formulas that could be stated, not less likely than the one name with this score, and neither its law in other words nor, at an
    end of an interval of theirs, it."""
    near = [
        (form, one)
        for form, one in sorted(made.judged, key=lambda pair: -score_of(pair[1]))
        if one.named and least - score_of(one) < needed(1)
        if not comes_to(one, found.steps[0]) and not one_law(one.after, found.final_held)
    ]
    return [(form, one) for form, one in near if not doubts(machine, ground, one)]


def doubts(machine: Machine, ground: Ground, one: Judgment) -> list[Judgment]:
    """The formula with what free forms beside it say against it."""
    return with_open_form([one], remainders(machine, [*ground.chosen, one.candidate], one.fitted))


def one_law(one: HeldOut, other: HeldOut) -> bool:
    """Do they predict the same?"""
    return apart(one, other) < OWN * math.sqrt(sum(float(np.sum(rest**2)) for rest in other.rests))


def slightly_other(one: HeldOut, found: Found) -> bool:
    """Does it predict what the names do, but for an error of their form?"""
    return apart(one, found.final_held) < GATES.form * apart(found.base_held, found.final_held)


def apart(one: HeldOut, other: HeldOut) -> float:
    return math.sqrt(sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.rests, other.rests, strict=True)))


def tied_with(near: list[tuple[Any, Judgment]], least: float) -> list[str]:
    return [f"{one.title}, odds 1 to {math.exp(max(least - score_of(one), 0.0)):.1f}" for _, one in near]


def ground_of(found: Found, chosen: list[Any], now: Fit, held: HeldOut) -> Ground:
    others = [one for one in found.in_model if one.title not in {own.title for own in chosen}]
    if any(one.has_memory or not one.amplitude for one in others):  # these cannot be taken out to first order
        return Ground(chosen=chosen, now=now, held=held, about=now, others=[])
    return Ground(chosen=chosen, now=now, held=held, about=found.final if others else now, others=others)


def proven(machine: Machine, found: Found, chosen: list[Any], notes: Notebook) -> tuple[Fit, HeldOut]:
    """The model with proven names alone."""
    if len(chosen) == len(found.in_model):
        return found.final, found.final_held
    if not chosen:
        return found.base, found.base_held
    return notes.attempt(machine, chosen, lambda problem: fitted_with(problem, found.final, {}))


def nats_of(after: HeldOut, before: HeldOut) -> float:
    return float(np.sum(after.density - before.density))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sought:
    """Formulas that were fitted. ended: a last look showed no other that comes near."""

    judged: list[tuple[Any, Judgment]]
    ended: bool

    @property
    def top(self) -> float:
        """Score of the likeliest that could be a name."""
        return max((score_of(one) for _, one in self.judged if one.named), default=-math.inf)


def sought(
    machine: Machine,
    ground: Ground,
    notes: Notebook,
    tell: Callable[[str], None],
    least: float,
    named: Sequence[Any] = (),
    *,
    most_looks: int = 5,  # linear looks at most
    most_full: int = 2,  # of them over every start of a formula's numbers: from the declared machine, about the first fit
) -> Sought | None:
    """None where no formula's score comes to `least`."""
    best: Judgment | None = None
    judged: dict[str, tuple[Any, Judgment]] = {}
    every = machine.forms(ground.chosen, ground.now, named)
    for k in range(most_looks):
        tell(f"looking for a formula, {k + 1}")
        looks = looked(machine, ground, every)
        every = every if k + 1 < most_full else [look.form for look in looks]
        top = max((look.score for look in looks), default=0.0)
        if best is None and top < (least if ground.others else needed(1)):
            return None
        near = [one for one in looks if best is None or one.score > top - needed(1)]
        new = [one for one in near if one.form.title not in judged][:MOST_TRIED]
        for look in new:
            made = tried(machine, ground, look, notes)
            if made is not None:
                judged[look.form.title] = (look.form, made)
        best = max((one for _, one in judged.values()), key=score_of, default=None)
        if best is None or not new:
            break
        ground = ground.beside(best)
    if best is None or score_of(best) < least:
        return None
    return Sought(judged=list(judged.values()), ended=not new)


def score_of(one: Judgment) -> float:
    return one.nats - math.log(one.compared)


def tried(machine: Machine, ground: Ground, look: Look, notes: Notebook) -> Judgment | None:
    """Fitted from each of its starts: the best fit is the formula's, and what another minimum foretells is not asked."""
    candidate = look.form.candidate

    def fitted_from_all(problem: Problem) -> Fit:
        return min((fitted_with(problem, ground.about, begin) for begin in look.begins), key=lambda fit: fit.cost)

    try:
        fitted, after = notes.attempt(machine, [*ground.chosen, candidate], fitted_from_all)
    except HexsimError:
        return None
    looks = max(round(math.exp(look.form.length)), 1)
    return judge(candidate, candidate.title, candidate.amplitude, fitted, ground.held, after, looks)


def looked(
    machine: Machine,
    ground: Ground,
    every: Sequence[Any],
    *,
    most_starts: int = 3,  # of a formula's fits, where the look cannot tell them apart: of a sine one on either side of the likeliest
) -> list[Look]:
    """Every formula to first order in the place of what is there instead, the likeliest first."""
    now, about = ground.now, ground.about
    found: dict[str, list[Look]] = {}
    for problem, offered in machine.looks([*ground.chosen, *ground.others], every, about):
        at = part_of(problem)
        x, y, names = looked_at(problem, about, at)
        base = x[:, [names.index(name) for name in now.names]]
        for name in (name for one in ground.others for name in one.amplitude):
            y = y - x[:, names.index(name)] * about.value(name)
        turn = np.linalg.qr(base / np.maximum(np.linalg.norm(base, axis=0), 1e-300))[0] if base.size else base
        y = y - turn @ (turn.T @ y)
        for form, amplitude in offered:
            own = x[:, [names.index(name) for name in amplitude]]
            nats, size = gained(own, own - turn @ (turn.T @ own), y)
            low = [table.sign for table in (form.candidate.numbers[name] for name in form.candidate.amplitude)]
            if any(side * value < 0 for side, value in zip(low, size, strict=True)):
                continue
            score = nats * len(problem.stretches) / len(at) - form.length
            if score > 0.0:
                inside = {name: float(table.start or 0.0) for name, table in form.candidate.numbers.items()}
                begin = inside | dict(zip(form.candidate.amplitude, map(float, size), strict=True))
                found.setdefault(form.title, []).append(Look(form=form, score=score, begins=[begin]))
    looks = []
    for starts in found.values():
        starts.sort(key=lambda look: -look.score)
        near = [start for start in starts[:most_starts] if starts[0].score - start.score < needed(1)]
        looks.append(replace(starts[0], begins=[start.begins[0] for start in near]))
    return sorted(looks, key=lambda look: -look.score)


def part_of(
    problem: Problem,
    *,
    most_samples: int = 20_000,  # of a look: it ranks hundreds of formulas, of which the best are fitted to everything
) -> list[int]:
    """Stretches that a look takes: all, or every second, third ... of many samples."""
    samples = sum(len(one.weight) for one in problem.stretches)
    return list(range(0, len(problem.stretches), math.ceil(samples / most_samples)))


def gained(own: Array, beside: Array, y: Array) -> tuple[float, Array]:
    """(fall of half the sum of squares, amplitudes); nothing where a column has nothing of its own."""
    size, left = np.linalg.norm(own, axis=0), np.linalg.norm(beside, axis=0)
    if not np.isfinite(size).all() or not (left > OWN * size).all() or not size.all():
        return 0.0, np.zeros(own.shape[1])
    turn, right = np.linalg.qr(beside / left)
    return 0.5 * float(np.sum((turn.T @ y) ** 2)), -np.linalg.lstsq(right, turn.T @ y, rcond=1e-10)[0] / left


def settled(machine: Machine, ground: Ground, made: Sought, library: list[tuple[str, float]]) -> Formula:
    """The formula with the fewest numbers of those that come near, if nothing else is as likely. library: other titles and their nats."""
    top = max(score_of(one) for _, one in made.judged)
    near = [(form, one) for form, one in made.judged if top - score_of(one) < needed(1)]
    form, best = min(near, key=lambda pair: (pair[1].count, -score_of(pair[1])))
    rivals = [one.title for own, one in near if one is not best and not same(own, one, best)]
    rivals += [title for title, nats in library if best.nats - nats < needed(1)]
    doubted = doubts(machine, ground, best)
    why = ""
    if rivals:
        why = f"{best.title} and {rivals[0]} are as likely"
    elif not best.named:
        why = f"{best.title} is the likeliest: {best.why}"
    elif not made.ended:
        why = f"{best.title} is the likeliest of {len(made.judged)} that were fitted, and others come near"
    elif doubted:
        why = f"{best.title} is the likeliest: {doubted[0].why}"
    fitted = [one for _, one in made.judged]
    return Formula(best=best, form=form, rivals=rivals, why=why, fitted=fitted, open=bool(doubted) or not best.named)


def library(found: Found, ground: Ground) -> list[tuple[str, float]]:
    """What of the library predicts how well: stand-ins in the model together, or else each effect that was refused."""
    known = {one.title for one in ground.chosen}
    stand_ins = [one.title for one in found.in_model if one.title not in known]
    if stand_ins:
        return [(" + ".join(stand_ins), nats_of(found.final_held, ground.held))]
    return [(one.title, one.nats) for one in found.refused]


def same(form: Any, other: Judgment, best: Judgment) -> bool:
    """Has the other one a number more that cannot be told from an end of its interval, or an exponent from the best one's?"""
    if comes_to(other, best):
        return True
    if form.exponent is None or other.count <= best.count:
        return False
    k = other.fitted.names.index(form.exponent)
    n, error = other.fitted.theta[k], other.fitted.errors[k]
    return any(abs(n - p) < GATES.at * error and title == best.title for p, title in form.standard.items())
