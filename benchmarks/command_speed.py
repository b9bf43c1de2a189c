"""Processor seconds of commands, today's tree and an older commit in turn: `python benchmarks/command_speed.py --first`.

Writes "commands" and "profile" in docs/results/speed.json and the tables of docs/results/speed.md. Each row is a process of its
own (user and system time), the trees in turn, the median of all rounds, with warm caches; --first also measures a first run of
each tree, which compiles. Other work on the machine raises both sides: read the ratios. With --keep FOLDER the older tree and both
caches stay there for the next time. --rows TEXT ... measures the rows that contain one of them; other rows stay as they were.

The profile says where the processor time of `hexsim run heave` goes, by package: every 2 ms of it the innermost frame of a package
gets what has gone by, compiled code's to who called it.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "docs" / "results" / "speed.json"
PAGE = RESULT.with_suffix(".md")
FIRST = "first run after installation (compiles)"
CLI = ("-m", "hexsim.cli")
SIMULATED_S = 40.0
RATE = f"""
import time
from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
machine = load_machine("micro_motion_system")
simulate(machine, load_scenario("heave", duration_s=1.0), fast=True)
begun = time.process_time()
simulate(machine, load_scenario("heave", duration_s={SIMULATED_S}), fast=True)
print({SIMULATED_S} / (time.process_time() - begun))
"""
SWEEP = f"""
import time
from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.studies.sweep import cases, run_case
machine = load_machine("micro_motion_system")
one = cases(load_scenario("heave", duration_s=1.0), machine)[0]
assert run_case(one)["complete"]
many = cases(load_scenario("heave", duration_s={SIMULATED_S / 2}), machine, seeds=range(2))
begun = time.process_time()
assert all(run_case(case)["complete"] for case in many)
print({SIMULATED_S} / (time.process_time() - begun))
"""
GYM = """
import time
import numpy as np
from hexsim.gym import HexsimVectorEnv
many = HexsimVectorEnv(64, machine="micro_motion_system", threads=1)
many.reset(seed=0)
still = np.zeros((64, 6))
many.step(still)
begun = time.process_time()
for _ in range(100):
    many.step(still)
print(100 * 64 * many.task.tick_s / (time.process_time() - begun))
"""
PROFILE = """
import contextlib, io, json, os, signal, sys, time
sys.argv = ["hexsim", "run", "heave", "--out", sys.argv[1]]
found, last = {}, time.process_time()
def package(frame):
    while frame is not None:
        parts = frame.f_code.co_filename.split(os.sep)
        if "importlib" in frame.f_code.co_filename:
            return "imports"
        if "site-packages" in parts:
            return parts[parts.index("site-packages") + 1].removesuffix(".py")
        if "hexsim" in parts[:-1]:
            return ".".join(["hexsim", *parts[parts.index("hexsim") + 1 : -1]][:2])
        frame = frame.f_back
    return "Python"
def look(_, frame):
    global last
    now, name = time.process_time(), package(frame)
    found[name], last = found.get(name, 0.0) + now - last, now
signal.signal(signal.SIGPROF, look)
signal.setitimer(signal.ITIMER_PROF, 0.002, 0.002)
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    from hexsim.cli import main
    main()
