"""A declared model, resolved: states, numbers and inputs in order, and their equations as symbolic expressions.

    dx/dt = rates(x, before, u, p)  between samples, by the scheme; of before only whether it rests or slides, and where to
    x     = after(x, before, u, p)  once a time step: friction at rest, backlash, limits; before: x at the beginning of it
    y     = outputs(x, u, p)        at samples
    x(0)  = starts(s, p)            s: first values of columns

u holds the inputs, then time_s and step_s. p holds the machine's numbers and those of a run.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import sympy

from hexsim.errors import HexsimError
from hexsim.inference.contract import Number
from hexsim.own.declaration import ModelTables, ParameterTable, StateTable
from hexsim.own.elements import memory_states
from hexsim.own.formulas import BOUNDS, FUNCTIONS, TINY, Expr, expression, names_of, positive, step, tree_of

CLOCK = ("time_s", "step_s")
FIRST = ("first", "first_rate")
START = "start of "
FREE = "free"
BEFORE = " before"
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,79}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """See the module. firsts: (function, column) of s. delays: input -> expression of p [s]. noises: of outputs, nan: from the
    residual."""

    states: tuple[str, ...]
    numbers: tuple[Number, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    firsts: tuple[tuple[str, str], ...]
    symbols: dict[str, sympy.Symbol]
    rates: tuple[Expr, ...]
    after: tuple[Expr, ...]
    observed: tuple[Expr, ...]
    starts: tuple[Expr, ...]
    delays: dict[str, Expr]
    noises: tuple[float, ...]
    held: tuple[bool, ...]
    tables: ModelTables


def number_of(name: str, table: ParameterTable, where: str) -> Number:
    """Bounds and prior of a declared number. Raises HexsimError where nothing can be between them."""
    low = -math.inf if table.low is None else table.low
    high = math.inf if table.high is None else table.high
    low, high = (max(low, 0.0) if table.sign > 0 else low), (min(high, 0.0) if table.sign < 0 else high)
    if not low < high:
        raise HexsimError(f"{where} [parameters.{name}]: nothing is between low = {low:g} and high = {high:g}")
    if (table.declared is None) != (table.uncertainty is None):
        raise HexsimError(f"{where} [parameters.{name}]: declared and uncertainty (one standard deviation) go together")
    start = table.start if table.start is not None else table.declared
    if start is None:
        start = 0.5 * (low + high) if math.isfinite(low) and math.isfinite(high) else 0.0
    if not low <= start <= high:
        raise HexsimError(f"{where} [parameters.{name}]: start {start:g} is outside {low:g} to {high:g}")
    span = high - low if math.isfinite(high - low) else 1.0
    return Number(
        name=name,
        start=start,
        low=low,
        high=high,
        unit=table.unit,
        of_run=table.each == "run",
        mean=math.nan if table.declared is None else table.declared,
        sd=table.uncertainty or math.nan,
        scale=table.scale or table.uncertainty or (abs(start) if start else span),
    )


class Resolver:
    """Names of a file to expressions, constants put in as they are named. elements: states of memory, with what a step does to them."""

    def __init__(self, tables: ModelTables, where: str) -> None:
        self.elements, given = memory_states(tables, where)
        self.where, self.tables = where, tables
        self.states = tables.states | {name: state for name, (state, _) in self.elements.items()}
        self.trees: dict[str, ast.expr] = {}
        self.symbols: dict[str, sympy.Symbol] = {}
        self.done: dict[str, Expr] = {}
        self.inputs: list[str] = []
        self.nodes = 0
        for name in (*self.states, *tables.parameters, *CLOCK):
            self.symbols[name] = sympy.Symbol(name, real=True)
        self.given: dict[str, str] = {
            key: value if isinstance(value, str) else repr(value) for key, value in tables.constants.items()
        } | given

    def of(self, text: str, place: str, depth: int = 0) -> Expr:
        """The expression of a formula; a name that is nothing else is a column of the logs."""
        where = f"{self.where} {place}"
        tree = tree_of(text, where)
        self.nodes += sum(1 for _ in ast.walk(tree))
        if depth > BOUNDS.deepest or self.nodes > BOUNDS.most_nodes:
            raise HexsimError(f"{where}: formulas that are too large together, or name each other in a circle")
        return expression(tree, {name: self.named(name, depth) for name in names_of(tree)}, where)

    def named(self, name: str, depth: int) -> Expr:
        if name in self.symbols:
            return self.symbols[name]
        if name not in self.done and name in self.given:
            self.done[name] = self.of(self.given[name], f"[{name}]", depth + 1)
        if name in self.done:
            return self.done[name]
        self.inputs.append(name)
        self.symbols[name] = sympy.Symbol(name, real=True)
        return self.symbols[name]


def model_of(tables: ModelTables, where: str, columns: set[str] | None = None) -> Model:
    """The model of a file. columns: those of the logs; a name that is neither is refused. Raises HexsimError."""
    if not tables.states and not tables.outputs:
        raise HexsimError(f"{where}: a model that is simulated has [states] or [outputs]")
    resolver = Resolver(tables, where)
    check_names(tables, where)
    elements, states = resolver.elements, resolver.states
    rates, after = [], []
    for name, state in states.items():
        place = f"[states.{name}]"
        rates.append(rate_of(resolver, name, state, place))
        after.append(after_of(resolver, name, state, elements[name][1] if name in elements else None, place))
    observed = [resolver.of(table.formula, f"[outputs.{name}]") for name, table in tables.outputs.items()]
    delays = {
        name: resolver.of(table.delay, f"[signals.{name}] delay")
        for name, table in tables.signals.items()
        if table.delay
    }
    numbers = [number_of(name, table, where) for name, table in tables.parameters.items()]
    starts, firsts, free = starts_of(resolver, states, where)
    if columns is not None:
        unknown = [name for name in resolver.inputs if name not in columns]
        if unknown:
            raise HexsimError(
                f"{where}: {unknown[0]!r} is no column of the logs and no state, parameter or constant; the logs have "
                f"{', '.join(sorted(columns))[:400]}"
            )
    inputs = tuple(dict.fromkeys(resolver.inputs))
    used = set().union(*(one.free_symbols for one in (*rates, *after, *observed, *delays.values())))
    numbers = [replace(one, local=one.of_run or resolver.symbols[one.name] not in used) for one in numbers]
    return Model(
        states=tuple(states),
        numbers=(*numbers, *free),
        inputs=inputs,
        outputs=tuple(tables.outputs),
        firsts=tuple(firsts),
        symbols=resolver.symbols,
        rates=tuple(rates),
        after=tuple(after),
        observed=tuple(observed),
        starts=tuple(starts),
        delays={name: value for name, value in delays.items() if name in inputs},
        noises=tuple(table.noise or math.nan for table in tables.outputs.values()),
        held=tuple(name in tables.signals and tables.signals[name].hold for name in inputs),
        tables=tables,
    )


def check_names(tables: ModelTables, where: str) -> None:
    """Names are words, and each means one thing."""
    seen: dict[str, str] = {}
    for kind in ("constants", "parameters", "states", "memory"):
        for name in getattr(tables, kind):
            if not NAME.fullmatch(name) or name in FUNCTIONS or name in (*FIRST, *CLOCK):
                raise HexsimError(
                    f"{where} [{kind}]: {name[:40]!r} cannot be a name: letters, digits and _, no function"
                )
            if name in seen:
                raise HexsimError(f"{where}: {name} stands under [{seen[name]}] and under [{kind}]: name it once")
            seen[name] = kind


def rate_of(resolver: Resolver, name: str, state: StateTable, place: str) -> Expr:
    if state.rate is not None and state.sum is not None:
        raise HexsimError(f"{resolver.where} {place}: give rate, or sum with storage, not both")
    if state.sum is not None:
        total = resolver.of(state.sum, place)
        if state.dry:
            forwards, backwards = (resolver.of(text, place) for text in (state.dry * 2)[:2])
            before = resolver.symbols.setdefault(name + BEFORE, sympy.Symbol(name + BEFORE, real=True))
            total = beside_friction(total, before, forwards, backwards)
        return total / resolver.of(state.storage, place)
    if state.dry:
        raise HexsimError(
            f"{resolver.where} {place}: dry friction needs the state's balance: give sum and storage, not rate"
        )
    return resolver.of(state.rate, place) if state.rate is not None else sympy.Integer(0)


def after_of(resolver: Resolver, name: str, state: StateTable, own: str | None, place: str) -> Expr:
    """What a time step ends with: an element's own step, friction that holds at rest, limits."""
    x: Expr = resolver.symbols[name]
    if own is not None:
        x = resolver.of(own, place)
    if state.dry:
        forwards, backwards = (resolver.of(text, place) for text in (state.dry * 2)[:2])
        before = resolver.symbols.setdefault(name + BEFORE, sympy.Symbol(name + BEFORE, real=True))
        total, still = resolver.of(state.sum or "0", place), sympy.Integer(0)
        pushed = beside_friction(total, still, forwards, backwards).subs({x: still})
        x = stopped(x, before, pushed * resolver.symbols["step_s"] / resolver.of(state.storage, place))
    if state.high is not None:
        x = x - positive(x - resolver.of(state.high, place))
    if state.low is not None:
        low = resolver.of(state.low, place)
        x = low + positive(x - low)
    return x


