"""What a compensator leaves on legs of which every number is drawn: `python benchmarks/robustness_grid.py --compensator adaptive`

Legs of benchmarks/grid, on a plant of their own (no code of hexsim); `--priors` prints every number with its draws and the reason.
Each draw and motion is run three times: plain control, plain control with another noise, and with the compensator from nothing
learned. `--oracle`: and with the volts of a perfect inverse, so that a figure can be read as "of what is possible".

Figures (benchmarks/grid/figures.py): worst bump of the second half without and with compensation, share left, reversals worse than
plain control and worse than it with either noise, when the compensator engaged, and what keeps it out if it did not.

`--host 60,jitter=0.2,loss=0.02`: setpoints come in a host's packets, and what they do not tell yet is predicted.

`--family platform`: hexsim's own 600 kg hexapod in heave, its numbers drawn (benchmarks/grid/platform.py), `--declared right` or
`sheet`.

`--stop`: a sequential test of the wanted share of runs that are left at most `--limit` (Wald): it ends when the share is shown to be
at least WANTED, or at most WANTED - APART, each with an error of 5 % (runs taken as independent; motions of one draw are not quite).

    from benchmarks.robustness_grid import draw_leg, motion_of, run_leg, run_plain, figures, perfect
"""

from __future__ import annotations

import argparse
import math
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import compensation  # noqa: E402
from benchmarks.grid.figures import Figures, bumps, figures, late  # noqa: E402
from benchmarks.grid.legs import DECLARED, FAMILIES, Leg, draw_leg  # noqa: E402
from benchmarks.grid.loop import Run, run_leg, run_plain  # noqa: E402
from benchmarks.grid.motions import MOTIONS, Motion, motion_of  # noqa: E402
from benchmarks.grid.oracle import perfect  # noqa: E402
from benchmarks.grid.priors import SINGLE, table  # noqa: E402
from benchmarks.journal import append, lines_of  # noqa: E402
from compensation import preview_count  # noqa: E402

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
    "perfect",
    "run_leg",
    "run_plain",
]
VALVES = {"three-way": (False,), "four-way": (True,), "both": (False, True)}
WANTED, APART, ERROR = (
    0.8,
    0.15,
    0.05,
)  # share of runs; the share that is told from it; of each of the two wrong decisions
KEPT = 0.95  # of plain control's bump: more than that is not improved
PLATFORM = "platform"  # the family of hexapods, beside those of legs
HOW = """Legs on a plant of their own; every number with its priors and reasons: `--priors`. Every run
begins with nothing learned. Bump: largest deviation of the true acceleration (50 Hz) from the linear answer to the setpoint at a
commanded reversal; share left: the worst of the run's second half over plain control's. The perfect inverse has the true numbers and
the same noise, counts and tick; it feeds forward only: it neither shapes the volts' counts nor stabilises stick-slip.
"""
Row = dict[str, Any]


def judged(case: Row) -> Row:
    """A case with what came of it."""
    began = time.perf_counter()
    if case["family"] == PLATFORM:
        from benchmarks.grid.platform import judged_platform  # MuJoCo, for this family alone

        found, reason, draw = judged_platform(case["seed"], case["compensator"], case["declared"])
        return {
            **case,
            "leg": "",
            **asdict(found),
            "share": found.share,
            "possible": None,
            "reason": reason,
            "statuses": [],
            "took_s": round(time.perf_counter() - began, 2),
            "draw": draw,
        }
    leg = draw_leg(case["seed"], case["family"], four_way=case["four_way"], declared=case["declared"])
    motion = motion_of(case["motion"], case["seed"])
    compensator, host = compensation.create(case["compensator"]), case.get("host", "")
    look = preview_count(compensator, leg.context)
    plain, again = (run_plain(leg, motion, noise=k, host=host, look=look) for k in (0, 1))
    run = run_leg(compensator, leg, motion, host=host)
    found = figures(run, plain, again)
    possible = late(bumps(perfect(leg, motion)), motion) if case["oracle"] else None
    return {
        **case,
        "leg": leg.name,
        **asdict(found),
        "share": found.share,
        "possible": possible,
        "reason": run.reason,
        "statuses": run.statuses[-5:],
        "took_s": round(time.perf_counter() - began, 2),
        "draw": leg.truth,
    }


def key(case: Row) -> tuple[Any, ...]:
    names = ("compensator", "family", "declared", "four_way", "seed", "motion", "oracle")
    return *(case[name] for name in names), case.get("host", "")


