"""Typical sizes of the signals of a model, from its free runs: what starts and bounds of effects are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import sympy

from hexsim.inference.likelihood import Fit
from hexsim.own.compiled import What
from hexsim.own.declaration import ModelTables
from hexsim.own.effects import Sizes, place_of
from hexsim.own.model import Resolver
from hexsim.own.problem import OwnProblem
from hexsim.own.simulate import FreeRun

Array = np.ndarray


def sizes_of(tables: ModelTables, now: Fit) -> Callable[[str, str], Sizes]:
    """Typical sizes of signals, from the free runs of a fit of `OwnProblem`."""
    problem, theta = now.problem, now.theta
    assert isinstance(problem, OwnProblem)
    model, records = problem.simulator.model, problem.records
    top_Hz = max((spectrum.top_Hz for spectrum in now.spectra), default=0.0)
    runs = [problem.free_run(k, theta) for k in range(len(records))]
    states = np.concatenate([free.states for free in runs])
    spread = dict(zip(model.states, np.sqrt(np.nanmean(states**2, axis=0)), strict=True))
    middle = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) + np.nanmin(states, axis=0)), strict=True))
    half = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) - np.nanmin(states, axis=0)), strict=True))
    dt, duration = records[0].dt, float(np.mean([record.time[-1] for record in records]))

    def of(what: str, name: str) -> Sizes:
        common = {"T": dt, "D": duration}
        if what == "sum":
            at = place_of(name, tables) or name
            sums = sum_size(problem, theta, runs, name)
            return Sizes(
                X=spread[name] or 1.0,
                S=sums or 1.0,
                P=half[at] or 1.0,
                M=middle[at],
                H=half[name] or 1.0,
                C=middle[name],
                N=waves([free.states[:, model.states.index(name)] for free in runs], 2.0 * top_Hz * dt),
                **common,
            )
        if what == "input":
            k = model.inputs.index(name)
            parts = [record.inputs[:, k] for record in records]
        else:
            k = model.outputs.index(name)
            parts = [record.measured[record.weight[:, k] > 0, k] for record in records]
        values = np.concatenate(parts)
        return Sizes(
            Y=float(np.sqrt(np.mean(values**2))) or 1.0,
            P=0.5 * float(np.ptp(values)) or 1.0,
            M=0.5 * float(values.max() + values.min()),
            N=waves(parts, 2.0 * top_Hz * dt),
            **common,
        )

    return of


def waves(parts: Sequence[Array], half_periods: float) -> float:
    """Half waves over a signal's range that each take half a period at least where the signal is slowest, over a quarter of its way; 1 at
    least. parts: its runs. half_periods: of time, a sample. A signal that jumps between rests passes all of them at once."""
    values = np.concatenate(parts)
    if not half_periods > 0.0:
        return 1.0
    span = max(round(1.0 / half_periods), 1)
    passed = np.concatenate([np.abs(part[span:] - part[:-span]) for part in parts])
    passed = np.sort(passed[passed > 0.0])
    if not len(passed):
        return 1.0
    slow = passed[np.searchsorted(np.cumsum(passed), 0.25 * passed.sum())]
    return max(half_periods * span * float(np.nanmax(values) - np.nanmin(values)) / float(slow), 1.0)


def sum_size(
    problem: OwnProblem,
    theta: Array,
    runs: Sequence[FreeRun],
    name: str,
    *,
    n_samples: int = 400,  # of which a typical size is taken
) -> float:
    """Rms of storage times rate of a state along the runs."""
    model = problem.simulator.model
    k, count = model.states.index(name), len(model.numbers)
    nx = len(model.states)
    out = np.zeros(nx + nx * nx + nx * count)
    found = []
    for r, (record, free) in enumerate(zip(problem.records, runs, strict=True)):
        p = np.ascontiguousarray(theta[problem.columns[r]])
        inputs = problem.simulator.inputs(record, p)
        for i in range(0, record.n, max(record.n * len(runs) // n_samples, 1)):
            u = np.array([*inputs[i], record.time[i], record.dt])
            problem.simulator.equations(What.RATES, np.tile(free.states[i], 2), u, p, out)
            found.append(out[k])
    return float(np.sqrt(np.nanmean(np.square(found)))) * storage_of(problem, theta, name)


def storage_of(problem: OwnProblem, theta: Array, name: str) -> float:
    """Value of a state's storage with the numbers there are (states in it: at their means)."""
    model = problem.simulator.model
    table = model.tables.states[name]
    value = Resolver(model.tables, "storage").of(table.storage, f"[states.{name}]")
    named = {number.name: float(one) for number, one in zip(problem.numbers, theta, strict=True)}
    value = value.xreplace(
        {symbol: sympy.Float(named[str(symbol)]) for symbol in value.free_symbols if str(symbol) in named}
    )
    return abs(float(value)) if value.is_number else 1.0
