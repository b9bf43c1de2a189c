"""What is left beside names: free forms, each judged as a name is, by what it foretells of motion held out, to first order.

A form speaks against a name in two ways. With shapes of the name's own kind (over its own signals, with its own symmetry) it opens the
name's form. With all others it is another effect, beside which the name must still take something: else it is a stand-in. What no
name is doubted by is the remainder: another statement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut
from hexsim.inference.likelihood import Coefficients, Fit, prior_of, whitened
from hexsim.inference.verdict import Judgment, errors_of, needed, said

Array = np.ndarray
OWN = 1e-3  # of a column's size beside the others: below it there is nothing of its own


class Forms(Protocol):
    """A machine with its free forms."""

    def problem(self, chosen: Sequence[Any]) -> Problem:
        """The declared model with these effects in it."""
        ...

    def free_forms(self, chosen: Sequence[Any], now: Fit) -> Sequence[Sequence[Any]]:
        """The most general laws over the signals that each place of the model can depend on, and memories where something is chosen:
        what is left there shows in them. Each as its parts."""
        ...

    def loosened(self, effect: Any, chosen: Sequence[Any], now: Fit) -> Any:
        """An effect that is chosen, with an error of its form: further numbers, with priors. Itself where it has no form."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Foretold:
    """Of motion held out by so many shapes of a form. gains [nats], errors: as of a Judgment."""

    gains: Array
    errors: dict[str, tuple[float, float, float]]

    @property
    def nats(self) -> float:
        return float(self.gains.sum())

    def stands(self, enough: float) -> bool:
        """Would it be a name?"""
        return said(self.gains, self.errors, "", enough)[0] == "named"


@dataclass(frozen=True, kw_only=True, eq=False)
class Remainder:
    """A free form beside everything named. whole: by how many of its shapes are used. own, other: title of a named effect -> the same
    of the shapes that are of its kind, and of those that are not. beside: the nats that it still takes beside the latter."""

    title: str
    whole: list[Foretold]
    own: dict[str, list[Foretold]]
    other: dict[str, list[Foretold]]
    beside: dict[str, float]


def likeliest(found: Sequence[Foretold], enough: float) -> Foretold | None:
    """Of those that stand."""
    return max((one for one in found if one.stands(enough)), key=lambda one: one.nats, default=None)


def remainders(machine: Forms, chosen: Sequence[Any], now: Fit) -> list[Remainder]:
    """Shapes of a form are tried from smooth to rough (Neyman 1937): a law that resembles the named one differs smoothly from it."""
    found = []
    for form in machine.free_forms(chosen, now):
        try:
            problem = machine.problem([*chosen, *form])
        except HexsimError:
            continue  # together too large to be written
        about = Linear(problem, now)
        names = about.names
        whole = np.concatenate([placed(names, one.amplitude, one.shapes) for one in form], axis=1)
        known: dict[bytes, list[Foretold]] = {}

        def by(mask: Array, whole: Array = whole, about: Linear = about, known: dict = known) -> list[Foretold]:
            if mask.tobytes() not in known:
                known[mask.tobytes()] = about.foretold(whole[:, mask])
            return known[mask.tobytes()]

        mine = {one.title: np.concatenate([part.shapes_like(one) for part in form]) for one in chosen}
        found.append(
            Remainder(
                title=form[0].title,
                whole=by(np.ones(whole.shape[1], dtype=bool)),
                own={title: by(mask) for title, mask in mine.items()},
                other={title: by(~mask) for title, mask in mine.items()},
                beside={one.title: about.still(one.amplitude, whole[:, ~mine[one.title]]) for one in chosen},
            )
        )
    return found


def placed(names: Sequence[str], amplitude: Sequence[str], shapes: Array) -> Array:
    """Shapes of a form's amplitudes (amplitudes, shapes) as columns over all numbers (numbers, shapes)."""
    found = np.zeros((len(names), shapes.shape[1]))
    found[[names.index(name) for name in amplitude]] = shapes
    return found


def looked_at(problem: Problem, now: Fit, at: Sequence[int] | None = None) -> tuple[Array, Array, list[str]]:
    """Slopes and residual of unit variance at the numbers there are, priors below them; names of the columns. at: stretches, default
    all."""
    theta = theta_of(problem, now)
    rest, slopes = whitened(
        Coefficients(problem, range(len(problem.stretches)) if at is None else at), theta, now.spectra
    )
    mean, precision = prior_of(problem.numbers)
    x, y = np.vstack([slopes, np.diag(precision)]), np.concatenate([rest, (theta - mean) * precision])
    return x, y, [number.name for number in problem.numbers]


