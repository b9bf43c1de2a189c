"""What six compensators cost of a control period of 2 ms.

    python benchmarks/compensation_cost.py      prints a table; to be run on a machine that does nothing else

Processor time of a heave of 0.05 m at 0.5 Hz of the 600 kg machine (tendon model), less that of the same run under plain control,
over its ticks: the shortest of REPEATS runs. Legs of `adaptive` are stepped together, as in every run.
"""

from __future__ import annotations

import time

import numpy as np
from rich.console import Console
from rich.table import Table

from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate

MACHINE = "micro_motion_system"
NAMES = ("adaptive", "repetitive", "buffered", "iterative", "exact")
UNTIL_S = (6.0, 14.0, 20.0)  # the fit begins; volts come in; what is known changes little
REPEATS = 3


def took_s(name: str, duration_s: float) -> float:
    machine, heave, times = load_machine(MACHINE), load_scenario("heave", duration_s=duration_s), []
    for _ in range(REPEATS):
        begin = time.process_time()
        simulate(machine, heave, compensator=name, fast=True)
        times.append(time.process_time() - begin)
    return min(times)


def main() -> None:
    rate_Hz = load_machine(MACHINE).controller.rate_Hz
    took_s("none", UNTIL_S[0])  # compiled
    plain_s = np.array([took_s("none", t) for t in UNTIL_S])
    spans = [f"to {t:g} s [us]" for t in UNTIL_S]
    table = Table("compensator", "mean [us]", *spans, "of 2 ms")
    for name in NAMES:
        took_s(name, UNTIL_S[1])
        more_us = 1e6 * (np.array([took_s(name, t) for t in UNTIL_S]) - plain_s)
        mean, us = (
            more_us[-1] / (rate_Hz * UNTIL_S[-1]),
            np.diff(more_us, prepend=0.0) / (rate_Hz * np.diff(UNTIL_S, prepend=0.0)),
        )
        table.add_row(name, *(f"{x:.0f}" for x in (mean, *us)), f"{1e-6 * mean * rate_Hz:.1%}")
    Console().print(table)


if __name__ == "__main__":
    main()
