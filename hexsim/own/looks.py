"""Formulas to first order, many at once, about a motion that they are not in.

At amplitude 0 a formula does not change the motion. So its values along the motion are known beforehand: they drive a model as columns
of a log do, and one compiled model serves every formula of its place. What joins a sum counts by its mean over each sample (Simpson's
rule; states in the middle are the mean of both ends). Friction that holds at rest changes the motion's equations, and what an input
becomes may follow other effects there: those formulas stand in a model as they are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from hexsim.inference.likelihood import Fit
from hexsim.inference.remainder import theta_of
from hexsim.own.declaration import Declaration, ParameterTable
from hexsim.own.effects import Candidate, distinct, joined, with_values
from hexsim.own.folder import OwnFolder
from hexsim.own.forms import Form
from hexsim.own.formulas import BOUNDS, Expr, valued
from hexsim.own.model import Resolver, model_of
from hexsim.own.problem import OwnProblem, problem_of

Array = np.ndarray
T = TypeVar("T")
Look = tuple[OwnProblem, list[tuple[Form, list[str]]]]


def looks(
    folder: OwnFolder, columns: set[str], declared: Declaration, every: Sequence[Form], about: Fit
) -> Iterator[Look]:
    """Models with some of the formulas at amplitude 0, and each with the names of its amplitudes there."""
    kinds: dict[tuple[str, bool], list[Form]] = {}
    for form in every:
        kinds.setdefault((form.candidate.place, "forwards" in form.candidate.formulas), []).append(form)
    for (_, rests), forms in kinds.items():
        if rests or forms[0].candidate.what == "input":
            yield from as_written(folder, columns, declared, forms)
        else:
            yield from as_columns(folder, columns, declared, forms, about)


def as_columns(
    folder: OwnFolder,
    columns: set[str],
    declared: Declaration,
    forms: Sequence[Form],
    about: Fit,
    *,
    count: int = 128,  # columns of a model: their sum is below the longest formula; twice as many save a hundredth of the time
) -> Iterator[Look]:
    """Formulas of one place by their values along the motion."""
    first = forms[0].candidate
    tag = next(name for k in range(1000) if not taken(name := f"look{k}", declared, columns))
    given, sizes = [f"{tag}_{k}" for k in range(count)], [f"{tag}_of_{k}" for k in range(count)]
    [key] = first.formulas
    text = " + ".join(f"{size} * {one}" for size, one in zip(sizes, given, strict=True))
    shared = replace(
        first,
        formulas={key: first.unchanged + text},
        numbers={name: ParameterTable(start=0.0, scale=1.0) for name in sizes},
        amplitude=tuple(sizes),
    )
    model = model_of(joined(declared, shared, neutral=True), folder.where, columns | set(given))
    model = replace(model, held=tuple(one in given or was for one, was in zip(model.inputs, model.held, strict=True)))
    logs = [replace(log, columns={**log.columns, **dict.fromkeys(given, np.zeros(log.n))}) for log in folder.fit]
    base = problem_of(model, logs, folder.where)
    theta = theta_of(base, about)
    at = [model.inputs.index(name) for name in given]
    values = Along(declared, folder.where, base, theta, first.what == "output")
    for part in parted(forms, lambda form: len(form.candidate.amplitude), count):
        offered, made = [], [record.inputs.copy() for record in base.records]
        column = 0
        for form in part:
            own = form.candidate.amplitude
            for name in own:
                for inputs, value in zip(made, values.of(form.candidate, name), strict=True):
                    inputs[:, at[column]] = value
                column += 1
            offered.append((form, sizes[column - len(own) : column]))
        records = [replace(record, inputs=inputs) for record, inputs in zip(base.records, made, strict=True)]
        yield OwnProblem(base.simulator, records), offered


def taken(name: str, declared: Declaration, columns: set[str]) -> bool:
    known = (declared.parameters, declared.states, declared.memory, declared.constants, columns)
    return any(one.startswith(name) for names in known for one in names)


def parted(own: Iterable[T], size: Callable[[T], int], most: int) -> Iterator[list[T]]:
    """Parts that together are no larger than this; one alone may be."""
    part: list[T] = []
    for one in own:
        if part and sum(map(size, part)) + size(one) > most:
            yield part
            part = []
        part.append(one)
    if part:
        yield part


class Along:
    """Formulas along a model's motion: at its samples, or in the mean over each sample (Simpson's rule)."""

    def __init__(self, declared: Declaration, where: str, problem: OwnProblem, theta: Array, at_samples: bool) -> None:
        self.declared, self.where = declared, where
        # share of a sample's duration -> weight of the values there
        self.weights = {0.0: 1.0} if at_samples else {0.0: 1.0 / 6.0, 0.5: 4.0 / 6.0, 1.0: 1.0 / 6.0}
        self.read: dict[tuple[str, str], Expr] = {}
        self.motions = [motion(problem, k, theta, list(self.weights)) for k in range(len(problem.records))]

    def of(self, candidate: Candidate, amplitude: str) -> list[Array]:
        """What one of its amplitudes would add were it 1, along each record."""
        [text] = candidate.formulas.values()
        key = text.removeprefix(candidate.unchanged), amplitude
        if key not in self.read:
            resolver = Resolver(self.declared, self.where)
            self.read[key] = resolver.of(key[0], candidate.title).diff(resolver.symbols[amplitude])
        inside = {name: float(table.start or 0.0) for name, table in candidate.numbers.items()}
        found = []
        for known in self.motions:
            named = {**known, **inside}
            symbols = {one: named[str(one)] for one in self.read[key].free_symbols}
            with np.errstate(all="ignore"):
                values = valued(self.read[key], symbols)
            shape = (len(self.weights), len(known["time_s"]) // len(self.weights))
            values = np.broadcast_to(np.nan_to_num(values), len(known["time_s"])).reshape(shape)
            found.append(np.array(list(self.weights.values())) @ values)
        return found


def motion(problem: OwnProblem, k: int, theta: Array, shares: Sequence[float]) -> dict[str, Any]:
    """Values of states, inputs and numbers along a record, by name: at these shares of every sample's duration, one after the other."""
    model, record, p = problem.simulator.model, problem.records[k], theta[problem.columns[k]]

    def at(values: Array, held: bool = False) -> Array:
        ahead = values if held else np.append(values[1:], values[-1])
        return np.concatenate([values + share * (ahead - values) for share in shares])

    inputs, states = problem.simulator.inputs(record, p), problem.free_run(k, theta).states
    known: dict[str, Any] = {
        name: at(values, held) for name, values, held in zip(model.inputs, inputs.T, model.held, strict=True)
    }
    known |= {name: at(values) for name, values in zip(model.states, states.T, strict=True)}
    known |= {number.name: float(value) for number, value in zip(model.numbers, p, strict=True)}
    return known | {"time_s": at(record.time), "step_s": record.dt}