def theta_of(problem: Problem, now: Fit) -> Array:
    """The numbers there are; others where they begin."""
    known = dict(zip(now.names, (float(value) for value in now.theta), strict=True))
    return np.array([known.get(number.name, number.start) for number in problem.numbers])


class Linear:
    """A model to first order about a fit, each group of stretches foretold from the others."""

    def __init__(self, problem: Problem, now: Fit) -> None:
        every = range(len(problem.stretches))
        self.problem, self.theta = problem, theta_of(problem, now)
        self.x, self.y, self.names = looked_at(problem, now)
        self.rests, self.slopes = problem.residuals(self.theta, every), problem.slopes(self.theta, every)
        data = Coefficients(problem, every)
        of_stretch = np.concatenate([np.full(len(f), k) for f, (k, _) in zip(data.log_f, data.places, strict=True)] * 2)
        self.groups = list(dict.fromkeys(stretch.group for stretch in problem.stretches))
        self.group_of = np.array([self.groups.index(stretch.group) for stretch in problem.stretches])
        self.label = np.full(len(self.y), -1)  # priors are in every group's fit
        self.label[: len(of_stretch)] = self.group_of[of_stretch]
        self.scale = np.array([number.scale for number in problem.numbers])
        local = {number.name for number in problem.numbers if number.local}
        fitted = [k for k, name in enumerate(self.names) if name in now.names]
        self.local = [k for k in fitted if self.names[k] in local]
        self.base = np.eye(len(self.names))[:, [k for k in fitted if self.names[k] not in local]]

    def foretold(self, shapes: Array) -> list[Foretold]:
        """By the first 1, 2, 4 ... of them (numbers, shapes) that have something of their own."""
        shapes = shapes[:, self.independent(shapes)]
        counts = [min(2**k, shapes.shape[1]) for k in range(shapes.shape[1].bit_length() + 1)]
        if not shapes.shape[1]:
            return []
        before = self.held_out(shapes[:, :0])
        found = []
        for count in dict.fromkeys(counts):
            after = self.held_out(shapes[:, :count])
            found.append(Foretold(gains=after.density - before.density, errors=errors_of(before, after)))
        return found

    def independent(self, shapes: Array) -> list[int]:
        """Those that have something of their own beside what was fitted and the earlier ones."""
        base, own = self.x @ np.column_stack([self.base, np.eye(len(self.names))[:, self.local]]), self.x @ shapes
        beside = own - base @ np.linalg.lstsq(base, own, rcond=1e-10)[0]
        size, whole, kept = np.linalg.norm(own, axis=0), np.zeros((len(self.y), 0)), []
        for j in range(own.shape[1]):
            column = beside[:, j] - whole @ (whole.T @ beside[:, j])
            left = float(np.linalg.norm(column))
            if left > OWN * size[j]:
                whole = np.column_stack([whole, column / left])
                kept.append(j)
        return kept

    def held_out(self, shapes: Array) -> HeldOut:
        """With the numbers that were fitted, and shapes, each known beforehand to be of its numbers' typical change. Local numbers are
        those of all motion: they are given, held out or not."""
        directions, own = np.column_stack([self.base, shapes]), self.x[:, self.local]
        typical = np.linalg.norm(shapes * self.scale[:, None], axis=0)
        prior = np.column_stack([np.zeros((shapes.shape[1], self.base.shape[1])), np.diag(1.0 / typical)])
        x = self.x @ directions
        local = np.linalg.lstsq(own, np.column_stack([self.y, x]), rcond=1e-10)[0]
        y, x = self.y - own @ local[:, 0], x - own @ local[:, 1:]
        size = np.linalg.norm(np.vstack([x, prior]), axis=0)
        size = np.where(size > 0, size, 1.0)
        rests, density = list(self.rests), []
        for group in range(len(self.groups)):
            seen = self.label != group
            known = np.concatenate([y[seen], np.zeros(len(prior))])
            step = -np.linalg.lstsq(np.vstack([x[seen], prior]) / size, known, rcond=1e-10)[0] / size
            density.append(-0.5 * float(np.sum((y[~seen] + x[~seen] @ step) ** 2)))
            moved = directions @ step
            moved[self.local] -= local[:, 0] + local[:, 1:] @ step
            for k in np.flatnonzero(self.group_of == group):
                rests[k] = self.rests[k] + self.slopes[k] @ moved
        return HeldOut(problem=self.problem, groups=self.groups, density=np.array(density), rests=rests, fits=[])

    def still(self, amplitude: Sequence[str], shapes: Array) -> float:
        """Nats of these numbers where all that were fitted, and the shapes, are fitted anew (Wald 1943); 0 where there is no size."""
        if not amplitude:
            return 0.0
        fitted = np.column_stack([self.base, np.eye(len(self.names))[:, self.local]])
        x, at = (
            self.x @ np.column_stack([fitted, shapes]),
            np.concatenate([self.theta @ fitted, np.zeros(shapes.shape[1])]),
        )
        own = [int(np.flatnonzero(fitted[self.names.index(name)])[0]) for name in amplitude]
        size = np.linalg.norm(x, axis=0)
        size = np.where(size > 0, size, 1.0)
        covariance = np.linalg.pinv((x / size).T @ (x / size), hermitian=True, rcond=1e-10)
        value = (at * size - covariance @ ((x / size).T @ self.y))[own]
        return 0.5 * float(value @ np.linalg.pinv(covariance[np.ix_(own, own)], hermitian=True) @ value)


