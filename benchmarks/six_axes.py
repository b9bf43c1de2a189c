"""Six axes at once on the 600 kg hexapod: `python benchmarks/six_axes.py [--seeds 48:64]`

`combined` as declared, 16 s, from nothing learned, one sensor noise a seed: plain control's largest deviation from the
commanded acceleration over the compensated one, in 50 Hz, less its mean over 0.1 s, the measure of
tests/test_compensated_platform.py. A line a seed and axis; aim: 10 in each axis.
"""

from __future__ import annotations

import argparse
import statistics
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import Run, simulate
from hexsim.smoothness import band_limit

AXES = [f"acceleration_{axis}_m_s2" for axis in "xyz"] + [f"angular_acceleration_{axis}_rad_s2" for axis in "xyz"]
DURATION_s, LATE_s, EARLY_s = 16.0, 10.0, 7.0
MEAN = 101  # samples of 1 ms
AIM = 10.0


def deviations(run: Run, from_s: float) -> np.ndarray:
    """Largest deviation of each axis (6,) from a time on."""
    t = run.log["time_s"].to_numpy()
    inside = (t > from_s) & (t < t[-1] - 0.2)
    found = []
    for axis in AXES:
        off = band_limit(t, run.log[f"true_{axis}"].to_numpy()) - run.log[f"commanded_{axis}"].to_numpy()
        off -= np.convolve(off, np.ones(MEAN) / MEAN, "same")
        found.append(np.abs(off[inside]).max())
    return np.array(found)


def ratios(seed: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Plain control's deviations over the compensated ones, from LATE_s on and from EARLY_s on, (6,) each."""
    machine, scenario = load_machine("micro_motion_system"), load_scenario("combined", duration_s=DURATION_s)
    plain, adaptive = (
        simulate(machine, scenario, compensator=name, fast=True, seed=seed) for name in ("none", "adaptive")
    )
    late, early = (deviations(plain, from_s) / deviations(adaptive, from_s) for from_s in (LATE_s, EARLY_s))
    return seed, late, early


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="48:64")
    parser.add_argument("--processes", type=int, default=1)
    arguments = parser.parse_args()
    worst = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for seed, late, early in pool.map(ratios, range(*map(int, arguments.seeds.split(":")))):
            print(f"{seed}: from {LATE_s:g} s {np.round(late, 1)}, from {EARLY_s:g} s {np.round(early, 1)}", flush=True)
            worst.append((late.min(), early.min()))
    late, early = zip(*worst, strict=True)
    print(
        f"Worst axis from {LATE_s:g} s on: median {statistics.median(late):.1f}, least {min(late):.1f}, "
        f"{sum(x >= AIM for x in late)} of {len(late)} runs reach {AIM:g}; from {EARLY_s:g} s on median {statistics.median(early):.1f}"
    )


if __name__ == "__main__":
    main()
