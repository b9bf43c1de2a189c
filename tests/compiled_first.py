"""What most tests stand on is compiled once, in two parts that have little in common: each by another worker before the tests begin.

Workers that meet an uncompiled function at the same time compile it each; they begin with their tests together, when all have collected.
`python tests/compiled_first.py` compiles all of it."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
# numba colours sentences that it then throws away, for a twentieth of its time
os.environ["NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING"] = "1"


def computers() -> None:
    """Algorithms of one leg, what a motion computer predicts of its host, and the plants that tests have of their own."""
    import compensation
    from compensation import Context, Sample
    from hexsim.motion_computer import host_packet
    from hexsim.motion_computer.host_buffer import HostBuffer

    sample = Sample(0.0, 0.1, np.full(15, 0.1), 0.1, 0.0, 0.0, 3.4e6, 7e6)
    for name in ("adaptive", "buffered", "iterative", "repetitive"):
        made = compensation.create(name)
        _, state = made.step(made.start(Context()), sample)
        made.parameters(state)
    buffer = HostBuffer(latency_s=0.0)
    for k in range(4):
        buffer.add(host_packet.HostCommand(sequence=k, time_s=0.01 * k, setpoints=(0.0,) * 6), 0.01 * k)
    buffer.target(0.04)
    sys.path += [str(FOLDER / "tracing"), str(FOLDER / "compensation")]
    from leg_plant import run, sine
    from other_plant import declared_plant, simulate
    from pair_plant import PairLeg, run_pair

    del sys.path[-2:]
    simulate(declared_plant("bench"), "fit", 1, 0.1)
    plain = compensation.create("none")
    run(plain, duration_s=0.01)
    run_pair(plain, PairLeg(), sine(), 0.01)


def machines() -> None:
    """Legs: by the simulator, by a fit, as a linear system."""
    import hexsim as hx
    from hexsim import readers
    from hexsim.machine import load_machine
    from hexsim.simulation import simulate
    from hexsim.tracing.problems.simulated import SimulatedProblem

    heave = replace(hx.load_scenario("heave"), duration_s=0.1)
    for machine in ("bench", "micro_motion_system"):
        for compensator in ("none", "exact"):
            simulate(load_machine(machine), heave, compensator=compensator, fast=True)
    hx.linearize("bench")
    log = readers.read_log(readers.log_files(FOLDER / "data" / "bench_none", "fit")).head(1.0)
    SimulatedProblem(logs=(log,), noise={"position_m": 3e-6}).simulated(load_machine("bench"), 0)


PARTS = (computers, machines)

if __name__ == "__main__":
    for part in PARTS:
        part()
