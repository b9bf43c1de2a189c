"""What a compensator leaves on legs of which every number is drawn: `python benchmarks/robustness_grid.py --compensator adaptive`

Legs of benchmarks/grid (no code of hexsim), priors in benchmarks/grid/priors.py. In Python:

    from benchmarks.robustness_grid import draw_leg, motion_of, run_leg
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import compensation  # noqa: E402
from benchmarks.grid.figures import Figures, bumps, figures, late  # noqa: E402
from benchmarks.grid.legs import DECLARED, FAMILIES, Leg, draw_leg  # noqa: E402
from benchmarks.grid.loop import Run, run_leg, run_plain  # noqa: E402
from benchmarks.grid.motions import MOTIONS, Motion, motion_of  # noqa: E402
from benchmarks.grid.priors import SINGLE, table  # noqa: E402

__all__ = [
    "Figures",
    "Leg",
    "Motion",
    "Run",
    "bumps",
    "draw_leg",
    "figures",
    "late",
    "motion_of",
    "run_leg",
    "run_plain",
]
Row = dict[str, Any]


def judged(case: Row) -> Row:
    """A case with what came of it."""
    began = time.perf_counter()
    leg = draw_leg(case["seed"], case["family"], four_way=case["four_way"], declared=case["declared"])
    motion = motion_of(case["motion"], case["seed"])
    plain, again = run_plain(leg, motion), run_plain(leg, motion, noise=1)
    run = run_leg(compensation.create(case["compensator"]), leg, motion)
    found = figures(run, plain, again)
    return {
        **case, "leg": leg.name, **asdict(found), "share": found.share, "reason": run.reason, "statuses": run.statuses[-5:],
        "took_s": round(time.perf_counter() - began, 2), "draw": leg.truth,
    }  # fmt: skip


def key(case: Row) -> tuple[Any, ...]:
    return tuple(case[name] for name in ("compensator", "family", "declared", "four_way", "seed", "motion"))


def summary(rows: list[Row]) -> str:
    """The shares as a table."""
    count = len(rows)

    def share(test: Any) -> str:
        return f"{100 * sum(map(test, rows)) / count:.0f} %"

    worse, beyond, chance, total = (sum(r[name] for r in rows) for name in ("worse", "beyond", "chance", "reversals"))
    return "\n".join(
        [
            f"{count} runs: at most 1/10 left {share(lambda r: r['share'] <= 0.1)}, 1/5 {share(lambda r: r['share'] <= 0.2)}, "
            f"1/2 {share(lambda r: r['share'] <= 0.5)}; not improved {share(lambda r: r['share'] > 0.95)}; "
            f"median {sorted(r['share'] for r in rows)[count // 2]:.3f}",
            f"{total} reversals: {worse} worse than plain control, {beyond} beyond chance (plain against itself {chance})",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--compensator", default="adaptive")
    parser.add_argument("--family", choices=FAMILIES, default="reality")
    parser.add_argument("--declared", choices=DECLARED, default="nothing", help="of the data sheet")
    parser.add_argument("--valve", choices=("three-way", "four-way"), default="three-way")
    parser.add_argument("--seeds", default="0:20", help="first:last; of single: rows of the table")
    parser.add_argument("--motions", default="sine,multisine", help=f"of {', '.join(MOTIONS)}")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--journal", type=Path, help="a line a run; runs that it holds are not run again")
    parser.add_argument("--priors", action="store_true", help="print the table of priors and end")
    a = parser.parse_args()
    if a.priors:
        print(table())
        return
    first, last = map(int, a.seeds.split(":"))
    cases = [
        {
            "compensator": a.compensator, "family": a.family, "declared": a.declared, "four_way": a.valve == "four-way",
            "seed": seed, "motion": motion,
        }
        for seed in range(first, min(last, len(SINGLE)) if a.family == "single" else last)
        for motion in a.motions.split(",")
    ]  # fmt: skip
    rows = [json.loads(line) for line in a.journal.read_text().splitlines()] if a.journal and a.journal.exists() else []
    done = {key(row): row for row in rows}
    missing = [case for case in cases if key(case) not in done]
    with ProcessPoolExecutor(a.jobs) as pool:
        for number, row in enumerate(pool.map(judged, missing)):
            done[key(row)] = row
            engaged = "never" if row["engaged_s"] is None else f"{row['engaged_s']:.1f} s"
            print(
                f"{number + 1}/{len(missing)} {row['seed']} {row['leg']} {row['motion']}: {row['plain']:.3f} -> {row['left']:.3f} "
                f"({row['share']:.2f}), engaged {engaged}, worse {row['worse']}/{row['reversals']}, {row['took_s']} s {row['reason']}",
                flush=True,
            )
            if a.journal:
                with a.journal.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    print(summary([done[key(case)] for case in cases]))


if __name__ == "__main__":
    main()