signal.setitimer(signal.ITIMER_PROF, 0.0)
print(json.dumps(found))
"""
IMPORTS = """
import hexsim
from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
"""
BENCH = IMPORTS + 'simulate(load_machine("bench"), load_scenario("heave"))\n'
ROWS: dict[str, tuple[str, ...]] = {  # each ends with the folder of its files, but for code
    "`hexsim run heave` (20 s; figures, report, recording)": (*CLI, "run", "heave", "--out"),
    "`hexsim run heave --no-recording --no-report`": (
        *CLI,
        "run",
        "heave",
        "--no-recording",
        "--no-report",
        "--out",
    ),
    "`hexsim compare heave` (all compensators; figures, report, recording)": (*CLI, "compare", "heave", "--out"),
    "in Python: imports of a run": ("-c", IMPORTS),
    "in Python: imports and 20 s on a bench": ("-c", BENCH),
    "`--fast` with its log: simulated s of a hexapod in a processor second": ("-c", RATE),
    "`hexsim sweep`, a worker: the same": ("-c", SWEEP),
    "gym, 64 hexapods, a thread: the same": ("-c", GYM),
}
AIMS = dict(zip((FIRST, *ROWS), (26 / 15, 6.5 / 3, 4.8 / 1.5, 32 / 10, 4 / 1, 10 / 3, *[250 / 89] * 3), strict=True))
COMPILES = ROWS["`hexsim run heave --no-recording --no-report`"]


class Side:
    """A tree of sources with a cache of its own."""

    def __init__(self, name: str, tree: Path, cache: Path) -> None:
        self.name, self.values = name, {row: [] for row in (FIRST, *ROWS)}
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(tree),
            "NUMBA_CACHE_DIR": str(cache),
            "OMP_NUM_THREADS": "1",
            "PYTHONDONTWRITEBYTECODE": "",
            "PYTHONPYCACHEPREFIX": f"{cache}_pyc",  # byte code is there, as after pip
        }
        self.is_new = not cache.exists()

    def measure(self, command: tuple[str, ...], cache: str | None = None) -> float:
        """Processor time of a command [s], or the number that its code prints. cache: another folder of compiled code."""
        environment = self.environment | ({"NUMBA_CACHE_DIR": cache} if cache else {})
        with tempfile.TemporaryDirectory() as folder:
            whole = [sys.executable, *command, *([f"{folder}/out"] if command[-1] == "--out" else [])]
            process = subprocess.Popen(
                whole, env=environment, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
            assert process.stdout is not None
            printed = process.stdout.read()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{self.name}: {' '.join(command)} ended with {process.returncode}")
        return float(printed) if command[-1] in PRINT_RATES else usage.ru_utime + usage.ru_stime

    def profile(self) -> dict[str, float]:
        """Processor seconds of `hexsim run heave` by package."""
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-c", PROFILE, f"{folder}/out"]
            printed = subprocess.check_output(
                command, env=self.environment, cwd=folder, stderr=subprocess.DEVNULL, text=True
            )
        return json.loads(printed.splitlines()[-1])

    def note(self, row: str, value: float) -> None:
        """One more value of a row."""
        self.values[row].append(value)
        print(f"{self.name}: {row}: {value:.2f}", flush=True)


def older_tree(commit: str, place: Path) -> Path:
    """The sources of a commit in `place`."""
    if not place.exists():
        subprocess.run(["git", "-C", ROOT, "worktree", "prune"], check=True)
        subprocess.run(["git", "-C", ROOT, "worktree", "add", "--detach", place, commit], check=True)
    return place


def measured(sides: list[Side], rows: list[str], rounds: int, first: bool) -> None:
    """Rows of all sides in turn, once their caches are filled."""
    for side in sides if first else []:
        with tempfile.TemporaryDirectory() as cache:
            side.note(FIRST, side.measure(COMPILES, cache))
    for side in sides:
        for row in rows if side.is_new else []:
            side.measure(ROWS[row])
    for _ in range(rounds):
        for row in rows:
            for side in sides:
                side.note(row, side.measure(ROWS[row]))


def table_of(before: Side, now: Side) -> list[dict[str, object]]:
    """Row, both medians, and how many times as fast."""
    rows = []
    for row in (FIRST, *ROWS):
        if before.values[row] and now.values[row]:
            old, new = statistics.median(before.values[row]), statistics.median(now.values[row])
            rows.append({"what": row, "before": old, "now": new, "ratio": new / old if row in RATES else old / new})
    return rows


PRINT_RATES = (RATE, SWEEP, GYM)
RATES = {row for row, command in ROWS.items() if command[-1] in PRINT_RATES}


def page(text: str, kept: dict[str, Any]) -> str:
    """The page with its tables between the lines that mark them."""
    rows = ["| | before | now | times as fast | aim |", "|---|---|---|---|---|"]
    for row in kept["commands"]["rows"]:
        times = " | ".join(f"{row[key]:.1f}" for key in ("before", "now", "ratio"))
        rows.append(f"| {row['what']} | {times} | {AIMS[row['what']]:.1f} |")
    parts, least_s = kept["profile"], 0.1
    named = [name for name, now in parts["now"].items() if max(now, parts["before"].get(name, 0.0)) >= least_s]
    named += [name for name, before in parts["before"].items() if name not in parts["now"] and before >= least_s]
    shares = ["| | before | now |", "|---|---|---|"]
    for name in sorted(named, key=lambda name: -parts["before"].get(name, 0.0)):
        shares.append(f"| {name} | {parts['before'].get(name, 0.0):.1f} | {parts['now'].get(name, 0.0):.1f} |")
    rest = (sum(own for name, own in side.items() if name not in named) for side in (parts["before"], parts["now"]))
    shares.append(f"| all others | {' | '.join(f'{own:.1f}' for own in rest)} |")
    for name, lines in (("table", rows), ("profile", shares)):
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        text = text[: text.index(begin)] + begin + "\n".join(lines) + "\n" + text[text.index(end) :]
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", default="02da0ba", help="the older commit")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", type=Path, help="folder of the older tree and both caches, made where there is none")
    parser.add_argument("--first", action="store_true", help="also a first run, which compiles")
    parser.add_argument("--rows", default=[""], nargs="+", help="parts of the names of the rows to measure")
    arguments = parser.parse_args()
    chosen = [row for row in ROWS if any(part in row for part in arguments.rows)]
    with tempfile.TemporaryDirectory() as thrown_away:
        place = (arguments.keep or Path(thrown_away)).resolve()
        place.mkdir(parents=True, exist_ok=True)
        tree = older_tree(arguments.against, place / arguments.against)
        try:
            before = Side(arguments.against, tree, place / f"cache_{arguments.against}")
            now = Side("now", ROOT, place / "cache_now")
            measured([before, now], chosen, arguments.rounds, arguments.first)
            profile = {name: side.profile() for name, side in (("before", before), ("now", now))}
        finally:
            if arguments.keep is None:
                subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", tree], check=True)
    kept = json.loads(RESULT.read_text(encoding="utf-8"))
    known = {row["what"]: row for row in kept.get("commands", {}).get("rows", [])}
    known |= {row["what"]: row for row in table_of(before, now)}
    rows = [known[row] for row in (FIRST, *ROWS) if row in known]
    commit = subprocess.run(
        ["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
    )
    kept["commands"] = {"commit": commit.stdout.strip(), "against": arguments.against, "rows": rows}
    kept["profile"] = profile
    RESULT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8"), kept), encoding="utf-8")
    table = Table("what", arguments.against, "now", "times as fast")
    for row in rows:
        table.add_row(str(row["what"]), *(f"{row[key]:.2f}" for key in ("before", "now", "ratio")))
    Console().print(table)


if __name__ == "__main__":
    main()
