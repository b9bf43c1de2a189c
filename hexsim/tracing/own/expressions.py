"""Formulas of a balances.toml: columns, numbers and a few functions, in the weak form wherever a rate stands alone.

    "rate2(position_m)"                         <w'', y>
    "abs(velocity_m_s) * velocity_m_s"          <w, |v| v>
    "pressure_a_Pa - rate(volume_m3)"           <w, p> - <w', V>

Inside a product or a function a rate is taken under a window of its own, which is shorter.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping

import numpy as np

from hexsim.errors import HexsimError
from hexsim.own.formulas import BOUNDS, RATES, tree_of
from hexsim.signals.weak_form import Window
from hexsim.tracing.term_columns import Expression, Point

Array = np.ndarray
FUNCTIONS: dict[str, Callable[..., Array]] = {
    "abs": np.abs, "sign": np.sign, "sqrt": lambda x: np.sqrt(np.maximum(x, 0.0)), "exp": np.exp, "tanh": np.tanh,
    "log": lambda x: np.log(np.maximum(x, 1e-300)), "sin": np.sin, "cos": np.cos, "min": np.minimum, "max": np.maximum,
    "root": lambda x: np.sign(x) * np.sqrt(np.abs(x)), "step": lambda x: (np.asarray(x) > 0).astype(float),
}  # fmt: skip
OPERATORS: dict[type, Callable[[Array, Array], Array]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power,
}  # fmt: skip


def formula(text: str, where: str, names: Mapping[str, str] | None = None) -> Expression:
    """The formula as a function of a point: windowed, (n,). names: what other formulas of the file are called.

    Raises HexsimError for what is no formula; an unknown column is told when it is evaluated.
    """
    node = parsed(text, where, names or {})
    return lambda point: weak(node, point)


def plain(text: str, where: str, names: Mapping[str, str] | None = None) -> Expression:
    """The same sample by sample, not windowed: where it lies on the axis of a hinge, or for an alignment."""
    node = parsed(text, where, names or {})
    return lambda point: np.broadcast_to(strong(node, point), (len(point.log.time),))


def parsed(text: str, where: str, names: Mapping[str, str], depth: int = 0) -> ast.expr:
    """The tree of a formula, with the names of other formulas put in."""
    if depth > BOUNDS.deepest:
        raise HexsimError(f"{where}: the formula is too long or names itself: {text[:60]!r}")
    tree = tree_of(text, where, (*FUNCTIONS, *RATES))

    class Named(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            return parsed(names[node.id], where, names, depth + 1) if node.id in names else node

    return Named().visit(tree)


def constant(node: ast.expr) -> bool:
    """Has it no column?"""
    calls = {one.func for one in ast.walk(node) if isinstance(one, ast.Call)}
    return not any(isinstance(one, ast.Name) and one not in calls for one in ast.walk(node))


def is_rate(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in RATES


def weak(node: ast.expr, point: Point) -> Array:
    """A sum term by term; a rate that stands alone is the window's own; all else is averaged by the window."""
    if isinstance(node, ast.UnaryOp):
        return -weak(node.operand, point) if isinstance(node.op, ast.USub) else weak(node.operand, point)
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Add | ast.Sub):
            return OPERATORS[type(node.op)](weak(node.left, point), weak(node.right, point))
        if isinstance(node.op, ast.Mult) and constant(node.left):
            return strong(node.left, point) * weak(node.right, point)
        if isinstance(node.op, ast.Mult | ast.Div) and constant(node.right):
            return OPERATORS[type(node.op)](weak(node.left, point), strong(node.right, point))
    if is_rate(node):
        assert isinstance(node, ast.Call)
        return rated(node, point, point.window)
    return point.mean(np.broadcast_to(strong(node, point), (len(point.log.time),)))


def rated(node: ast.Call, point: Point, window: Window) -> Array:
    """First or second rate of a column or formula under a window."""
    x = np.broadcast_to(strong(node.args[0], point), (len(point.log.time),)).astype(float)
    assert isinstance(node.func, ast.Name)
    return window.rate(x) if node.func.id == "rate" else window.second_rate(x)


def strong(node: ast.expr, point: Point) -> Array:
    """Sample by sample."""
    if isinstance(node, ast.Constant):
        return np.asarray(float(node.value))  # pyright: ignore[reportArgumentType]
    if isinstance(node, ast.Name):
        if node.id == "time_s":
            return point.log.time - point.log.time[0]
        return point[node.id]
    if isinstance(node, ast.UnaryOp):
        value = strong(node.operand, point)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp):
        with np.errstate(all="ignore"):  # what is no number is refused by its term's name
            return OPERATORS[type(node.op)](strong(node.left, point), strong(node.right, point))
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    if node.func.id in RATES:
        return rated(node, point, point.short or point.window)
    with np.errstate(all="ignore"):
        return FUNCTIONS[node.func.id](*(strong(one, point) for one in node.args))