def evidence(good: int, bad: int, wanted: float = WANTED, apart: float = APART) -> float:
    """Log of the likelihood of `wanted` over that of `wanted - apart`; beyond +-`bound()` it is decided."""
    least = wanted - apart
    return good * math.log(wanted / least) + bad * math.log((1.0 - wanted) / (1.0 - least))


def bound() -> float:
    """Wald's, for two errors of ERROR."""
    return math.log((1.0 - ERROR) / ERROR)


def interval(hits: int, count: int) -> tuple[float, float]:
    """95 % of a share (Clopper-Pearson)."""
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    return low, float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0


def summary(rows: list[Row]) -> str:
    """The shares, with their 95 % intervals, and the reversals as Markdown."""
    count = len(rows)
    tests: dict[str, Callable[[Row], bool]] = {
        "at most 1/10 left": lambda r: r["share"] <= 0.1,
        "at most 1/5 left": lambda r: r["share"] <= 0.2,
        "at most 1/2 left": lambda r: r["share"] <= 0.5,
        "not improved": lambda r: r["share"] > KEPT,
        "engaged at the end": lambda r: r["engaged_s"] is not None,
    }
    lines = ["| of the runs | share | 95 % |", "|---|---|---|"]
    for name, test in tests.items():
        hits = sum(map(test, rows))
        low, high = interval(hits, count)
        lines.append(
            f"| {name} | {100 * hits / count:.0f} % ({hits} of {count}) | {100 * low:.0f} to {100 * high:.0f} % |"
        )
    shares = np.array([r["share"] for r in rows])
    lines += ["", f"Share left: median {np.median(shares):.3f}, worst {shares.max():.2f}."]
    ideal = [r for r in rows if r["possible"]]
    if ideal:
        of_plain = np.array([r["possible"] / r["plain"] for r in ideal])
        ratio = np.array([r["left"] / r["possible"] for r in ideal])
        lines.append(
            f"A perfect inverse leaves a median of {np.median(of_plain):.3f}, at most 1/10 in {100 * np.mean(of_plain <= 0.1):.0f} %, "
            f"at most 1/5 in {100 * np.mean(of_plain <= 0.2):.0f} %; left over what it leaves: median {np.median(ratio):.1f}."
        )
    worse, beyond, chance, total = (sum(r[name] for r in rows) for name in ("worse", "beyond", "chance", "reversals"))
    lines.append(
        f"Of {total} reversals {worse} are worse than plain control's by 5 % and 0.03 m/s2 (plain control against itself with another "
        f"noise: {chance}), {beyond} worse than with either noise; largest growth {max(r['growth'] for r in rows):.2f} m/s2."
    )
    return "\n".join(lines)


def reasons(rows: list[Row]) -> str:
    """Each run that is not improved, with what the compensator says, as Markdown."""
    kept = [r for r in rows if r["share"] > KEPT]
    lines = ["| not improved | motion | plain | left | why |", "|---|---|---|---|---|"]
    for r in kept:
        name = r["leg"] or f"{'four-way ' if r['four_way'] else ''}{r['seed']}"
        why = r["reason"] or "engaged" if r["engaged_s"] is not None else r["reason"] or "says nothing"
        lines.append(f"| {name} | {r['motion']} | {r['plain']:.2f} | {r['left']:.2f} | {why} |")
    return "\n".join(lines)


def page(rows: list[Row], command: str, commit: str) -> str:
    """A short page: question, how, table, reasons by their kind."""
    kinds = Counter(kind_of(r) for r in rows if r["share"] > KEPT)
    motions, draws, first = ", ".join(dict.fromkeys(r["motion"] for r in rows)), len({r["seed"] for r in rows}), rows[0]
    lines = [
        "# How much of the bump is left on a machine of which every number is drawn?",
        "",
        f"`{command}`, commit {commit}. Compensator `{first['compensator']}`, family `{first['family']}`, data sheet: "
        f"{first['declared']}; {draws} draws, motions {motions}.",
        "",
        summary(rows),
        "",
        HOW,
        "| kept out by | runs |",
        "|---|---|",
    ]
    return "\n".join([*lines, *(f"| {kind} | {count} |" for kind, count in kinds.most_common()), ""])


def kind_of(row: Row) -> str:
    """What keeps a compensator out, its numbers left out."""
    if row["engaged_s"] is not None:
        return "nothing: engaged, and no better"
    return re.sub(r"[-+]?\d[\d.]*", "..", row["reason"].split(";")[0]) or "says nothing"


