"""`hexsim sweep`: many runs over parameters, compensators and seeds."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from hexsim.cli import completion, options
from hexsim.cli.console import output, print_json, progress, terminated_like_interrupted
from hexsim.cli.errors import say
from hexsim.errors import HexsimError, Interrupted, shortened

CONNECT_TIMEOUT_S = 10  # a scheduler that is there answers within one


def register(app: typer.Typer) -> None:
    app.command("sweep")(options.flattened(sweep))


def sweep(
    scenario: options.ScenarioName,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Table to write or to go on with: a .parquet file, or a folder of parts."),
    ],
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Values to sweep: valve.overlap_m=0,5e-6,20e-6. Repeat for more.")
    ] = None,
    seeds: Annotated[str, typer.Option(help="Seeds: 0:10 is 0 to 9, or 1,5,7.")] = "0",
    compensators: Annotated[
        str,
        typer.Option(
            "--compensators",
            "-c",
            help="Names separated by commas.",
            autocompletion=completion.several(completion.compensators),
        ),
    ] = "none",
    motion: options.Motion = options.AS_DECLARED,
    full: Annotated[bool, typer.Option("--full", help="Full legs instead of the tendon model.")] = False,
    timestep: options.TimeStep = None,
    draws: Annotated[
        int, typer.Option(min=0, help="Each run on so many machines drawn from [uncertainty]; 0: as declared.")
    ] = 0,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes here; default one a processor.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Dask scheduler, tcp://host:port, to run on a cluster.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed runs of the table again.")] = False,
    json: options.Json = False,
    allow_native: options.AllowNative = False,
) -> None:
    """Run a scenario many times; resumable, a failed run is a row with its error. Run the same command to go on.

    The exit code is 1 where a run failed.
    """
    from hexsim.studies.compare import names_of
    from hexsim.studies.sweep import cases
    from hexsim.studies.sweep import sweep as run_all
    from hexsim.studies.sweep_table import table_at

    with_machine, what = options.prepare(scenario, motion, allow_native=allow_native)
    grid = {key: parse_values(text) for key, text in options.parse_changes(settings).items()}
    grid_cases = cases(
        what,
        with_machine,
        settings=grid,
        seeds=parse_seeds(seeds),
        compensators=names_of(compensators),
        fast=not full,
        timestep=timestep,
        draws=draws,
    )
    counted = {"runs": len(grid_cases), "failed": 0}

    with progress() as bar, terminated_like_interrupted():
        task = bar.add_task("starting", total=len(grid_cases))

        def show(done: int, total: int, failed: int) -> None:
            counted["failed"] = failed
            bar.update(
                task, completed=done, description=f"{done} of {total}" + (f", {failed} failed" if failed else "")
            )

        try:
            with executor_of(scheduler, workers) as (executor, count, check):
                counted["run_now"] = run_all(
                    grid_cases, executor, out, workers=count, progress=show, retry_failed=retry_failed, check=check
                )
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted by the user; finished rows are kept in {table_at(out).kept}, run it again to go on"
            ) from None
    if json:
        print_json({**counted, "table": str(out)})
    else:
        output().print(f"runs    {counted['runs']}, of which {counted['run_now']} now and {counted['failed']} failed")
        output().print(f"table   {out}")
    if counted["failed"]:
        say(
            f"{counted['failed']} of {counted['runs']} runs failed: column error of {out} says why; "
            "run the same command with --retry-failed to try them again"
        )
        raise typer.Exit(1)


def parse_values(text: str) -> list[Any]:
    """Values separated by commas."""
    return [options.parse_value(part.strip()) for part in text.split(",") if part.strip()]


def parse_seeds(text: str) -> Sequence[int]:
    """0:10 or 1,5,7."""
    try:
        if ":" in text:
            first, last = (int(part) for part in text.split(":"))
            found = range(first, last)
        else:
            found = [int(part) for part in text.split(",")]
        if min(found[:1] if isinstance(found, range) else found, default=0) < 0:  # a range begins with its least
            raise ValueError
    except ValueError:
        raise HexsimError(
            f"--seeds {shortened(repr(text))} is neither first:last (0:10) nor a list of whole numbers from 0 on (1,5,7)"
        ) from None
    if not found:  # false for a range that runs backwards
        raise HexsimError(f"--seeds {text!r} holds no seed: the last is not counted, 0:10 is 0 to 9")
    return found


@contextmanager
def executor_of(
    scheduler: str | None,
    workers: int | None,
    *,
    patience_s: float = 60.0,  # a nanny begins a new worker within seconds
) -> Iterator[tuple[Executor, int, Callable[[], None]]]:
    """Processes here, or a Dask cluster; how many workers there are; what raises HexsimError once none is left."""
    if scheduler is None:
        from hexsim.studies.workers import Workers

        count = workers or os.cpu_count() or 1
        pool = Workers(count)
        try:
            yield pool, count, lambda: None
        finally:
            pool.shutdown(cancel_futures=True)
        return
    try:
        from distributed import Client
    except ImportError:
        raise HexsimError("--scheduler needs Dask: install it with `pip install hexsim[cluster]`") from None
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise HexsimError(
            f"no Dask scheduler answers at {scheduler}: {error or 'time out'}; start one with `dask scheduler`"
        ) from None
    with client:
        threads: Any = client.nthreads()
        count = sum(threads.values())
        if not count:
            raise HexsimError(f"the scheduler at {scheduler} has no workers: start some with `dask worker {scheduler}`")
        gone: list[float] = []  # since when there is no worker

        def check() -> None:
            if client.scheduler_info()["workers"]:
                gone.clear()
                return
            gone.append(time.monotonic())
            if gone[-1] - gone[0] > patience_s:
                raise HexsimError(
                    f"no worker is left at {scheduler}; finished rows are kept: start workers with `dask worker {scheduler}` "
                    "and run the same command again to go on"
                )

        yield client.get_executor(pure=False), count, check
