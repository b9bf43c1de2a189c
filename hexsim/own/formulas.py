"""Formulas of a model file: text to a checked tree, and a tree to a symbolic expression.

A file is data. Text is parsed by Python's own `ast` and walked here over a whitelist of nodes; nothing of it is ever evaluated as
code. Expressions, their derivatives and common parts are sympy's; what is not smooth has a class here with the derivative that a
simulation needs (sympy's own Max and Abs rewrite themselves at length and differentiate into Heaviside(0)).
"""

from __future__ import annotations

import ast
import functools
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import sympy

from hexsim.errors import HexsimError


class Bounds(NamedTuple):
    """Largest formula."""

    longest: int = 4000  # characters of a formula
    most_nodes: int = 4000  # of a formula with the formulas it names put in
    deepest: int = 10  # formulas that name formulas


BOUNDS = Bounds()

Expr = Any  # of sympy, whose stubs know less than sympy does
RATES = ("rate", "rate2")  # derivatives under a window: balances only
OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
TINY = 1e-30  # argument below which a root's slope is that of TINY


class step(sympy.Function):
    """1 where x > 0, else 0. Its derivative is taken as 0."""

    nargs = 1

    @classmethod
    def eval(cls, x):
        return sympy.Integer(1 if x > 0 else 0) if x.is_Number else None

    def fdiff(self, argindex=1):
        return sympy.Integer(0)


class side(sympy.Function):
    """-1, 0 or 1, the sign of x."""

    nargs = 1

    def fdiff(self, argindex=1):
        return sympy.Integer(0)


class positive(sympy.Function):
    """max(x, 0)."""

    nargs = 1

    def fdiff(self, argindex=1):
        return step(self.args[0])


class size(sympy.Function):
    """|x|."""

    nargs = 1

    def fdiff(self, argindex=1):
        return side(self.args[0])


class root(sympy.Function):
    """sign(x) sqrt(|x|): flow through an orifice over its pressure drop."""

    nargs = 1

    @classmethod
    def eval(cls, x):
        return sympy.sign(x) * sympy.sqrt(abs(x)) if x.is_Number else None

    def fdiff(self, argindex=1):
        return root_slope(self.args[0])


class root_slope(sympy.Function):
    """1 / (2 sqrt(|x|)), bounded at 0."""

    nargs = 1

    def fdiff(self, argindex=1):
        return sympy.Integer(0)


class power(sympy.Function):
    """x**y for x > 0, else 0."""

    nargs = 2

    def fdiff(self, argindex=1):
        x, y = self.args
        slope: Any = power(x, y - 1)  # pyright: ignore[reportOperatorIssue]
        return y * slope if argindex == 1 else self * logarithm(x)


class logarithm(sympy.Function):
    """log(max(x, TINY))."""

    nargs = 1

    def fdiff(self, argindex=1):
        above: Any = positive(self.args[0])
        return step(self.args[0]) / (above + TINY)


def larger(a: Expr, b: Expr) -> Expr:
    return a + positive(b - a)


def smaller(a: Expr, b: Expr) -> Expr:
    return a - positive(a - b)


FUNCTIONS: dict[str, tuple[int, Callable[..., Expr]]] = {
    "abs": (1, size),
    "sign": (1, side),
    "step": (1, step),
    "sqrt": (1, lambda x: root(positive(x))),
    "root": (1, root),
    "exp": (1, sympy.exp),
    "log": (1, logarithm),
    "tanh": (1, sympy.tanh),
    "sin": (1, sympy.sin),
    "cos": (1, sympy.cos),
    "min": (2, smaller),
    "max": (2, larger),
}


