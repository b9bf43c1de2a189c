"""Typical sizes of the signals of a model, from its free runs: what starts and bounds of effects are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import sympy

from hexsim.own.compiled import RATES
from hexsim.own.declaration import ModelTables
from hexsim.own.effects import Sizes, place_of
from hexsim.own.fit import Fitted, Problem
from hexsim.own.model import Resolver
from hexsim.own.simulate import FreeRun, Record


def sizes_of(tables: ModelTables, now: Fitted, records: Sequence[Record]) -> Callable[[str, str], Sizes]:
    """Typical sizes of signals, from the free runs of the model as it is."""
    problem = Problem(now.simulator, records, noises=now.noises)
    model, runs = now.simulator.model, problem.free_runs(now.values, False)
    states = np.concatenate([free.states for free in runs])
    spread = dict(zip(model.states, np.sqrt(np.nanmean(states**2, axis=0)), strict=True))
    middle = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) + np.nanmin(states, axis=0)), strict=True))
    half = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) - np.nanmin(states, axis=0)), strict=True))
    dt, duration = records[0].dt, float(np.mean([record.time[-1] for record in records]))

    def of(what: str, name: str) -> Sizes:
        common = {"T": dt, "D": duration}
        if what == "sum":
            at = place_of(name, tables) or name
            sums = sum_size(now, runs, records, name)
            return Sizes(X=spread[name] or 1.0, S=sums or 1.0, P=half[at] or 1.0, M=middle[at], **common)
        if what == "input":
            k = model.inputs.index(name)
            values = np.concatenate([record.inputs[:, k] for record in records])
        else:
            k = model.outputs.index(name)
            values = np.concatenate([record.measured[record.weight[:, k] > 0, k] for record in records])
        return Sizes(Y=float(np.sqrt(np.mean(values**2))) or 1.0, P=0.5 * float(np.ptp(values)) or 1.0,
                     M=0.5 * float(values.max() + values.min()), **common)  # fmt: skip

    return of


def sum_size(now: Fitted, runs: Sequence[FreeRun], records: Sequence[Record], name: str) -> float:
    """Rms of storage times rate of a state along the runs."""
    model = now.simulator.model
    k, count = model.states.index(name), len(model.numbers)
    nx = len(model.states)
    out = np.zeros(nx + nx * nx + nx * count)
    problem = Problem(now.simulator, records, noises=now.noises)
    found = []
    for r, (record, free) in enumerate(zip(records, runs, strict=True)):
        p = np.ascontiguousarray(now.values[problem.columns[r]])
        inputs = now.simulator.inputs(record, p)
        for i in range(0, record.n, max(record.n // 400, 1)):
            u = np.array([*inputs[i], record.time[i], record.dt])
            now.simulator.equations(RATES, np.tile(free.states[i], 2), u, p, out)
            found.append(out[k])
    return float(np.sqrt(np.nanmean(np.square(found)))) * storage_of(now, name)


def storage_of(now: Fitted, name: str) -> float:
    """Value of a state's storage with the numbers there are (states in it: at their means)."""
    model = now.simulator.model
    table = model.tables.states[name]
    value = Resolver(model.tables, "storage", model.tables.states).of(table.storage, f"[states.{name}]")
    named = dict(zip(now.names, (float(one) for one in now.values), strict=True))
    value = value.xreplace(
        {symbol: sympy.Float(named[str(symbol)]) for symbol in value.free_symbols if str(symbol) in named}
    )
    return abs(float(value)) if value.is_number else 1.0
