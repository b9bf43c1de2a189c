"""What six compensators cost of a control period of 2 ms.

    python benchmarks/compensation_cost.py      prints a table; to be run on a machine that does nothing else

Process time of the compensators' steps in a heave of 0.05 m at 0.5 Hz of the 600 kg machine (tendon model), added up over
the six legs of a tick: mean over the plain phase, over the compensated one, and over all.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import compensation
from compensation import Compensator, Context, Parameters
from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate

NAMES = ("adaptive", "repetitive", "buffered", "iterative", "exact")
LEGS = 6
TICKS: list[float] = []  # [s] of every step, leg by leg


class Timed(Compensator):
    """A compensator whose steps are timed."""

    def __init__(self, inner: Compensator) -> None:
        self.inner, self.name, self.preview_s = inner, inner.name, inner.preview_s

    def start(self, context: Context) -> Any:
        return self.inner.start(context)

    def step(self, state: Any, sample: Any) -> tuple[float, Any]:
        begin = time.thread_time_ns()
        result = self.inner.step(state, sample)
        TICKS.append(1e-9 * (time.thread_time_ns() - begin))
        return result

    def status(self, state: Any) -> str:
        return self.inner.status(state)

    def parameters(self, state: Any) -> Parameters:
        return self.inner.parameters(state)

    def restore(self, context: Context, parameters: Parameters) -> Any:
        return self.inner.restore(context, parameters)


def main() -> None:
    machine, scenario = load_machine("micro_motion_system"), load_scenario("heave")
    table = Table("compensator", "mean [us]", "first 6 s [us]", "last 6 s [us]", "median [us]", "99 % [us]", "of 2 ms")
    for name in NAMES:
        TICKS.clear()
        simulate(machine, scenario, compensator=Timed(compensation.create(name)), fast=True)
        us = 1e6 * np.array(TICKS[: len(TICKS) // LEGS * LEGS]).reshape(-1, LEGS).sum(axis=1)
        n = round(6.0 * machine.controller.rate_Hz)
        figures = (us.mean(), us[:n].mean(), us[-n:].mean(), np.median(us), np.quantile(us, 0.99))
        table.add_row(name, *(f"{x:.0f}" for x in figures), f"{us.mean() / 20.0:.1f} %")
    Console().print(table)


if __name__ == "__main__":
    main()