def as_written(folder: OwnFolder, columns: set[str], declared: Declaration, forms: Sequence[Form]) -> Iterator[Look]:
    """Formulas of one place in one model as far as its formulas have room, with the numbers inside their functions fixed."""
    pairs = [(form, distinct(fixed(form.candidate), k)) for k, form in enumerate(forms)]
    length = lambda pair: sum(map(len, pair[1].formulas.values())) + len(" + ")  # noqa: E731
    for part in parted(pairs, length, BOUNDS.longest):
        model = model_of(joined(declared, merged([one for _, one in part]), neutral=True), folder.where, columns)
        yield problem_of(model, folder.fit, folder.where), [(form, list(one.amplitude)) for form, one in part]


def fixed(candidate: Candidate) -> Candidate:
    """With values for the numbers that are no amplitudes."""
    values = {
        name: f"({table.start!r})" for name, table in candidate.numbers.items() if name not in candidate.amplitude
    }
    return replace(
        candidate,
        formulas={key: with_values(text, values) for key, text in candidate.formulas.items()},
        numbers={name: candidate.numbers[name] for name in candidate.amplitude},
    )


def merged(own: Sequence[Candidate]) -> Candidate:
    """Candidates of one place as one; what they add are terms of a sum."""
    formulas: dict[str, str] = {}
    for one in own:
        for key, text in one.formulas.items():
            formulas[key] = f"{formulas[key]} + {text.removeprefix(one.unchanged)}" if key in formulas else text
    numbers = {name: table for one in own for name, table in one.numbers.items()}
    return replace(own[0], formulas=formulas, numbers=numbers, amplitude=tuple(numbers))
