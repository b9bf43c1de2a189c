"""Effects that a model of one's own may lack: the general ones (effects.toml) and those of its file, put into a declaration.

An effect is text in the language of a model file. `offered` writes it for every place it may act at, with starts and bounds from the
sizes of signals; `joined` gives the declaration with it, as a person would have written it.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TypeVar

import numpy as np
import sympy

from hexsim.errors import HexsimError
from hexsim.own.declaration import EffectNumber, EffectRow, MemoryTable, ModelTables, ParameterTable, StateTable
from hexsim.own.formulas import expression, names_of, tree_of

Array = np.ndarray
Tables = TypeVar("Tables", bound=ModelTables)
FORMULAS = ("adds", "elsewhere", "forwards", "backwards", "becomes", "storage")


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Typical sizes: of a place in the model, X, S, P, M, H, C, Y, N, and of the run, T, D."""

    X: float = 1.0
    S: float = 1.0
    P: float = 1.0
    M: float = 0.0
    H: float = 1.0
    C: float = 0.0
    Y: float = 1.0
    N: float = 1.0
    T: float = 1.0
    D: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect at one place of a model. formulas: as FORMULAS. numbers: names -> what is searched. corners: of its curve, on
    each side, over these signals. shape: tells tries apart. unchanged: how what it becomes begins, + and what it adds. even: the same in
    both directions of `on`."""

    name: str
    on: str
    what: str
    other: str | None
    formulas: dict[str, str]
    numbers: dict[str, ParameterTable]
    amplitude: tuple[str, ...]
    memory: tuple[str, MemoryTable] | None = None
    switch: str | None = None
    curve: tuple[str, str] | None = None
    rival: bool = False
    corners: tuple[int, ...] = ()
    shape: str = ""
    unchanged: str = ""
    over: tuple[str, ...] = ()
    even: bool = False

    @property
    def title(self) -> str:
        return f"{self.name} in {self.on}" + (f" to {self.other}" if self.other else "")

    @property
    def place(self) -> str:
        """Where in the model it acts."""
        return f"{self.what} {self.on}"

    @property
    def begin(self) -> dict[str, float]:
        """Where a search with it begins: amplitudes a tenth of their scale off 0, on their side."""
        tables = {name: self.numbers[name] for name in self.amplitude}
        return {name: 0.1 * (table.scale or 1.0) * (table.sign or 1) for name, table in tables.items()}

    @property
    def shapes(self) -> Array:
        """Of a free form (numbers, shapes): polynomials over its corners, orthogonal and without mean, the smooth ones first; each number
        alone where it has no corners."""
        if self.curve is None:
            return np.eye(len(self.amplitude))
        sides = [np.linalg.qr(np.vander(np.linspace(-1, 1, n), increasing=True))[0] for n in self.corners]
        whole = sides[0] if len(sides) == 1 else np.kron(sides[0], sides[1])
        return whole[:-1, self.order]

    @property
    def order(self) -> Array:
        """Of the polynomials over the corners: the smooth ones first."""
        return np.argsort(np.sum(np.indices(self.corners), axis=0).ravel(), kind="stable")[1:]

    @property
    def signals(self) -> set[str]:
        """Names in its formulas and its curve, and the direction of friction that holds at rest."""
        own = self.names_in([*self.formulas.values(), *([self.curve[1]] if self.curve else [])])
        return own | ({self.on} if "forwards" in self.formulas else set())

    def names_in(self, texts: Iterable[str]) -> set[str]:
        """All but its numbers."""
        return set().union(*(names_of(tree_of(text, self.title)) for text in texts)) - set(self.numbers)

    def shapes_like(self, effect: Candidate) -> Array:
        """Which shapes of this free form are of an effect's kind: at its place, over its signals alone, and of an even one even. Any is
        of one that remembers, or that is a constant."""
        count = self.shapes.shape[1]
        if self.has_memory or self.place != effect.place:
            return np.zeros(count, dtype=bool)
        if effect.has_memory or not effect.signals or self.curve is None:
            return np.ones(count, dtype=bool)
        factor = self.names_in(self.formulas.values()) - {self.curve[0]}
        alike, turns = np.full(count, factor <= effect.signals), np.full(count, self.on in factor, dtype=int)
        for name, axis in zip(self.over, np.indices(self.corners), strict=True):
            degree = axis.ravel()[self.order]
            alike &= (degree == 0) | (self.names_in([name]) <= effect.signals)
            turns += degree * (name == self.on)
        if effect.even:
            alike &= turns % 2 == 0
        return alike

    @property
    def has_memory(self) -> bool:
        return self.memory is not None


@cache
def library() -> tuple[EffectRow, ...]:
    """The general effects."""
    text = files("hexsim.own").joinpath("effects.toml").read_text(encoding="utf-8")
    return tuple(EffectRow.model_validate(row) for row in tomllib.loads(text)["effects"])


def offered(tables: ModelTables, inputs: Iterable[str], sizes: Callable[[str, str], Sizes]) -> list[Candidate]:
    """Every effect at every place it may act at. inputs: columns that drive the model. sizes: of (what, name)."""
    found: list[Candidate] = []
    for row in (*library(), *(own for own in tables.effects)):
        for on, other in places(row, tables, inputs):
            found.extend(candidates(row, on, other, tables, sizes(row.what, on)))
    return found


def places(row: EffectRow, tables: ModelTables, inputs: Iterable[str]) -> list[tuple[str, str | None]]:
    """(where, the other state or None) that a row is for."""
    if row.what == "input":
        named = (
            [name for name in inputs if name in tables.signals and tables.signals[name].quantity]
            if row.on is None
            else [row.on]
        )
        return [(name, None) for name in named]
    if row.what == "output":
        return [(name, None) for name in (tables.outputs if row.on is None else [row.on])]
    if row.on is not None and row.on not in tables.states:
        raise HexsimError(f"[[effects]] {row.name}: on = {row.on!r} is no state; there are {', '.join(tables.states)}")
    fits = [
        name
        for name, state in tables.states.items()
        if name == row.on
        or (row.on is None and state.quantity in row.of and state.quantity is not None and of_state(row, tables, name))
    ]
    if needs(row, "{place}") or (needs(row, "{curve}") and (not row.over or "{place}" in row.over)):
        fits = [name for name in fits if place_of(name, tables)]
    if not needs(row, "{other}") and row.elsewhere is None:
        return [(name, None) for name in fits]
    same = [name for name, state in tables.states.items() if state.sum and state.quantity in row.of]
    pairs = [(name, other) for name in fits for other in same if other != name]
    return [pair for k, pair in enumerate(pairs) if row.state or pair[::-1] not in pairs[:k]]


def of_state(row: EffectRow, tables: ModelTables, name: str) -> bool:
    """Is the state itself of the quantity that the row asks for?"""
    return row.state is None or quantity_of(name, tables) in (row.state, None)


def quantity_of(name: str, tables: ModelTables) -> str | None:
    """Of a state itself: as its signal or output says, else by its name."""
    table = tables.signals.get(name)
    if table is not None and table.quantity:
        return table.quantity
    return next(
        (word for word in ("pressure", "level") if word in name or (word == "level" and "height" in name)), None
    )


def needs(row: EffectRow, brace: str) -> bool:
    return any(brace in (getattr(row, key) or "") for key in FORMULAS)


def place_of(name: str, tables: ModelTables) -> str | None:
    """The state whose rate is this one."""
    return next(
        (one for one, state in tables.states.items() if state.rate is not None and state.rate.strip() == name), None
    )


UNITS = {
    "force": "N",
    "torque": "N m",
    "pressure": "Pa",
    "flow": "m3/s",
    "level": "m",
    "voltage": "V",
    "current": "A",
    "position": "m",
    "velocity": "m/s",
    "angle": "rad",
    "speed": "rad/s",
}


def known_unit(tables: ModelTables, name: str) -> str:
    """Unit of a state, a signal or an output; empty where none is declared."""
    quantity = tables.signals[name].quantity if name in tables.signals else None
    state, output = tables.states.get(name), tables.outputs.get(name)
    return (state.unit if state else "") or (output.unit if output else "") or UNITS.get(quantity or "", "")


SIZE = re.compile(r"(?<![\w\[])[SXPY](?![A-Za-z_\]])")  # a size in a unit, and no letter of Pa or of a [signal]


def with_units(unit: str, tables: ModelTables, on: str, what: str) -> str:
    """A unit of S, X, P, Y in those of the place; empty where one of them is not declared."""
    state, own = tables.states.get(on) if what == "sum" else None, known_unit(tables, on)
    sizes = {
        "S": UNITS.get(state.quantity or "", "") if state else "",
        "X": own,
        "Y": own,
        "P": known_unit(tables, place_of(on, tables) or on),
    }
    if not all(sizes[one] for one in SIZE.findall(unit)):
        return ""
    return SIZE.sub(lambda one: f"({sizes[one[0]]})" if "/" in sizes[one[0]] else sizes[one[0]], unit)


def candidates(row: EffectRow, on: str, other: str | None, tables: ModelTables, sizes: Sizes) -> list[Candidate]:
    """The effect there, once for each try of its numbers."""
    state = tables.states.get(on) if row.what == "sum" else None
    taken = {*tables.parameters, *tables.states, *tables.memory, *tables.constants}
    count = sum(name.startswith(f"{next(iter(row.parameters), 'x')}_{on}") for name in taken)
    tag = (
        ("_of" if row.name.endswith("friction") and needs(row, "{curve}") else "")
        + f"_{on}"
        + (f"_to_{other}" if other else "")
        + (f"_{count + 1}" if count else "")
    )
    braces = {"{x}": on, "{other}": other or "", "{place}": place_of(on, tables) or ""}
    if state is not None:
        braces |= {"{sum}": f"({state.sum})", "{storage}": f"({state.storage})"}
    output = tables.outputs.get(on) if row.what == "output" else None
    braces["{y}"] = f"({output.formula})" if output else on
    rename = {key: key + tag for key in row.parameters}
    numbers, amplitude, curve, over = {}, [], "", []
    for k, (key, number) in enumerate(row.parameters.items()):
        if key == "curve" or row.over:
            over = [braces.get(one, on) for one in row.over or ["{place}"]]
            spans = [(one, *(span_of(sizes) if one == on and state else (sizes.M, sizes.P))) for one in over]
            curve, more = curve_of(rename[key], spans, number, sizes, row.corners)
            numbers |= more
            amplitude += list(more)
        else:
            numbers[rename[key]] = table_of(number, sizes, neutral=k == 0 and not row.switch, where=row.name)
            amplitude += [rename[key]] if not row.switch and (k == 0 or number.start is None) else []
    memory = None
    if row.memory is not None:
        memory = f"memory_{re.sub(r'[^a-z]+', '_', row.name.lower()).strip('_')}{tag}"
        braces["{memory}"] = memory
    switch = f"switch_{re.sub(r'[^a-z]+', '_', row.name.lower()).strip('_')}{tag}" if row.switch else None
    named = f"{next(iter(row.parameters), '')}_curve{tag}"
    braces |= {"{curve}": named, "{switch}": switch or ""}

    def fill(text: str) -> str:
        for key, value in rename.items():
            text = re.sub(rf"(?<!{{)\b{key}\b", value, text)
        text = re.sub(r"\bM\b", f"({float(sizes.M):.9g})", text)
        for key, value in braces.items():
            text = text.replace(key, value)
        return text

    formulas = {key: fill(getattr(row, key)) for key in FORMULAS if getattr(row, key) is not None}
    made = None
    numbers = {
        name: number.model_copy(update={"unit": with_units(number.unit, tables, on, row.what)})
        for name, number in numbers.items()
    }
    if memory is not None and row.memory is not None:
        begins = row.memory.start if tables.simulation.anew_s is None else None  # a number of the run, not of its parts
        made = (memory, row.memory.changed(fill).model_copy(update={"start": begins}))
    base = Candidate(
        name=row.name,
        on=on,
        what=row.what,
        other=other,
        formulas=formulas,
        numbers=numbers,
        amplitude=tuple(amplitude),
        memory=made,
        switch=switch,
        curve=(named, curve) if curve else None,
        rival=row.rival,
        corners=(row.corners,) * max(len(row.over), 1),
        over=tuple(over),
        even=row.even,
    )
    return [base, *tried(row, base, rename, sizes)]


def span_of(sizes: Sizes) -> tuple[float, float]:
    """(middle, half) of a state itself: about 0 where it has two signs."""
    return (0.0, abs(sizes.C) + sizes.H) if abs(sizes.C) < sizes.H else (sizes.C, sizes.H)


def tried(row: EffectRow, base: Candidate, rename: Mapping[str, str], sizes: Sizes) -> list[Candidate]:
    found = []
    for key, number in row.parameters.items():
        for k, start in enumerate(number.tries):
            table = base.numbers[rename[key]].model_copy(update={"start": value_of(start, sizes, row.name)})
            found.append(
                Candidate(
                    **{**base.__dict__, "numbers": base.numbers | {rename[key]: table}, "shape": f"{key} {k + 2}"}
                )
            )
    return found


def curve_of(
    name: str, spans: Sequence[tuple[str, float, float]], number: EffectNumber, sizes: Sizes, count: int
) -> tuple[str, dict[str, ParameterTable]]:
    """Piecewise linear over one place or (bilinear) two, with numbers at its corners; the last one makes the mean 0.

    spans: place, middle and half range of each.
    """
    hats = [
        [f"max(0, 1 - abs({place} - ({middle - half + k * width:.7g})) / {width:.7g})" for k in range(count)]
        for place, middle, half in spans
        for width in [2.0 * half / (count - 1)]
    ]
    names = [f"{name}_{k + 1}" for k in range(count ** len(spans) - 1)]
    numbers = {one: table_of(number, sizes, neutral=True, where=name) for one in names}
    return surface([*names, f"-({' + '.join(names)})"], hats), numbers


def surface(corners: Sequence[str], hats: Sequence[Sequence[str]]) -> str:
    """Sum of corners times the products of their hats, one list of hats a place."""
    first, *others = hats
    n = len(corners) // len(first)
    parts = [corners[k * n : (k + 1) * n] for k in range(len(first))]
    inner = [surface(part, others) if others else part[0] for part in parts]
    return " + ".join(f"({one}) * {hat}" for one, hat in zip(inner, first, strict=True))


def table_of(number: EffectNumber, sizes: Sizes, *, neutral: bool, where: str) -> ParameterTable:
    """A number with its sizes put in; an amplitude starts at 0."""
    value = lambda text: None if text is None else value_of(text, sizes, where)  # noqa: E731
    start = value(number.start)
    if start is None and (neutral or number.scale is not None):
        start = 0.0
    low, high = value(number.low), value(number.high)
    if start is not None:  # a run of few samples: a start in samples may be beyond a bound in durations
        low = low if low is None else min(low, start)
        high = high if high is None else max(high, start)
    return ParameterTable(
        start=start, low=low, high=high, scale=value(number.scale) or None, sign=number.sign, unit=number.unit
    )


def value_of(text: float | str, sizes: Sizes, where: str) -> float:
    """A number, or a formula of sizes."""
    if not isinstance(text, str):
        return float(text)
    names = {key: sympy.Float(getattr(sizes, key)) for key in sizes.__dataclass_fields__}
    return float(expression(tree_of(text, where), names, where).evalf())


def joined(tables: Tables, candidate: Candidate, *, neutral: bool = False) -> Tables:
    """The declaration with the effect in it. neutral: amplitudes at 0 (a switch is a number then), else off 0 as a search begins."""
    candidate, numbers, constants = as_it_acts(tables, candidate), dict(candidate.numbers), dict(tables.constants)
    if candidate.switch and neutral:
        numbers[candidate.switch] = ParameterTable(start=0.0, scale=1.0)
    elif candidate.switch:
        constants[candidate.switch] = 1.0
    if candidate.curve:
        constants |= dict([candidate.curve])
    memory = tables.memory | ({candidate.memory[0]: candidate.memory[1]} if candidate.memory else {})
    made = tables.model_copy(
        update={"parameters": tables.parameters | numbers, "constants": constants, "memory": memory}
    )
    if candidate.what == "sum":
        return in_sum(made, candidate)
    if candidate.what == "output":
        table = made.outputs[candidate.on].model_copy(update={"formula": candidate.formulas["becomes"]})
        return made.model_copy(update={"outputs": made.outputs | {candidate.on: table}})
    return at_input(made, candidate)


def as_it_acts(tables: ModelTables, candidate: Candidate) -> Candidate:
    """The candidate, which may be made beside other effects of the inputs, for the inputs as they act in these tables."""
    if candidate.what == "input":
        return candidate

    def now(name: str) -> str:
        base, _, k = name.rpartition("__")
        return (
            acting(tables, base)[0] if base in tables.signals and k.isdigit() and name not in tables.signals else name
        )

    swap = lambda text: re.sub(r"[A-Za-z_][A-Za-z0-9_]*", lambda found: now(found.group()), text)  # noqa: E731
    memory = (candidate.memory[0], candidate.memory[1].changed(swap)) if candidate.memory else None
    return replace(candidate, formulas={key: swap(text) for key, text in candidate.formulas.items()}, memory=memory)


def acting(tables: ModelTables, name: str) -> tuple[str, int]:
    """(what stands for an input behind the effects at it, how many these are)."""
    count = sum(one.startswith(f"{name}__") for one in tables.constants)
    return f"{name}__{count}" if count else name, count


def in_sum(tables: Tables, candidate: Candidate) -> Tables:
    """What joins a sum has a name of its own among the constants."""
    state, constants = tables.states[candidate.on], dict(tables.constants)
    tag = re.sub(r"[^a-z0-9]+", "_", candidate.name.lower()).strip("_") + "_in_" + candidate.on
    named = {}
    for key, text in candidate.formulas.items():
        if key != "storage":
            names = (f"{key}_{tag}" + (f"_{k}" if k else "") for k in range(len(constants) + 1))
            named[key] = next(name for name in names if name not in constants)
            constants[named[key]] = text
    update: dict = {}
    if "adds" in named:
        update["sum"] = f"{state.sum} + {named['adds']}"
    if "storage" in candidate.formulas:
        update["storage"] = candidate.formulas["storage"]
    if "forwards" in named:
        before = (state.dry * 2)[:2] or ["0", "0"]
        update["dry"] = [f"{a} + {named[key]}" for a, key in zip(before, ("forwards", "backwards"), strict=True)]
    states = tables.states | {candidate.on: state.model_copy(update=update)}
    if "elsewhere" in named and candidate.other:
        other = states[candidate.other]
        states |= {candidate.other: other.model_copy(update={"sum": f"{other.sum} + {named['elsewhere']}"})}
    return tables.model_copy(update={"states": states, "constants": constants})


def at_input(tables: Tables, candidate: Candidate) -> Tables:
    """The input's name stands for what it becomes, in every formula but those of the effect itself."""
    old, count = acting(tables, candidate.on)  # effects at one input act one after the other
    acts = f"{candidate.on}__{count + 1}"
    own = candidate.memory[0] if candidate.memory else None
    swap = lambda text: replaced(text, old, acts)  # noqa: E731
    states = {name: renamed_state(state, swap) for name, state in tables.states.items()}
    outputs = {
        name: table.model_copy(update={"formula": swap(table.formula)}) for name, table in tables.outputs.items()
    }
    constants = {
        name: swap(text) if isinstance(text, str) and not name.startswith(f"{candidate.on}__") else text
        for name, text in tables.constants.items()
    }
    if candidate.curve:
        constants[candidate.curve[0]] = replaced(candidate.curve[1], candidate.on, old)
    constants[acts] = replaced(candidate.formulas["becomes"], candidate.on, old)
    memory = {}
    for name, table in tables.memory.items():
        if name == own:
            memory[name] = table.model_copy(update={"of": replaced(table.of, candidate.on, old)})
        else:
            memory[name] = (
                table if name.endswith(f"_{candidate.on}") else table.model_copy(update={"of": swap(table.of)})
            )
    return tables.model_copy(update={"states": states, "outputs": outputs, "constants": constants, "memory": memory})