def planned(a: argparse.Namespace) -> list[Row]:
    """The cases of the arguments. Of hexapods: heave on their three-way valves, without a perfect inverse."""
    first, last = map(int, a.seeds.split(":"))
    if a.family == PLATFORM:
        rest = {
            "compensator": a.compensator,
            "family": PLATFORM,
            "declared": a.declared,
            "four_way": False,
            "oracle": False,
        }
        return [rest | {"seed": seed, "motion": "heave"} for seed in range(first, last)]
    return [
        {
            "compensator": a.compensator,
            "family": a.family,
            "declared": a.declared,
            "four_way": four_way,
            "seed": seed,
            "motion": motion,
            "oracle": a.oracle,
            "host": a.host,
        }
        for seed in range(first, min(last, len(SINGLE)) if a.family == "single" else last)
        for four_way in VALVES[a.valve]
        for motion in (MOTIONS if a.motions == "all" else a.motions.split(","))
    ]


def line_of(row: Row, number: int, count: int, began: float) -> str:
    """A line of progress."""
    engaged = "never" if row["engaged_s"] is None else f"{row['engaged_s']:.1f} s"
    possible = "" if row["possible"] is None else f", possible {row['possible']:.3f}"
    left_s = (time.perf_counter() - began) / number * (count - number)
    return (
        f"{number}/{count} ({left_s:.0f} s to go) {row['leg'] or row['seed']}{' four-way' if row['four_way'] else ''} {row['motion']}: "
        f"{row['plain']:.3f} -> {row['left']:.3f} ({row['share']:.2f}{possible}), engaged {engaged}, "
        f"worse {row['beyond']}/{row['reversals']} {row['reason']}"
    )


def run_through(cases: list[Row], journal: Path | None, jobs: int) -> Iterator[Row]:
    """The cases in their order, those of the journal read from it; what is new is written there and told."""
    done = {key(row): row for row in lines_of(journal)}
    missing = [case for case in cases if key(case) not in done]
    began, number = time.perf_counter(), 0
    with ProcessPoolExecutor(jobs) as pool:
        waiting = iter(missing)
        running = [pool.submit(judged, case) for case in islice(waiting, 2 * jobs)]
        for case in cases:
            if key(case) in done:
                yield done[key(case)]
                continue
            row, number = running.pop(0).result(), number + 1
            running += [pool.submit(judged, more) for more in islice(waiting, 1)]
            print(line_of(row, number, len(missing), began), flush=True)
            if journal:
                append(row, journal)
            yield row


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--compensator", default="adaptive", help="a name, or package.module:Class")
    parser.add_argument("--family", choices=(*FAMILIES, PLATFORM), default="reality")
    parser.add_argument("--declared", choices=DECLARED, default="nothing", help="of the data sheet")
    parser.add_argument("--valve", choices=tuple(VALVES), default="three-way")
    parser.add_argument("--seeds", default="0:20", help="first:last; of single: rows of the table")
    parser.add_argument("--motions", default="sine,multisine", help=f"all, or of {', '.join(MOTIONS)}")
    parser.add_argument(
        "--oracle", action=argparse.BooleanOptionalAction, default=False, help="with the perfect inverse"
    )
    parser.add_argument("--host", default="", help="packets that the setpoints come in: 60,jitter=0.2,loss=0.02")
    parser.add_argument("--stop", action="store_true", help="end when the wanted share is decided")
    parser.add_argument("--limit", type=float, default=0.2, help="share left that counts for --stop")
    parser.add_argument("--wanted", type=float, default=WANTED, help="share of runs for --stop")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--journal", type=Path, help="a line a run; runs that it holds are not run again")
    parser.add_argument("--page", type=Path, help="write the result there as Markdown")
    parser.add_argument("--priors", action="store_true", help="print the table of priors and end")
    return parser.parse_args()


def main() -> None:
    a = arguments()
    if a.priors:
        print(table())
        return
    rows: list[Row] = []
    for row in run_through(planned(a), a.journal, a.jobs):
        rows.append(row)
        good = sum(r["share"] <= a.limit for r in rows)
        found = evidence(good, len(rows) - good, a.wanted)
        if a.stop and abs(found) > bound():
            say = "at least" if found > 0 else "not"
            print(f"decided after {len(rows)} runs: {say} {100 * a.wanted:.0f} % are left at most {a.limit:g}")
            break
    if a.stop:
        print(
            f"power: a share of {100 * a.wanted:.0f} % is refused, and one of {100 * (a.wanted - APART):.0f} % is accepted, "
            f"in {100 * ERROR:.0f} % each"
        )
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=ROOT
    ).stdout.strip()
    if a.page:
        command = " ".join(["python benchmarks/robustness_grid.py", *sys.argv[1:]])
        a.page.write_text(page(rows, command, commit))
    print(f"commit {commit}\n\n{summary(rows)}\n\n{reasons(rows)}")


if __name__ == "__main__":
    main()
