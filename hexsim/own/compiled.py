"""Equations of a model as machine code, and their integration with sensitivities.

Values and derivatives are sympy's; each distinct subexpression becomes one LLVM instruction by llvmlite, on which numba stands, too.
(The same equations as Python source, compiled by numba, take five to twenty times as long; a trace compiles thirty models.)
One function of a model serves all: f(what, x, u, p, out) writes values, derivatives by x (rows first), then by p. The integrator below
is compiled once for all models and takes the function's address.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
import sympy
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from hexsim.errors import HexsimError
from hexsim.own.formulas import TINY, Expr
from hexsim.own.model import BEFORE, Model

Array = np.ndarray


class What(IntEnum):
    """Which of a model's vectors its function is asked for."""

    RATES = 0
    AFTER = 1
    OUTPUTS = 2
    STARTS = 3


VECTOR = types.Array(types.float64, 1, "C")
Value = Any  # of llvmlite
DOUBLE, WORD = ir.DoubleType(), ir.IntType(64)
EQUATIONS = ir.FunctionType(WORD, [WORD, *[DOUBLE.as_pointer()] * 4])  # what, x, u or s, p, out
ONE, TWO = types.float64(types.float64), types.float64(types.float64, types.float64)
COUNT = itertools.count()


@numba.cfunc(ONE, cache=True)
def exponential(x):
    return math.exp(min(x, 700.0))


@numba.cfunc(ONE, cache=True)
def logarithm(x):
    return math.log(max(x, TINY))


@numba.cfunc(ONE, cache=True)
def hyperbolic(x):
    return math.tanh(x)


@numba.cfunc(ONE, cache=True)
def sine(x):
    return math.sin(x)


@numba.cfunc(ONE, cache=True)
def cosine(x):
    return math.cos(x)


@numba.cfunc(ONE, cache=True)
def root(x):
    return math.sqrt(x) if x > 0.0 else -math.sqrt(-x)


@numba.cfunc(ONE, cache=True)
def root_slope(x):
    return 0.5 / math.sqrt(max(abs(x), TINY))


@numba.cfunc(TWO, cache=True)
def power(x, y):
    return math.exp(min(y * math.log(x), 700.0)) if x > 0.0 else 0.0


CALLED = {
    "exp": exponential,
    "logarithm": logarithm,
    "tanh": hyperbolic,
    "sin": sine,
    "cos": cosine,
    "root": root,
    "root_slope": root_slope,
    "power": power,
}


