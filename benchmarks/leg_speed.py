"""Cost of a leg's equations against an older commit: `python benchmarks/leg_speed.py --before 0095305`. Prints one table.

Two processes, one with each tree, are asked in turn for the CPU time of MuJoCo's two native callbacks over the same 64
states (`actuator` calls of all legs); the least of each is compared. Equal sums say that the bits are equal.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STATES, CALLS = 64, 300


def work(name: str) -> None:
    """Answer each line of stdin: [ns] of both callbacks a leg, and the sum of what they returned."""
    import numpy as np
    from numba import njit

    from hexsim.hydraulics.parameters import P
    from hexsim.machine import load_machine
    from hexsim.plant import Plant, callbacks

    made = getattr(callbacks, "native_callbacks", None) or callbacks._compile  # its name before commit 1d6f578
    kind = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_size_t, ctypes.c_size_t, ctypes.c_int)
    rates, bias = (kind(native.address) for native in made())
    plant = Plant(load_machine(name), timestep=1e-4)
    data, n, rng = plant.data, plant.n_legs, np.random.default_rng(1)
    act = np.tile(data.act, (STATES, 1))
    act[:, plant.pressure_places] *= 1.0 + 0.05 * rng.standard_normal((STATES, n))
    volts, velocity, piston = 1.0, 0.05, 0.03
    spread = [scale * rng.standard_normal((STATES, n)) for scale in (volts, velocity, piston)]
    spread[2] += plant.rows[:, P.LENGTH_OFFSET] + 0.5 * plant.rows[:, P.STROKE]

    @njit
    def call(model, data, views, states, repeats, asks):
        total = 0.0
        for _ in range(repeats):
            for k in range(STATES):
                for view, rows in zip(views, states):  # noqa: B905  (numba knows no strict)
                    for i in range(rows.shape[1]):
                        view[i] = rows[k, i]
                for i in range(n):
                    if asks:
                        total += rates(model, data, i) + bias(model, data, i)
        return total

    views = (data.act, data.ctrl, data.actuator_velocity, data.actuator_length)

    def timed(asks: bool) -> tuple[float, float]:
        start = time.process_time()
        total = call(plant.model._address, data._address, views, (act, *spread), CALLS, asks)
        return (time.process_time() - start) / (CALLS * STATES * n) * 1e9, total

    timed(True)
    print("ready", flush=True)
    for _ in sys.stdin:
        (with_legs, total), (without, _) = timed(True), timed(False)
        print(with_legs - without, repr(total), flush=True)


def start(tree: Path, machine: str) -> subprocess.Popen:
    """A worker on the package of `tree`."""
    command = [sys.executable, str(Path(__file__).resolve()), "--work", machine]
    cache = tempfile.mkdtemp(prefix="hexsim-leg-speed-")
    worker = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": cache},
    )
    assert worker.stdout is not None and worker.stdout.readline().strip() == "ready"
    return worker


def ask(worker: subprocess.Popen) -> tuple[float, str]:
    assert worker.stdin is not None and worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    cost, total = worker.stdout.readline().split()
    return float(cost), total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", default="0095305", help="commit; the default is the last without four-way valves")
    parser.add_argument("--machines", default="micro_motion_system,bench,micro_motion_system/power_unit")
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--work", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(options.work)
        return
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["git", "clone", "-q", str(ROOT), folder], check=True)
        subprocess.run(["git", "-C", folder, "checkout", "-q", options.before], check=True)
        for machine in options.machines.split(","):
            workers = [start(Path(folder), machine), start(ROOT, machine)]
            rounds = [[ask(worker) for worker in workers] for _ in range(options.repeats)]
            for worker in workers:
                worker.communicate()
            before, now = (min(r[i][0] for r in rounds) for i in (0, 1))
            same = "equal bits" if rounds[0][0][1] == rounds[0][1][1] else "other bits"
            print(f"{machine}: {before:.1f} -> {now:.1f} ns a leg, ratio {now / before:.3f}, {same}", flush=True)


if __name__ == "__main__":
    main()
