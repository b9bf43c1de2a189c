"""Free runs of a model from recorded inputs: only the inputs and the first samples of a run are used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy
from scipy.interpolate import CubicSpline

from hexsim.errors import HexsimError
from hexsim.own.compiled import Equations, What, integrated
from hexsim.own.model import Model
from hexsim.signals.log import Log

Array = np.ndarray
STAGES = {"rk4": 4, "heun": 2, "euler": 1}


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """A run, or a part of one, as the model sees it. run: its log. inputs: (n, nu). measured: (n, ny). weight: (n, ny) of samples in the
    score, 0 or 1 (0: not logged). firsts: (ns,)."""

    name: str
    run: str
    time: Array
    dt: float
    inputs: Array
    measured: Array
    weight: Array
    firsts: Array

    @property
    def n(self) -> int:
        return self.time.shape[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRun:
    """outputs: (n, ny). slopes: (n, ny, np) by the numbers of this run (empty where not asked for). states: (n, nx)."""

    outputs: Array
    slopes: Array
    states: Array

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.outputs).all())


def record_of(model: Model, log: Log, where: str) -> Record:
    """The columns of a log that a model takes, as one free run. Raises HexsimError for an input that is not there."""
    return records_of(model, log, where, whole=True)[0]


def records_of(model: Model, log: Log, where: str, whole: bool = False) -> list[Record]:
    """A log as free runs: one, or one every [simulation] anew_s. Raises HexsimError for an input that is not there."""
    wanted = {*model.inputs, *(column for _, column in model.firsts)}
    missing = sorted(name for name in wanted if name not in log.columns)
    if missing:
        raise HexsimError(
            f"{where}: run {log.name} has no column {missing[0]!r}; it has {', '.join(sorted(log.columns))[:400]}"
        )
    inputs = np.zeros((log.n, len(model.inputs)))
    for k, name in enumerate(model.inputs):
        inputs[:, k] = log.columns[name]
    measured = np.full((log.n, len(model.outputs)), np.nan)
    for k, name in enumerate(model.outputs):
        if name in log.columns:
            measured[:, k] = log.columns[name]
    weight = np.isfinite(measured).astype(float)
    for k, name in enumerate(model.outputs):
        if name in log.repaired:
            weight[log.repaired[name], k] = 0.0
    settings, since = model.tables.simulation, log.time - log.time[0]
    weight[since < settings.from_s] = 0.0
    every = (
        log.n
        if whole or settings.anew_s is None
        else max(int(settings.anew_s * log.rate), 4 * settings.first_samples, 40)
    )
    count, found = max(log.n // every, 1), []
    for k in range(count):
        part = slice(k * every, log.n if k + 1 == count else (k + 1) * every)
        seen = weight[part].copy()
        if settings.first_samples > 1:
            seen[: settings.first_samples] = 0.0
        firsts = [
            first(log.columns[column][part], 1.0 / log.rate, function, settings.first_samples)
            for function, column in model.firsts
        ]
        found.append(
            Record(
                name=log.name if count == 1 else f"{log.name} {k + 1}",
                run=log.name,
                time=since[part],
                dt=1.0 / log.rate,
                inputs=np.ascontiguousarray(inputs[part]),
                measured=np.nan_to_num(measured[part]),
                weight=seen,
                firsts=np.array(firsts),
            )
        )
    return found


def first(
    y: Array,
    dt: float,
    function: str,
    count: int,
    *,
    parabola_samples: int = 6,
) -> float:
    """first: the value at the first sample, first_rate: the slope there, of a parabola through the first samples (a line through fewer
    than `parabola_samples`, the sample itself where there is but one)."""
    y = y[: max(count, 2)]
    if count < 2 and function == "first":
        return float(y[0])
    slope, value = np.polyfit(np.arange(len(y)) * dt, y, 2 if len(y) >= parabola_samples else 1)[-2:]
    return float(slope if function == "first_rate" else value)


class Simulator:
    """A model with its compiled equations."""

    def __init__(self, model: Model) -> None:
        self.model, self.equations = model, Equations(model)
        self.stages = STAGES[model.tables.simulation.scheme]
        symbols = [model.symbols[name] for name in model.states]
        self.with_after = any(one != symbol for one, symbol in zip(model.after, symbols, strict=True))
        self.held = np.array(model.held, dtype=bool)
        self.delayed = [
            k
            for k, number in enumerate(model.numbers)
            if any(model.symbols[number.name] in delay.free_symbols for delay in model.delays.values())
        ]

    def starts(self, record: Record, p: Array) -> tuple[Array, Array]:
        """(x0, its derivatives by p (nx, np))."""
        nx, count = len(self.model.states), len(p)
        out = np.zeros(nx + nx * count)
        self.equations(What.STARTS, np.zeros(nx), record.firsts, p, out)
        return out[:nx].copy(), out[nx:].reshape(nx, count).copy()

    def run(
        self,
        record: Record,
        p: Array,
        slopes: bool = False,
        start: Array | None = None,
        *,
        delay_step: float = 0.25,  # samples, of the difference quotient by a number that a delay depends on
    ) -> FreeRun:
        """Simulate a run with numbers p (np,), from its own start or from `start` (nx,)."""
        p = np.ascontiguousarray(p, dtype=float)
        free = self.at(record, p, slopes, start)
        for k in self.delayed if slopes else ():
            change = delay_step * record.dt
            ahead, behind = p.copy(), p.copy()
            ahead[k] += change
            behind[k] -= change
            difference = self.at(record, ahead, False, start).outputs - self.at(record, behind, False, start).outputs
            free.slopes[:, :, k] = difference / (2.0 * change)
        return free

    def at(self, record: Record, p: Array, slopes: bool, start: Array | None) -> FreeRun:
        x0, s0 = self.starts(record, p)
        if start is not None:
            x0, s0 = np.ascontiguousarray(start, dtype=float), np.zeros_like(s0)
        settings = self.model.tables.simulation
        y, jac, states = integrated(
            self.equations.address,
            x0,
            s0,
            self.inputs(record, p),
            self.held,
            p,
            record.time[0],
            record.dt,
            settings.steps,
            self.stages,
            len(self.model.outputs),
            self.with_after,
            slopes,
        )
        return FreeRun(outputs=y, slopes=jac, states=states)

    def inputs(self, record: Record, p: Array) -> Array:
        """Inputs at samples, those with a delay as they were earlier (the first value before the run)."""
        if not self.model.delays:
            return record.inputs
        moved = record.inputs.copy()
        values = {
            self.model.symbols[number.name]: sympy.Float(value)
            for number, value in zip(self.model.numbers, p, strict=True)
        }
        for name, delay in self.model.delays.items():
            k = self.model.inputs.index(name)
            late = float(sympy.sympify(delay).xreplace(values).evalf())  # pyright: ignore[reportArgumentType]
            at = np.clip(record.time - late, record.time[0], record.time[-1])
            held = self.model.held[k]
            moved[:, k] = (
                np.interp(at, record.time, record.inputs[:, k])
                if held
                else CubicSpline(record.time, record.inputs[:, k])(at)
            )
        return moved
