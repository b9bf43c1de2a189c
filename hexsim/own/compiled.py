"""A model's equations and their derivatives, compiled: sympy differentiates and finds common parts, numba compiles.

The source that numba gets is printed by sympy from expressions whose symbols are renamed to x0, u0, p0 here; no text of a file is in
it. Every model has one compiled function of one signature, so that the integrator is compiled once and kept on disk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
import sympy
from numba import types
from sympy.printing.pycode import PythonCodePrinter

from hexsim.own.formulas import Expr
from hexsim.own.model import BEFORE, Model

Array = np.ndarray
RATES, AFTER, OUTPUTS, STARTS = range(4)
VECTOR = types.Array(types.float64, 1, "C")
SIGNATURE = types.int64(types.int64, VECTOR, VECTOR, VECTOR, VECTOR)  # what, x, u or s, p, out
TINY = 1e-30
ONE, TWO = types.float64(types.float64), types.float64(types.float64, types.float64)


@numba.njit(ONE, cache=True)
def step(x):
    return 1.0 if x > 0.0 else 0.0


@numba.njit(ONE, cache=True)
def side(x):
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@numba.njit(ONE, cache=True)
def positive(x):
    return x if x > 0.0 else 0.0 * x


@numba.njit(ONE, cache=True)
def root(x):
    return math.sqrt(x) if x > 0.0 else -math.sqrt(-x)


@numba.njit(ONE, cache=True)
def root_slope(x):
    return 0.5 / math.sqrt(max(abs(x), TINY))


@numba.njit(TWO, cache=True)
def power(x, y):
    return math.exp(min(y * math.log(x), 700.0)) if x > 0.0 else 0.0


@numba.njit(ONE, cache=True)
def logarithm(x):
    return math.log(max(x, TINY))


@numba.njit(ONE, cache=True)
def exponential(x):
    return math.exp(min(x, 700.0))


HELPERS = {"step": step, "side": side, "positive": positive, "root": root, "root_slope": root_slope, "power": power,
           "logarithm": logarithm, "exponential": exponential, "size": abs, "math": math}  # fmt: skip


class Printer(PythonCodePrinter):
    """sympy's printer with the functions above."""

    def _print_Function(self, expr):
        return f"{type(expr).__name__}({', '.join(self._print(one) for one in expr.args)})"

    def _print_exp(self, expr):
        return f"exponential({self._print(expr.args[0])})"


def compiled(model: Model) -> Any:
    """The function (what, x, u, p, out) of a model: out holds values, derivatives by x (rows first), then by p."""
    namespace: dict[str, Any] = dict(HELPERS)
    exec(compile(source(model), f"<equations of {len(model.states)} states>", "exec"), namespace)
    return numba.njit(SIGNATURE, error_model="numpy")(namespace["equations"])


def source(model: Model) -> str:
    """Python source of the equations."""
    states = [model.symbols[name] for name in model.states if name in model.symbols]
    x, p = states, [model.symbols[number.name] for number in model.numbers]
    u = [model.symbols[name] for name in (*model.inputs, "time_s", "step_s")]
    before = [model.symbols.get(name + BEFORE, sympy.Symbol(name + BEFORE, real=True)) for name in model.states]
    s = [sympy.Symbol(f"{function}({column})", real=True) for function, column in model.firsts]
    lines = ["def equations(what, x, u, p, out):"]
    lines += [f"    p{i} = p[{i}]" for i in range(len(p))]
    parts = ((model.rates, x, u), (model.after, [*x, *before], u), (model.observed, x, u), (model.starts, [], s))
    for what, (values, by, given) in enumerate(parts):
        names = {one: sympy.Symbol(f"x{i}", real=True) for i, one in enumerate([*x, *before])}
        names |= {one: sympy.Symbol(f"p{i}", real=True) for i, one in enumerate(p)}
        names |= {one: sympy.Symbol(f"u{i}", real=True) for i, one in enumerate(given)}
        used = set().union(*(one.free_symbols for one in values)) if values else set()
        lines.append(f"    if what == {what}:")
        lines += [f"        x{i} = x[{i}]" for i, one in enumerate([*x, *before]) if one in used]
        lines += [f"        u{i} = u[{i}]" for i, one in enumerate(given) if one in used]
        lines += block([one.xreplace(names) for one in values], [names[one] for one in by], [names[one] for one in p])
        lines.append("        return 0")
    return "\n".join([*lines, "    return 1"])


def block(values: Sequence[Expr], by: Sequence[sympy.Symbol], p: Sequence[sympy.Symbol]) -> list[str]:
    """Assignments of values and of those derivatives that are not 0."""
    n, entries = len(values), list(values)
    entries += [value.diff(one) for value in values for one in by] + [value.diff(one) for value in values for one in p]
    kept = [(i, entry) for i, entry in enumerate(entries) if i < n or not entry.is_zero]
    common, reduced = sympy.cse([entry for _, entry in kept], symbols=sympy.numbered_symbols("t", real=True))
    printer = Printer({"fully_qualified_modules": True})
    lines = [f"        {name} = {printer.doprint(value)}" for name, value in common]
    return lines + [
        f"        out[{i}] = {printer.doprint(value)}" for (i, _), value in zip(kept, reduced, strict=True)
    ]  # fmt: skip