def beside_friction(total: Expr, v: Expr, forwards: Expr, backwards: Expr) -> Expr:
    """A sum with dry friction (Coulomb, set-valued): what slides is slowed, what rests goes on only beyond the friction.

    v: the state at the beginning of the time step, so that all stages of a step have one direction.
    """
    above: Any = positive  # the functions as sympy types them know no arithmetic
    beyond: Any = step
    from_rest = above(total - forwards) - above(-total - backwards)
    moving = beyond(v) * (total - forwards) + beyond(-v) * (total + backwards)
    return moving + (1 - beyond(v) - beyond(-v)) * from_rest


def stopped(v: Expr, before: Expr, from_rest: Expr) -> Expr:
    """v at the end of a time step in which it has changed its sign: it was at rest then, and goes on from there for the rest of the step.

    So what stops stays exactly at rest (Moreau 1988 for the implicit step), and derivatives carry over a reversal as those of the
    continuous motion do. before: at the beginning of the step; from_rest: what a whole step from rest gives.
    """
    above: Any = positive
    beyond: Any = step
    down, up = beyond(before) * beyond(-v), beyond(-before) * beyond(v)
    left = down * above(-v) / (above(-v) + above(before) + TINY) + up * above(v) / (above(v) + above(-before) + TINY)
    return (1 - down - up) * v + left * from_rest


