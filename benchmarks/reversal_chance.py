"""How much of "worse than plain control" is chance: `python benchmarks/reversal_chance.py --seeds 9709:9723 [--again 5]`.

The cases of compensation_robustness.py and its rule. Floor: plain control against plain control with other sensor noise,
same leg, same motion. What it counts no compensation can be asked to beat. With `--again N`: of every case that has worse
reversals, in how many of N other sensor noises the same reversal is worse again, and plain control against itself there.
A case done is a line of benchmarks/results/reversal_chance.jsonl.gz, quoted by the page of compensation_robustness.py.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from compensation_robustness import (
    FLOOR,
    JOURNAL,
    Case,
    bumps,
    cases,
    key,
    leg_of,
    motion_of,
    run,
    run_missing,
    upper_bound,
    worse_reversals,
)
from journal import lines_of

import compensation

OTHER_NOISE = 100_000  # added to the seed of the sensor noise


def bumps_of(case: Case, name: str, noise: int) -> list[tuple[float, bool, float]]:
    """`bumps` of a case with a compensator, the sensor noise of the seed plus `noise` times OTHER_NOISE."""
    motion, duration_s, period_s = motion_of(case)
    noise_seed = case["seed"] + noise * OTHER_NOISE
    record = run(compensation.create(name), leg_of(case), motion, duration_s, period_s=period_s, seed=noise_seed)
    return bumps(record, motion, duration_s)


def floor_of(case: Case) -> Case:
    """The case with the reversals that plain control makes worse than plain control."""
    worse = worse_reversals(bumps_of(case, "none", 0), bumps_of(case, "none", 1))
    return {**case, "reversals": len(worse), "worse": sum(worse)}


def again(case: Case, noises: int) -> None:
    """Prints how often each worse reversal of the case is worse."""
    plain = [bumps_of(case, "none", i) for i in range(noises + 1)]
    other = [bumps_of(case, "adaptive", i) for i in range(noises + 1)]
    worse = [worse_reversals(b, a) for b, a in zip(plain, other, strict=True)]
    for k in (k for k, first in enumerate(worse[0]) if first):
        ratios = " ".join(f"{a[k][0] / b[k][0]:.2f}" for b, a in zip(plain, other, strict=True))
        own = sum(worse_reversals(plain[0], b)[k] for b in plain[1:])
        more = sum(w[k] for w in worse[1:])
        print(f"{key(case)}, reversal {k}: again in {more} of {noises}, ratios {ratios}, plain alone {own}")
    print(f"{key(case)}: worse {[sum(w) for w in worse]} of {len(worse[0])}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="9709:9723")
    parser.add_argument("--pairs", type=int, default=27, help="random pairs a seed")
    parser.add_argument("--again", type=int, default=0, help="other noises for the worse cases of --worse")
    parser.add_argument("--worse", type=Path, default=JOURNAL, help="journal of compensation_robustness.py")
    parser.add_argument("--journal", type=Path, default=FLOOR)
    parser.add_argument("--processes", type=int, default=1)
    arguments = parser.parse_args()
    planned = cases(range(*map(int, arguments.seeds.split(":"))), arguments.pairs, False)
    if arguments.again:
        counted = lines_of(arguments.worse)
        worse = {key(c) for c in counted if c["worse"]}
        for case in planned:
            if key(case) in worse:
                again(case, arguments.again)
        return
    done = run_missing(planned, arguments.journal, floor_of, arguments.processes)
    worse, total = (sum(c[name] for c in done) for name in ("worse", "reversals"))
    print(f"{worse} of {total} worse than itself, a share below {upper_bound(worse, total):.1e}")


if __name__ == "__main__":
    main()