INTEGRATOR = types.Tuple((types.Array(types.float64, 2, "C"), types.Array(types.float64, 3, "C"), types.Array(types.float64, 2, "C")))(
    types.FunctionType(SIGNATURE), VECTOR, types.Array(types.float64, 2, "C"), types.Array(types.float64, 2, "C"),
    types.Array(types.boolean, 1, "C"), VECTOR, types.float64, types.float64, types.int64, types.int64, types.int64,
    types.boolean, types.boolean,
)  # fmt: skip


@numba.njit(INTEGRATOR, cache=True)
def integrated(f, x0, s0, inputs, held, p, t0, dt, steps, stages, n_outputs, with_after, sensitive):
    """States at samples (n, nx) with outputs (n, ny) and their derivatives by p (n, ny, np), by the variational equation.

    x0: (nx,). s0: (nx, np) its derivatives. inputs: (n, nu) at samples. stages: 4 Runge-Kutta, 2 Heun, 1 Euler. NaN from where it leaves
    the finite numbers.
    """
    n, nu, nx, np_ = inputs.shape[0], inputs.shape[1], x0.shape[0], s0.shape[1]
    h = dt / steps
    y, jac, states = np.full((n, n_outputs), np.nan), np.zeros((n, n_outputs, np_)), np.full((n, nx), np.nan)
    out = np.zeros(nx + nx * nx + nx * np_)
    out_after = np.zeros(nx + 2 * nx * nx + nx * np_)
    both, s_before = np.zeros(2 * nx), s0.copy()
    out_y = np.zeros(n_outputs + n_outputs * nx + n_outputs * np_)
    x, s, u = x0.copy(), s0.copy(), np.zeros(nu + 2)
    xs, ss, ax, a_s, row = x0.copy(), s0.copy(), np.zeros(nx), np.zeros((nx, np_)), np.zeros(nx)
    u[nu + 1] = h
    for i in range(n):
        for k in range(nu):
            u[k] = inputs[i, k]
        u[nu] = t0 + i * dt
        f(2, x, u, p, out_y)
        for a in range(nx):
            states[i, a] = x[a]
        for a in range(n_outputs):
            y[i, a] = out_y[a]
            if sensitive:
                for b in range(np_):
                    total = out_y[n_outputs + n_outputs * nx + a * np_ + b]
                    for q in range(nx):
                        total += out_y[n_outputs + a * nx + q] * s[q, b]
                    jac[i, a, b] = total
        if i + 1 == n:
            break
        for j in range(steps):
            ax[:] = 0.0
            a_s[:] = 0.0
            both[nx:] = x
            if with_after and sensitive:
                s_before[:] = s
            xs[:] = x
            ss[:] = s
            for stage in range(stages):
                c, w = 0.0, 1.0
                if stages == 2:
                    c, w = (0.0, 0.5) if stage == 0 else (1.0, 0.5)
                elif stages == 4:
                    c = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                    w = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
                share = (j + c) / steps
                for k in range(nu):
                    u[k] = inputs[i, k] if held[k] else inputs[i, k] + share * (inputs[i + 1, k] - inputs[i, k])
                u[nu] = t0 + (i + share) * dt
                both[:nx] = xs
                f(0, both, u, p, out)
                ahead = 1.0 if stages == 2 else (0.5 if stage < 2 else 1.0)
                for a in range(nx):
                    ax[a] += w * out[a]
                if sensitive:
                    for b in range(np_):
                        for a in range(nx):
                            total = out[nx + nx * nx + a * np_ + b]
                            for q in range(nx):
                                total += out[nx + a * nx + q] * ss[q, b]
                            row[a] = total
                            a_s[a, b] += w * total
                        for a in range(nx):
                            ss[a, b] = s[a, b] + ahead * h * row[a]
                for a in range(nx):
                    xs[a] = x[a] + ahead * h * out[a]
            for a in range(nx):
                x[a] += h * ax[a]
                if sensitive:
                    for b in range(np_):
                        s[a, b] += h * a_s[a, b]
            if with_after:
                share = (j + 1.0) / steps
                for k in range(nu):
                    u[k] = inputs[i, k] if held[k] else inputs[i, k] + share * (inputs[i + 1, k] - inputs[i, k])
                u[nu] = t0 + (i + share) * dt
                both[:nx] = x
                f(1, both, u, p, out_after)
                if sensitive:
                    for b in range(np_):
                        for a in range(nx):
                            total = out_after[nx + 2 * nx * nx + a * np_ + b]
                            for q in range(nx):
                                total += out_after[nx + 2 * a * nx + q] * s[q, b]
                                total += out_after[nx + (2 * a + 1) * nx + q] * s_before[q, b]
                            row[a] = total
                        for a in range(nx):
                            ss[a, b] = row[a]
                    s[:] = ss
                for a in range(nx):
                    x[a] = out_after[a]
        for a in range(nx):
            if not abs(x[a]) < 1e100:
                return y, jac, states
    return y, jac, states