class Emitter:
    """Expressions and their derivatives to instructions of a block; what was computed once is used again.

    Derivatives go forward from node to node (chain rule; those of a function by sympy's fdiff). Whole expressions that sympy
    differentiates grow with the square of their size.
    """

    def __init__(self, builder: ir.IRBuilder, known: dict[Expr, Value]) -> None:
        self.builder, self.known = builder, known
        self.slopes: dict[Expr, dict[Expr, Value]] = {}

    def slope(self, expr: Expr) -> dict[Expr, Value]:
        """Derivatives by those symbols that are in it."""
        if expr not in self.slopes:
            self.slopes[expr] = self.differentiated(expr)
        return self.slopes[expr]

    def differentiated(self, expr: Expr) -> dict[Expr, Value]:
        if expr.is_Symbol:
            return {expr: ir.Constant(DOUBLE, 1.0)}
        total: dict[Expr, Value] = {}
        for k, part in enumerate(expr.args):
            slope = self.slope(part)
            if not slope:
                continue
            if expr.is_Mul:
                factor = self.product([one for j, one in enumerate(expr.args) if j != k])
            elif expr.is_Pow:
                factor = self.of(expr.exp * expr.base ** (expr.exp - 1))
            elif expr.is_Function:
                outer = expr.fdiff(k + 1)
                if outer.is_zero:
                    continue
                factor = self.of(outer)
            else:
                factor = None
            for symbol, value in slope.items():
                made = value if factor is None else self.builder.fmul(factor, value)
                total[symbol] = self.builder.fadd(total[symbol], made) if symbol in total else made
        return total

    def product(self, factors: Sequence[Expr]) -> Value:
        first, *more = (self.of(one) for one in factors)
        for one in more:
            first = self.builder.fmul(first, one)
        return first

    def of(self, expr: Expr) -> Value:
        if expr not in self.known:
            self.known[expr] = self.made(expr)
        return self.known[expr]

    def made(self, expr: Expr) -> Value:
        if expr.is_Mul:
            return self.product(expr.args)
        if expr.is_Add:
            first, *more = (self.of(one) for one in expr.args)
            for one in more:
                first = self.builder.fadd(first, one)
            return first
        if expr.is_Pow:
            return self.to_power(*expr.args)
        if expr.is_Function:
            return self.function(type(expr).__name__, [self.of(one) for one in expr.args])
        try:
            value = float(expr)
        except TypeError:
            raise HexsimError(f"a formula of the model has {expr}, which is no finite number") from None
        return ir.Constant(DOUBLE, value)

    def to_power(self, base: Expr, exponent: Expr) -> Value:
        if not exponent.is_Integer:
            return self.function("power", [self.of(base), self.of(exponent)])
        if exponent < 0:
            return self.builder.fdiv(ir.Constant(DOUBLE, 1.0), self.of(base**-exponent))
        value = factor = self.of(base)
        for _ in range(int(exponent) - 1):
            value = self.builder.fmul(value, factor)
        return value

    def function(self, name: str, args: list[Value]) -> Value:
        b, zero, one = self.builder, ir.Constant(DOUBLE, 0.0), ir.Constant(DOUBLE, 1.0)
        if name in CALLED:
            kind = ir.FunctionType(DOUBLE, [DOUBLE] * len(args))
            pointer = b.inttoptr(ir.Constant(WORD, CALLED[name].address), kind.as_pointer())
            return b.call(pointer, args)
        above = b.fcmp_ordered(">", args[0], zero)
        if name == "step":
            return b.select(above, one, zero)
        if name == "positive":
            return b.select(above, args[0], b.fmul(zero, args[0]))  # not a number stays one
        below = b.fcmp_ordered("<", args[0], zero)
        if name == "side":
            return b.select(above, one, b.select(below, ir.Constant(DOUBLE, -1.0), zero))
        assert name == "size", name
        return b.select(below, b.fsub(zero, args[0]), args[0])


class Equations:
    """The compiled function of a model; lives as long as its machine code is needed."""

    def __init__(self, model: Model) -> None:
        module = ir.Module(name=f"model_{next(COUNT)}")
        function = ir.Function(module, EQUATIONS, name=module.name)
        builder = ir.IRBuilder(function.append_basic_block())
        unknown = function.append_basic_block()
        switch = builder.switch(function.args[0], unknown)
        for what, part in enumerate(parts(model)):
            block = function.append_basic_block()
            switch.add_case(ir.Constant(WORD, what), block)
            written(ir.IRBuilder(block), function.args[1:], *part)
        ir.IRBuilder(unknown).ret(ir.Constant(WORD, 1))
        machine = llvm.Target.from_default_triple().create_target_machine(opt=1)
        self.engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), machine)
        self.engine.finalize_object()
        self.address = self.engine.get_function_address(module.name)

    def __call__(self, what: int, x: Array, u: Array, p: Array, out: Array) -> None:
        evaluated(self.address, what, x, u, p, out)


Part = tuple[Sequence[Expr], Sequence[Any], tuple[Sequence[Any], Sequence[Any], Sequence[Any]]]


def parts(model: Model) -> list[Part]:
    """Of each `what`: values, what they are differentiated by beside p, the symbols of x, u (or s) and p."""
    p = [model.symbols[number.name] for number in model.numbers]
    x = [model.symbols[name] for name in model.states if name in model.symbols]
    u = [model.symbols[name] for name in (*model.inputs, "time_s", "step_s")]
    before = [model.symbols.get(name + BEFORE, sympy.Symbol(name + BEFORE, real=True)) for name in model.states]
    s = [sympy.Symbol(f"{function}({column})", real=True) for function, column in model.firsts]
    both = [*x, *before]
    return [
        (model.rates, x, (both, u, p)),
        (model.after, both, (both, u, p)),
        (model.observed, x, (both, u, p)),
        (model.starts, [], (both, s, p)),
    ]