def tree_of(
    text: str,
    where: str,
    functions: Iterable[str] = FUNCTIONS,
    *,
    most_levels: int = 200,  # of brackets and operators in each other; a sum of n terms has n
) -> ast.expr:
    """The checked tree of a formula: numbers, names, + - * / ** and these functions. Raises HexsimError for anything else."""
    if len(text) > BOUNDS.longest:
        raise HexsimError(
            f"{where}: a formula of {len(text)} characters; at most {BOUNDS.longest}: give parts of it a name"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        nodes = list(ast.walk(tree))
        levels = depth_of(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise HexsimError(
            f"{where}: {text[:60]!r} is no formula; write for example 'abs(velocity_m_s) * velocity_m_s'"
        ) from None
    if levels > most_levels:
        raise HexsimError(f"{where}: a formula of {levels} levels; at most {most_levels}: give parts of it a name")
    for node in nodes:
        check(node, where, tuple(functions))
    return tree


def depth_of(tree: ast.AST) -> int:
    """Levels of a tree, without recursion."""
    levels, layer = 0, [tree]
    while layer:
        levels, layer = levels + 1, [child for node in layer for child in ast.iter_child_nodes(node)]
    return levels


def check(node: ast.AST, where: str, functions: tuple[str, ...]) -> None:
    """One node of a formula. Raises HexsimError where it is not on the list."""
    if isinstance(node, ast.Call):
        name = node.func.id if isinstance(node.func, ast.Name) else "?"
        count = FUNCTIONS[name][0] if name in FUNCTIONS else 1
        if name not in functions or node.keywords or len(node.args) != count:
            raise HexsimError(
                f"{where}: {name[:40]} is no function of a formula, or has other arguments; there are "
                f"{', '.join(functions)}"
            )
    elif isinstance(node, ast.Constant):
        if not isinstance(node.value, int | float) or isinstance(node.value, bool) or not finite(node.value):
            raise HexsimError(f"{where}: {str(node.value)[:40]!r} is no finite number")
    elif isinstance(node, ast.BinOp):
        if not isinstance(node.op, OPERATORS):
            raise HexsimError(f"{where}: only + - * / ** are known in a formula")
    elif isinstance(node, ast.UnaryOp):
        if not isinstance(node.op, ast.USub | ast.UAdd):
            raise HexsimError(f"{where}: only a sign may stand before a number or a name")
    elif not isinstance(node, ast.Name | ast.Load | ast.operator | ast.unaryop):
        raise HexsimError(
            f"{where}: a formula has numbers, names, + - * / ** and functions, not {ast.unparse(node)[:60]!r}"
        )


def finite(value: int | float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def names_of(tree: ast.expr) -> set[str]:
    """Names in a formula, its functions left out."""
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and id(node) not in called}


def expression(tree: ast.expr, names: Mapping[str, Expr], where: str) -> Expr:
    """The tree as a symbolic expression. Raises HexsimError for a name that is not there."""
    if isinstance(tree, ast.Constant):
        return sympy.Float(float(tree.value))  # pyright: ignore[reportArgumentType]
    if isinstance(tree, ast.Name):
        if tree.id not in names:
            raise HexsimError(f"{where}: nothing is called {tree.id!r}; there are {', '.join(sorted(names))[:400]}")
        return names[tree.id]
    if isinstance(tree, ast.UnaryOp):
        value = expression(tree.operand, names, where)
        return -value if isinstance(tree.op, ast.USub) else value
    if isinstance(tree, ast.BinOp):
        return combined(tree.op, expression(tree.left, names, where), expression(tree.right, names, where), where)
    assert isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name)
    return FUNCTIONS[tree.func.id][1](*(expression(one, names, where) for one in tree.args))


def combined(op: ast.operator, a: Expr, b: Expr, where: str) -> Expr:
    """a op b. A power with a whole exponent is a product, any other one is that of a positive number."""
    if isinstance(op, ast.Add):
        return a + b
    if isinstance(op, ast.Sub):
        return a - b
    if isinstance(op, ast.Mult):
        return a * b
    if isinstance(op, ast.Div):
        if b.is_zero:
            raise HexsimError(f"{where}: a division by 0")
        return a / b
    if b.is_Number and float(b).is_integer() and abs(float(b)) <= 8:
        if a.is_zero and float(b) < 0:
            raise HexsimError(f"{where}: a division by 0")
        return a ** int(float(b))
    return power(a, b)


VALUES: dict[str, Callable[..., Any]] = {
    "exp": lambda x: np.exp(np.minimum(x, 700.0)),
    "logarithm": lambda x: np.log(np.maximum(x, TINY)),
    "tanh": np.tanh,
    "sin": np.sin,
    "cos": np.cos,
    "root": lambda x: np.sign(x) * np.sqrt(np.abs(x)),
    "step": lambda x: 1.0 * (np.asarray(x) > 0.0),
    "side": np.sign,
    "positive": lambda x: np.maximum(x, 0.0),
    "size": np.abs,
    "power": lambda x, y: np.where(x > 0.0, np.exp(np.minimum(y * np.log(np.maximum(x, TINY)), 700.0)), 0.0),
}


def valued(expr: Expr, known: dict[Expr, Any]) -> Any:
    """An expression with arrays for its symbols; what was computed once is taken from `known` again, which grows."""
    if expr not in known:
        if expr.is_Number:
            return float(expr)
        name = "power" if expr.is_Pow and not expr.exp.is_Integer else type(expr).__name__
        args = [valued(one, known) for one in expr.args]
        if name in VALUES:
            known[expr] = VALUES[name](*args)
        elif expr.is_Pow:
            known[expr] = args[0] ** int(expr.exp)
        else:
            known[expr] = functools.reduce(operator.mul if expr.is_Mul else operator.add, args)
    return known[expr]
