"""Memory and time of large sweeps: `python benchmarks/sweep_memory.py` prints a line of JSON a sweep.

    real       so many bench runs of half a second on machines drawn from [uncertainty], two worker processes
    instant    100,000 rows as those runs give them, without the runs: what the sweep itself costs at full size

Memory is the largest resident set of the sweeping process, without its workers. The extrapolation to 100,000 real runs is
the time of the instant ones plus the real runs' time in proportion.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from hexsim.cli.sweep import executor_of
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.studies.sweep import Case, cases, run_case, sweep

ALL = 100_000


class Instant(Executor):
    """Gives every case the same row under its own key."""

    def __init__(self, row: dict[str, Any]) -> None:
        self.row = row

    def submit(self, function: Any, /, case: Case) -> Future[dict[str, Any]]:
        future: Future[dict[str, Any]] = Future()
        future.set_result(self.row | {"key": case.key, "seed": case.seed})
        return future


def drawn_cases(count: int) -> list[Case]:
    machine = load_machine("bench")
    widths = {"moving_mass_kg": 0.1, "overlap_m": 0.5, "bulk_modulus_Pa": 0.2}
    machine = changed(machine, {"uncertainty": widths})
    return cases(load_scenario("heave", duration_s=0.5), machine, draws=count)


def measured(real: bool, count: int) -> None:
    """Sweep, and print what it took."""
    with tempfile.TemporaryDirectory() as folder:
        begin, out = time.perf_counter(), Path(folder) / "table"
        made = drawn_cases(count)
        made_s = time.perf_counter() - begin
        if real:
            with executor_of(None, 2) as (executor, workers, _):
                sweep(made, executor, out, workers=workers)
        else:
            sweep(made, Instant(run_case(made[0]) | {"error": None}), out)
        table = pl.scan_parquet(out / "*.parquet")
        found = {
            "runs": count,
            "real": real,
            "seconds": time.perf_counter() - begin,
            "cases_made_s": made_s,
            "largest_resident_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
            "files": len(list(out.iterdir())),
            "rows": table.select(pl.len()).collect().item(),
            "keys": table.select(pl.col("key").n_unique()).collect().item(),
            "failed": table.select(pl.col("error").is_not_null().sum()).collect().item(),
        }
    print(json.dumps(found), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=int, default=10_000)
    arguments = parser.parse_args()
    spawn = multiprocessing.get_context("spawn")
    for job in (
        partial(measured, False, ALL // 100),
        partial(measured, False, ALL),
        partial(measured, True, arguments.real),
    ):
        process = spawn.Process(target=job)  # each with a memory of its own
        process.start()
        process.join()


if __name__ == "__main__":
    main()
