"""How much faster than real time `hexsim serve` could run, and how well it keeps real time.

    python benchmarks/serve_margin.py           writes docs/results/serve.md

Margin: simulated seconds a second of processor time of one thread, in manual mode, heave of 0.05 m at 0.5 Hz, tendon
model, chosen step. Lag: how far the machine was behind real time at worst, over some seconds in real time.
"""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path

import numpy as np

from hexsim.machine import Machine, load_machine
from hexsim.machine.files import changed
from hexsim.simulation.serve import Server

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "serve.md"


def margin(machine: Machine, seconds: float = 4.0, **options) -> tuple[float, float]:
    """(margin of the whole, margin of the plant alone)."""
    with Server(machine, port=0, **options) as server:
        volts = np.zeros(machine.n_legs)
        for _ in range(100):
            server.tick()
        server.computer.command("run_manual", server.time_s)
        ticks = round(seconds / server.tick_s)
        begin = time.thread_time()
        for _ in range(ticks):
            server.tick()
        middle = time.thread_time()
        for _ in range(ticks):
            server.plant.tick(volts)
        end = time.thread_time()
    return seconds / (middle - begin), seconds / (end - middle)


def main() -> None:
    machine = load_machine("micro_motion_system")
    cases = (
        ("proportional control, constant supply", machine, {}),
        ("proportional control, power unit", changed(machine, {"power_unit": {}}), {}),
        ("compensator buffered, constant supply", machine, {"compensator": "buffered"}),
        ("compensator adaptive, constant supply", machine, {"compensator": "adaptive"}),
        ("proportional control, constant time step of 100 us", machine, {"timestep": 1e-4}),
    )
    lines = ["| case | margin | plant alone |", "|---|---|---|"]
    for name, made, options in cases:
        whole, plant = margin(made, **options)
        lines.append(f"| {name} | {whole:.1f} | {plant:.1f} |")
        print(lines[-1], flush=True)
    with Server(machine, port=0) as server:
        status = server.run(10.0)
    load = os.getloadavg()[0]
    lines += [
        "",
        f"Simulated seconds a second of processor time. {platform.machine()}, {os.cpu_count()} cores, load {load:.1f}.",
        f"In real time for 10 s under that load: at worst {1e3 * status.worst_behind_s:.1f} ms behind, "
        f"{status.skipped_s:.1f} s skipped.",
        "",
        "Written by `benchmarks/serve_margin.py`.",
    ]
    print("\n".join(lines[-4:]))
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text("# Real time\n\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
