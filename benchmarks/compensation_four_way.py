"""What the adaptive algorithm survives on four-way valves: `python benchmarks/compensation_four_way.py [--seeds A:B] ...`

As compensation_robustness.py, whose bumps, motions and margins these are, on the legs of tests/compensation/pair_plant.py:
every condition alone and random pairs, masses and motions drawn by the seed, from nothing learned. A finished case is a
line of benchmarks/results/compensation_four_way.jsonl.gz (delete it after the algorithm has changed). Writes
docs/results/compensation_four_way.md.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from compensation_robustness import IRREGULAR, MOTIONS, Case, compared, run_missing, upper_bound
from journal import RESULTS
from pair_plant import PairLeg, run_pair  # pyright: ignore[reportMissingImports] (with the tests)

RESULT = Path(__file__).parents[1] / "docs" / "results" / "compensation_four_way.md"
JOURNAL = RESULTS / "compensation_four_way.jsonl.gz"
CONDITIONS: dict[str, dict[str, float]] = {
    "as declared": {},
    "position delay 2 ms": {"position_delay_s": 2e-3},
    "position delay 4 ms": {"position_delay_s": 4e-3},
    "position delay 6 ms": {"position_delay_s": 6e-3},
    "valve delay 2 ms": {"valve_delay_s": 2e-3},
    "valve delay 4 ms": {"valve_delay_s": 4e-3},
    "valve delay 6 ms": {"valve_delay_s": 6e-3},
    "no piston leak": {"piston_leak_m3_s_Pa": 0.0},
    "piston leak 1.5e-12": {"piston_leak_m3_s_Pa": 1.5e-12},
    "piston leak 3e-12": {"piston_leak_m3_s_Pa": 3e-12},
    "null 0.09 V": {"null_V": 0.09},
    "null -0.15 V": {"null_V": -0.15},
    "air 1 %": {"air": 0.01},
    "air 3 %": {"air": 0.03},
    "hysteresis 30 mV": {"backlash_V": 0.03},
    "return line 1e9 Pa s/m3": {"return_Pa_s_m3": 1e9},
    "spool 50 Hz": {"spool_Hz": 50.0},
    "spool 120 Hz": {"spool_Hz": 120.0},
    "overlap 5 um": {"overlap_m": 5e-6},
    "overlap 10 um": {"overlap_m": 1e-5},
    "overlap 20 um": {"overlap_m": 2e-5},
    "underlap 5 um": {"overlap_m": -5e-6},
    "sharp edges": {"rounding_m": 2e-7},
    "differential cylinder": {"ratio": 0.48},
    "Coulomb friction 300 N": {"coulomb_N": 300.0},
}
MASSES_kg = (120.0, 250.0, 500.0)


def result_of(case: Case) -> Case:
    """The case with what came of it."""
    changes: dict[str, float] = {}
    for name in case["conditions"]:
        changes |= CONDITIONS[name]
    return compared(case, lambda: PairLeg(mass_kg=case["mass_kg"], **changes), run_pair)


def cases(seeds: Iterable[int], pairs: int) -> list[Case]:
    """As compensation_robustness.cases; every fourth seed has the bench's sine at 250 kg for each condition alone."""
    motions, found = [*MOTIONS, IRREGULAR], []
    for seed in seeds:
        draw = np.random.default_rng(seed)
        together = list(itertools.combinations(list(CONDITIONS)[1:], 2))
        chosen = [(name,) for name in CONDITIONS]
        chosen += [together[i] for i in draw.choice(len(together), pairs, replace=False)]
        for conditions in chosen:
            alone = seed % 4 == 0 and len(conditions) == 1
            motion, mass_kg = motions[draw.integers(4)], MASSES_kg[draw.integers(3)]
            motion, mass_kg = (motions[0], 250.0) if alone else (motion, mass_kg)
            found.append({"conditions": conditions, "mass_kg": mass_kg, "motion": motion, "seed": seed, "host": False})
    return found


def page(done: list[Case], command: str) -> str:
    """The page: how many reversals are worse, and what remains of the bump under each condition."""
    total, bad = (sum(c[name] for c in done) for name in ("reversals", "worse"))
    lines = [
        "# Compensation on four-way valves", "",
        "The same question as in [Compensation beside effects that it does not know](compensation_robustness.md), for legs whose",
        "two chambers hang on a four-way valve (tests/compensation/pair_plant.py, no code of hexsim), under proportional control,",
        "with nothing learned.", "", f"    {command}", "",
        f"{len(done)} runs have {total} reversals; **{bad}** are worse than under plain control (bound with 95 % confidence: "
        f"{1e4 * upper_bound(bad, total):.0f} of 10,000).",
        "The bump is the peak deviation in 50 Hz [m/s2] of 250 kg in heave of 0.05 m at 0.5 Hz, one noise.", "",
        "| condition | plain | adaptive |", "|---|---|---|",
    ]  # fmt: skip
    for name in CONDITIONS:
        bench = [
            c
            for c in done
            if list(c["conditions"]) == [name] and c["mass_kg"] == 250.0 and c["motion"] == "0.05 m 0.5 Hz"
        ]
        plain, adaptive = (max((c[k] for c in bench), default=math.nan) for k in ("plain", "adaptive"))
        lines.append(f"| {name} | {plain:.2f} | {adaptive:.3f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="9700:9708")
    parser.add_argument("--pairs", type=int, default=25, help="random pairs a seed")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--journal", type=Path, default=JOURNAL)
    arguments = parser.parse_args()
    planned = cases(range(*map(int, arguments.seeds.split(":"))), arguments.pairs)
    done = run_missing(planned, arguments.journal, result_of, arguments.processes)
    command = f"python benchmarks/compensation_four_way.py --seeds {arguments.seeds}"
    if arguments.journal == JOURNAL:
        RESULT.write_text(page(done, command), encoding="utf-8")


if __name__ == "__main__":
    main()
