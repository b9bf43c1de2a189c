"""What `hexsim trace` costs: time on one core and on all, in simulations of its logs too; memory; its steps.

    python benchmarks/tracing_speed.py FOLDER --fit fit --fit sweep --validate validate
    python benchmarks/tracing_speed.py --hexapod 1021       a rough hexapod of the second plant, written first
    python benchmarks/tracing_speed.py --long               400 s to fit and 100 s held out at 1 kHz: 500,000 rows

The trace runs from its command, recordings and all, in a process of its own. Processor time over that of one simulation of all
fit logs, measured here beside it, does not depend on the computer; wall time means something on idle cores alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table
from speed import least

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
LONG_S = {"fit": 400.0, "validate": 100.0}


def long_bench(folder: Path) -> tuple[list[str], list[str]]:
    """A clean bench of the second plant with a leak, logged for minutes; its logs to fit and held out."""
    from other_plant import KNOWN, write_machine

    leak = "leakage_supply_to_chamber"
    for run, duration_s in LONG_S.items():
        effects = {leak: KNOWN[leak].size("bench")}
        write_machine(folder, 30, effects, "bench", runs=(run,), duration_s=duration_s, suffix=".parquet")
    return ["fit"], ["validate"]


def rough_hexapod(folder: Path, seed: int) -> tuple[list[str], list[str]]:
    """One large effect over the small ones of each leg; its logs to fit and held out."""
    from other_plant import write_machine
    from rough_hexapods import draw

    write_machine(folder, seed, draw(seed)[0], "hexapod")
    return ["fit"], ["validate_heave", "validate_roll"]


def ended(command: list[str]) -> tuple[float, float, float]:
    """(processor time [s], wall time [s], largest resident memory [MB]) of a command."""
    begin = time.perf_counter()
    process = subprocess.Popen([sys.executable, *command], env=ENVIRONMENT, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - begin, usage.ru_maxrss / 1024.0


def simulated_s(folder: Path, fit: list[str], validate: list[str]) -> float:
    """Processor time of one simulation of all fit logs [s], the least of three."""
    from hexsim.tracing.steps.logs import begin

    state = begin(folder, fit, validate)
    logs = range(len(state.fit_problem.logs))
    return least(3, lambda: [state.fit_problem.answer(state.machine, i) for i in logs])[0]


def measured(folder: Path, fit: list[str], validate: list[str]) -> None:
    """Trace the folder's machine and print what it took."""
    given = [part for name in fit for part in ("--fit", name)]
    given += [part for name in validate for part in ("--validate", name)]
    imports = [ended(["-c", "import hexsim.tracing.trace"]) for _ in range(3)]
    with tempfile.TemporaryDirectory() as out:
        cpu, wall, memory = ended(["-m", "hexsim.cli", "trace", str(folder), *given, "--out", f"{out}/trace"])
        report = json.loads((Path(out) / "trace" / "report.json").read_text(encoding="utf-8"))
    bare = simulated_s(folder, fit, validate)
    table = Table("what", "value", title=f"{folder.name}: {report['verdict']}")
    rows = {
        "processor time / one simulation of the fit logs": f"{cpu / bare:.0f}",
        "processor time [s]": f"{cpu:.1f}",
        "wall time [s]": f"{wall:.1f}",
        "cores used": f"{cpu / wall:.2f}",
        "largest resident memory [MB]": f"{memory:.0f}",
        "one simulation of the fit logs [s]": f"{bare:.3f}",
        "imports, processor time [s]": f"{min(own[0] for own in imports):.2f}",
        "imports, wall time [s]": f"{min(own[1] for own in imports):.2f}",
    }
    steps = {
        f"{step['name']}, wall time [s]": f"{step['seconds']:.1f}" for step in report["steps"] if step["seconds"] > 0.05
    }
    for what, value in (rows | steps).items():
        table.add_row(what, value)
    Console().print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--fit", action="append")
    parser.add_argument("--validate", action="append")
    parser.add_argument("--hexapod", type=int, help="seed of a rough hexapod")
    parser.add_argument("--long", action="store_true")
    given = parser.parse_args()
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing")]
    if given.folder:
        return measured(given.folder, given.fit or ["fit"], given.validate or ["validate"])
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / ("long" if given.long else "hexapod")
        measured(folder, *(long_bench(folder) if given.long else rough_hexapod(folder, given.hexapod or 1021)))


if __name__ == "__main__":
    main()
