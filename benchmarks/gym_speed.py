"""256 machines side by side: simulated over elapsed time with one thread and with two.

    python benchmarks/gym_speed.py [bench or micro_motion_system]

Where other programs take the processors, the share of a step that runs in threads tells more: printed too.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

from hexsim.gym import HexsimVectorEnv

MACHINES, STEPS, ROUNDS = 256, 40, 5


def main() -> None:
    """Rounds in turn, the median of each."""
    machine = sys.argv[1] if len(sys.argv) > 1 else "bench"
    many = {threads: HexsimVectorEnv(MACHINES, machine=machine, threads=threads) for threads in (1, 2)}
    actions = np.zeros((MACHINES, many[1].task.machine.n_legs))
    for env in many.values():
        env.reset(seed=0)
        env.step(actions)
    ratios: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(ROUNDS):
        for threads, env in many.items():
            begun = time.perf_counter()
            for _ in range(STEPS):
                env.step(actions)
            simulated = STEPS * MACHINES * env.task.tick_s
            ratios[threads].append(simulated / (time.perf_counter() - begun))
    one, two = (statistics.median(ratios[threads]) for threads in (1, 2))
    print(
        f"{MACHINES} of {machine}, {many[1].substeps} time steps a tick: {one:.1f} s a second with one thread, {two:.1f} with two"
    )
    print(f"times one thread: {two / one:.2f}; share in threads {share_in_threads(many[1], actions):.3f}")


def share_in_threads(env: HexsimVectorEnv, actions: np.ndarray) -> float:
    """Of the processor time of a step with one thread."""
    inside, plain = 0.0, env.batch.step

    def timed(**options) -> None:
        nonlocal inside
        begun = time.process_time()
        plain(**options)
        inside += time.process_time() - begun

    env.batch.step = timed  # type: ignore[method-assign]
    begun = time.process_time()
    for _ in range(STEPS):
        env.step(actions)
    return inside / (time.process_time() - begun)


if __name__ == "__main__":
    main()