def with_open_form(steps: Sequence[Judgment], left: Sequence[Remainder]) -> list[Judgment]:
    """Steps that are no names after all: see the module."""
    doubted = []
    for step in steps:
        enough = needed(step.compared + looks_of(left))
        opened = ((one, likeliest(one.own[step.title], enough)) for one in left)
        there = max(((own.nats, one.title) for one, own in opened if own is not None), default=None)
        taken = ((one, likeliest(one.other[step.title], enough)) for one in left if one.beside[step.title] < enough)
        instead = max(
            ((own.nats, one.title, one.beside[step.title]) for one, own in taken if own is not None), default=None
        )
        if there is not None:
            why = f"beside it {there[1]} gains another {there[0]:.0f} nats: its form is open"
        elif instead is not None:
            why = f"beside {instead[1]} it takes {instead[2]:.1f} nats: a stand-in"
        else:
            continue
        doubted.append(replace(step, verdict="likely", why=why))
    return doubted


def beside_form_errors(machine: Forms, steps: Sequence[Judgment], now: Fit) -> list[Judgment]:
    """Steps that are no names after all: what they take is as likely an error of the form of the other ones. What a name leaves is a
    share of what it takes and follows its own signals; a small second effect beside a large first one must be none of it."""
    chosen, doubted = [one.candidate for one in steps], []
    for step in steps if len(steps) > 1 else ():
        effect = step.candidate
        others = [one if one is effect else machine.loosened(one, chosen, now) for one in chosen]
        try:
            about = Linear(machine.problem(others), now)
        except HexsimError:
            continue  # together too large to be written
        errors = np.eye(len(about.names))[:, [name not in now.names for name in about.names]]
        nats, enough = about.still(effect.amplitude, errors), needed(step.compared)
        if effect.amplitude and nats < enough:
            titles = " and ".join(one.title for one in chosen if one is not effect)
            why = f"beside a slightly other form of {titles} it takes {nats:.1f} nats: a stand-in"
            doubted.append(replace(step, verdict="likely", why=why))
    return doubted


def looks_of(left: Sequence[Remainder]) -> int:
    """How many choices of shapes were compared."""
    return sum(len(one.whole) for one in left)


def beside_names(left: Sequence[Remainder]) -> str:
    """The likeliest of what stands beside everything named, in a sentence; empty where nothing does."""
    enough = needed(looks_of(left))
    found = ((one.title, likeliest(one.whole, enough)) for one in left)
    best = max(
        ((own.nats, title, own) for title, own in found if own is not None), key=lambda one: one[0], default=None
    )
    if best is None:
        return ""
    nats, title, own = best
    errors = ", ".join(f"{name} {before:.3g} -> {after:.3g}" for name, (before, after, _) in own.errors.items())
    return f"left beside it: {title}, {nats:.0f} nats and a held-out error of {errors} to first order"