def renamed_state(state: StateTable, swap: Callable[[str], str]) -> StateTable:
    update = {key: swap(value) for key in ("rate", "sum", "storage") if (value := getattr(state, key)) is not None}
    return state.model_copy(update=update | {"dry": [swap(one) for one in state.dry]})


def replaced(text: str, old: str, new: str) -> str:
    """A formula with one name for another."""
    tree = tree_of(text, old)
    if old not in names_of(tree):
        return text

    class Swap(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            return ast.Name(id=new, ctx=ast.Load()) if node.id == old else node

    return ast.unparse(Swap().visit(tree))


def distinct(candidate: Candidate, k: int) -> Candidate:
    """The same with names that no other candidate has."""
    names = [
        *candidate.numbers,
        *([candidate.switch] if candidate.switch else []),
        *([candidate.memory[0]] if candidate.memory else []),
        *([candidate.curve[0]] if candidate.curve else []),
    ]
    new = {name: f"{name}_c{k}" for name in names}
    swap = lambda text: with_values(text, new)  # noqa: E731
    memory = (new[candidate.memory[0]], candidate.memory[1].changed(swap)) if candidate.memory else None
    return replace(
        candidate,
        formulas={key: swap(text) for key, text in candidate.formulas.items()},
        numbers={new[name]: table for name, table in candidate.numbers.items()},
        amplitude=tuple(new[name] for name in candidate.amplitude),
        memory=memory,
        switch=new[candidate.switch] if candidate.switch else None,
        curve=(new[candidate.curve[0]], swap(candidate.curve[1])) if candidate.curve else None,
    )


def with_values(text: str, values: Mapping[str, str]) -> str:
    """A formula with other words for some of its names."""
    return re.sub(r"[A-Za-z_][A-Za-z0-9_]*", lambda found: values.get(found.group(), found.group()), text)