def starts_of(
    resolver: Resolver, states: Mapping[str, StateTable], where: str
) -> tuple[list[Expr], list[tuple[str, str]], list[Number]]:
    """Where states begin: expressions of p and of first values s (symbols in order of `firsts`), and numbers for free ones."""
    starts, firsts, free = [], [], []
    first_of: dict[sympy.Symbol, Expr] = {}

    def value(name: str, function: str = "first") -> sympy.Symbol:
        if (function, name) not in firsts:
            firsts.append((function, name))
        return sympy.Symbol(f"{function}({name})", real=True)

    for name, state in states.items():
        place = f"{where} [states.{name}] start"
        if state.start == FREE:
            start = Number(
                name=START + name,
                start=state.guess,
                low=-math.inf,
                high=math.inf,
                scale=abs(state.guess) or 1.0,
                unit=state.unit,
                of_run=True,
                local=True,
            )
            resolver.symbols[start.name] = sympy.Symbol(start.name, real=True)
            free.append(start)
            made: Expr = resolver.symbols[start.name]
        else:
            made = start_of(resolver, str(state.start), place, value)
        made = made.xreplace(first_of)
        made = made.xreplace({resolver.symbols[one]: value(one) for one in resolver.inputs})
        if name in resolver.symbols:
            first_of[resolver.symbols[name]] = made
        starts.append(made)
    return [one.xreplace(first_of) for one in starts], firsts, free


def start_of(resolver: Resolver, text: str, place: str, value) -> Expr:
    """A formula that may have first(COLUMN) and first_rate(COLUMN)."""
    tree = tree_of(text, place, (*FUNCTIONS, *FIRST))
    names: dict[str, Expr] = {}

    class Firsts(ast.NodeTransformer):
        def visit_Call(self, node: ast.Call) -> ast.expr:
            assert isinstance(node.func, ast.Name)
            if node.func.id not in FIRST:
                self.generic_visit(node)
                return node
            if not isinstance(node.args[0], ast.Name):
                raise HexsimError(f"{place}: {node.func.id}(...) takes the name of a column")
            key = f"{node.func.id} {node.args[0].id}"
            names[key] = value(node.args[0].id, node.func.id)
            return ast.Name(id=key, ctx=ast.Load())

    tree = Firsts().visit(tree)
    names |= {name: resolver.named(name, 0) for name in names_of(tree) if name not in names}
    return expression(tree, names, place)
