"""What six compensators cost of a control period of 2 ms.

    python benchmarks/compensation_cost.py      prints a table; to be run on a machine that does nothing else

Processor time of a heave of 0.05 m at 0.5 Hz of the 600 kg machine (tendon model), less that of the same run under plain control,
over its ticks: the shortest of REPEATS runs. Legs of `adaptive` are stepped together, as in every run.
"""

from __future__ import annotations

import time

from rich.console import Console
from rich.table import Table

from hexsim.machine import load_machine
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import simulate

NAMES = ("adaptive", "repetitive", "buffered", "iterative", "exact")
UNTIL_S = (6.0, 14.0, 20.0)  # the fit begins; volts come in; what is known changes little
REPEATS = 3


def took_s(name: str, duration_s: float) -> float:
    axes = {"z": {"kind": "sine", "amplitude": 0.05, "frequency_Hz": 0.5}}
    heave = scenario_from_dict({"name": "heave", "mode": "dof", "duration_s": duration_s, "fade_s": 2.0, "axes": axes})
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        simulate(load_machine("micro_motion_system"), heave, compensator=name, fast=True)
        times.append(time.process_time() - begin)
    return min(times)


def main() -> None:
    rate_Hz = load_machine("micro_motion_system").controller.rate_Hz
    took_s("none", UNTIL_S[0])  # compiled
    plain_s = [0.0, *(took_s("none", t) for t in UNTIL_S)]
    spans = [f"to {t:g} s [us]" for t in UNTIL_S]
    table = Table("compensator", "mean [us]", *spans, "of 2 ms")
    for name in NAMES:
        took_s(name, UNTIL_S[1])
        more = [0.0, *(took_s(name, t) - p for t, p in zip(UNTIL_S, plain_s[1:], strict=True))]
        ends = (0.0, *UNTIL_S)
        us = [1e6 * (more[k + 1] - more[k]) / (rate_Hz * (ends[k + 1] - ends[k])) for k in range(len(UNTIL_S))]
        mean = 1e6 * more[-1] / (rate_Hz * UNTIL_S[-1])
        table.add_row(name, *(f"{x:.0f}" for x in (mean, *us)), f"{1e-6 * mean * rate_Hz:.1%}")
    Console().print(table)


if __name__ == "__main__":
    main()
