"""Speed as ratios in one run: `python benchmarks/speed.py [--exudyn]`. Prints a table and writes docs/results/speed.json.

Every ratio compares two things measured in turn, many times, in this process; the least of each is taken, so that other
work on the machine does not decide. Absolute times are printed for orientation only.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.plant.batch import PlatformBatch
from hexsim.scenarios import load_scenario
from hexsim.simulation import TickLoop

RESULT = Path(__file__).parents[1] / "docs" / "results" / "speed.json"
FULL_SET = {
    "power unit, spool and air": {
        "power_unit": {},
        "effects": {"entrained_air": {"volume_fraction": 0.005}},
    }
}


def least(repeats: int, *functions, clock=time.process_time) -> list[float]:
    """Least CPU time of each function [s], called in turn (wall time where threads are compared)."""
    times = np.full((repeats, len(functions)), np.inf)
    for k in range(repeats):
        for i, function in enumerate(functions):
            start = clock()
            function()
            times[k, i] = clock() - start
    return list(times.min(axis=0))


def bare_step(plant: Plant, steps: int, timestep: float = 1e-4):
    """mj_step of the same model and integrator without callbacks, MuJoCo's timers running as they do out of the box.

    Six constant forces hold the platform.

    The forces keep MuJoCo's constraint solver as busy as in the real run; without them it would have nothing to close.
    """
    model = plant.spec.compile()
    model.opt.timestep = timestep
    plant.reset()
    held = plant.static_pressures() / 1e6
    thrust = plant.rows[0, P.AREA_BOTTOM] * held * 1e6 - plant.machine.supply.pressure_Pa * plant.rows[0, P.AREA_TOP]
    model.actuator_gainprm[: plant.n_legs, 0] = thrust / held
    data = mujoco.MjData(model)

    def go():
        mujoco.mj_resetData(model, data)
        data.act[plant.pressure_places] = held
        mujoco.mj_step(model, data, steps)

    return go


def whole_run(plant: Plant, duration: float):
    """Hydraulics, logging and 500 Hz control of a heave."""
    scenario = load_scenario("heave", duration_s=duration)

    def go():
        plant.reset()
        TickLoop(plant, PositionLoop(plant.machine, [], None), scenario, 0).go(lambda fraction: None, ())

    return go


def loop_ratios(repeats: int) -> dict[str, float]:
    """Whole run with the chosen step over as many bare steps of the mean size: both models, and everything switched on."""
    machine = load_machine("micro_motion_system")
    ratios = {}
    cases = {
        "tendon": (machine, "tendon", 4.0),
        "full legs": (machine, "full", 4.0),
        "full legs, power unit, spool, air": (changed(machine, FULL_SET["power unit, spool and air"]), "full", 4.0),
    }
    for name, (declared, model, duration) in cases.items():
        plant = Plant(declared, model=model)  # type: ignore[arg-type]
        whole = whole_run(plant, duration)
        whole()
        steps = int(plant.record.steps.sum())
        bare, complete = least(repeats, bare_step(plant, steps, duration / steps), whole)
        ratios[name] = complete / bare
        print(f"{name}: bare {bare / steps * 1e6:.2f} us a step, whole {complete / steps * 1e6:.2f} us")
    return ratios


def batch_ratio(repeats: int, machines: int = 64, steps: int = 400) -> float:
    """One thread over two threads for a batch of hexapods."""
    plant = Plant(load_machine("micro_motion_system"), model="tendon", timestep=1e-4)
    batches = [PlatformBatch([plant.model] * machines, threads) for threads in (1, 2)]
    for batch in batches:
        for name in ("qpos", "qvel", "act", "ctrl"):
            batch.bind(name)[:] = getattr(plant.data, name)
        batch.bind("ctrl")[:] = np.random.default_rng(0).uniform(-1, 1, (machines, plant.model.nu))
    one, two = (partial(batch.step, steps) for batch in batches)
    single, double = least(repeats, one, two, clock=time.perf_counter)
    return single / double


def start_up_s() -> float:
    """From `python` to the first step with a warm cache [s], in a new process."""
    code = (
        "import time; t = time.perf_counter()\n"
        "from hexsim.machine import load_machine; from hexsim.plant import Plant\n"
        "p = Plant(load_machine('micro_motion_system'), model='tendon')\n"
        "p.tick(p.context.spool_volts)\n"
        "print(time.perf_counter() - t)"
    )
    times = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument(
        "--exudyn", action="store_true", help="also compare with Exudyn (pip install hexsim[benchmark])"
    )
    arguments = parser.parse_args()
    rows: list[tuple[str, float, str]] = []
    limits = {"tendon": "<= 1.4", "full legs": "<= 1.4", "full legs, power unit, spool, air": "<= 1.6"}
    for name, ratio in loop_ratios(arguments.repeats).items():
        rows.append((f"whole run / bare step: {name}", ratio, limits[name]))
    rows.append(("64 machines, one thread / two threads", batch_ratio(arguments.repeats), ">= 1.6"))
    if arguments.exudyn:
        from peer_exudyn import exudyn_ratio

        rows.append(("hexsim / Exudyn, each at its best step, error <= 0.1 %", exudyn_ratio(any_step=True), ">= 2.5"))
    rows.append(("start-up to first step, warm cache [s]", start_up_s(), "< 3"))
    rows.append(("peak memory [MB]", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, ""))
    table = Table("what", "value", "target")
    for what, value, target in rows:
        table.add_row(what, f"{value:.2f}", target)
    Console().print(table)
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    kept = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}  # "commands": of command_speed.py
    kept |= {"commit": commit, "command": " ".join(["python", *sys.argv]), "rows": rows}
    RESULT.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