def written(
    builder: ir.IRBuilder,
    args: Sequence[ir.Value],
    values: Sequence[Expr],
    by: Sequence[Any],
    given: tuple[Sequence[Any], ...],
) -> None:
    """A block that writes values and derivatives into out."""
    used = set().union(*(one.free_symbols for one in values)) if values else set()
    known: dict[Expr, Value] = {}
    for pointer, symbols in zip(args, given, strict=False):
        for i, symbol in enumerate(symbols):
            if symbol in used:
                known[symbol] = builder.load(builder.gep(pointer, [ir.Constant(WORD, i)]), typ=DOUBLE)
    emitter = Emitter(builder, known)
    entries: list[Value] = [emitter.of(value) for value in values]
    entries += [emitter.slope(value).get(one) for names in (by, given[2]) for value in values for one in names]
    for i, entry in enumerate(entries):
        if entry is not None:
            builder.store(entry, builder.gep(args[3], [ir.Constant(WORD, i)]))
    builder.ret(ir.Constant(WORD, 0))


def called_of(typingctx, address, what, x, u, p, out):
    """Call equations at an address."""
    del typingctx, address, what, x, u, p, out

    def codegen(context, builder, signature, args):
        kinds = signature.args[2:]
        data = [
            context.make_array(kind)(context, builder, value=one).data
            for kind, one in zip(kinds, args[2:], strict=True)
        ]
        return builder.call(builder.inttoptr(args[0], EQUATIONS.as_pointer()), [args[1], *data])

    return types.int64(types.int64, types.int64, VECTOR, VECTOR, VECTOR, VECTOR), codegen


called: Any = intrinsic(called_of)


@numba.njit(types.int64(types.int64, types.int64, VECTOR, VECTOR, VECTOR, VECTOR), cache=True)
def evaluated(address, what, x, u, p, out):
    return called(address, what, x, u, p, out)


MATRIX = types.Array(types.float64, 2, "C")


@numba.njit(types.void(VECTOR, types.int64, types.int64, types.int64, MATRIX, MATRIX), cache=True)
def carried(out, below, first, width, s, rows):
    """rows (k, np) = derivatives by p in `out` from `below` on + those by states (k, width) from `first` on, times s (width, np).

    Numbers are the inner loop, which runs several at a time.
    """
    for a in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            rows[a, b] = out[below + a * rows.shape[1] + b]
        for q in range(width):
            by = out[first + a * width + q]
            for b in range(rows.shape[1]):
                rows[a, b] += by * s[q, b]


@numba.njit(cache=True)  # at the first call: it takes seconds
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
    both, s_both = np.zeros(2 * nx), np.zeros((2 * nx, np_))
    out_y = np.zeros(n_outputs + n_outputs * nx + n_outputs * np_)
    x, s, u = x0.copy(), s0.copy(), np.zeros(nu + 2)
    xs, ss, ax, a_s, rows = x0.copy(), s0.copy(), np.zeros(nx), np.zeros((nx, np_)), np.zeros((nx, np_))
    u[nu + 1] = h
    for i in range(n):
        for k in range(nu):
            u[k] = inputs[i, k]
        u[nu] = t0 + i * dt
        called(f, 2, x, u, p, out_y)
        for a in range(nx):
            states[i, a] = x[a]
        for a in range(n_outputs):
            y[i, a] = out_y[a]
        if sensitive:
            carried(out_y, n_outputs + n_outputs * nx, n_outputs, nx, s, jac[i])
        if i + 1 == n:
            break
        for j in range(steps):
            ax[:] = 0.0
            a_s[:] = 0.0
            both[nx:] = x
            if with_after and sensitive:
                s_both[nx:] = s
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
                called(f, 0, both, u, p, out)
                ahead = 1.0 if stages == 2 else (0.5 if stage < 2 else 1.0)
                for a in range(nx):
                    ax[a] += w * out[a]
                if sensitive:
                    carried(out, nx + nx * nx, nx, nx, ss, rows)
                    for a in range(nx):
                        for b in range(np_):
                            a_s[a, b] += w * rows[a, b]
                            ss[a, b] = s[a, b] + ahead * h * rows[a, b]
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
                called(f, 1, both, u, p, out_after)
                if sensitive:
                    s_both[:nx] = s
                    carried(out_after, nx + 2 * nx * nx, nx, 2 * nx, s_both, s)
                for a in range(nx):
                    x[a] = out_after[a]
        for a in range(nx):
            if not abs(x[a]) < 1e100:
                return y, jac, states
    return y, jac, states
