"""`hexsim sweep`: many runs over parameters, compensators and seeds."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from hexsim.cli import completion, options
from hexsim.cli.console import output, print_json, progress, terminated_like_interrupted
from hexsim.errors import HexsimError, shortened

CONNECT_TIMEOUT_S = 10


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
    json: options.Json = False,
) -> None:
    """Run a scenario many times; resumable, a failed run is a row with its error. Run the same command to go on."""
    from hexsim.studies.compare import names_of
    from hexsim.studies.sweep import cases
    from hexsim.studies.sweep import sweep as run_all
    from hexsim.studies.sweep_table import table_at

    with_machine, what = options.prepare(scenario, motion)
    grid = {key: parse_values(text) for key, text in options.parse_changes(settings).items()}
    grid_cases = cases(
        what, with_machine, settings=grid, seeds=parse_seeds(seeds), compensators=names_of(compensators), fast=not full,
        timestep=timestep, draws=draws,
    )  # fmt: skip
    counted = {"runs": len(grid_cases), "failed": 0}

    with progress() as bar, terminated_like_interrupted():
        task = bar.add_task("starting", total=len(grid_cases))

        def show(done: int, total: int, failed: int) -> None:
            counted["failed"] = failed
            bar.update(
                task, completed=done, description=f"{done} of {total}" + (f", {failed} failed" if failed else "")
            )

        try:
            with executor_of(scheduler, workers) as (executor, count):
                counted["run_now"] = run_all(grid_cases, executor, out, workers=count, progress=show)
        except KeyboardInterrupt:
            raise HexsimError(
                f"interrupted by the user; finished rows are kept in {table_at(out).kept}, run it again to go on"
            ) from None
    if json:
        return print_json({**counted, "table": str(out)})
    output().print(f"runs    {counted['runs']}, of which {counted['run_now']} now and {counted['failed']} failed")
    output().print(f"table   {out}")


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
        if min(found, default=0) < 0:
            raise ValueError
    except ValueError:
        raise HexsimError(
            f"--seeds {shortened(repr(text))} is neither first:last (0:10) nor a list of whole numbers from 0 on (1,5,7)"
        ) from None
    if not found:  # false for a range that runs backwards
        raise HexsimError(f"--seeds {text!r} holds no seed: the last is not counted, 0:10 is 0 to 9")
    return found


@contextmanager
def executor_of(scheduler: str | None, workers: int | None) -> Iterator[tuple[Executor, int]]:
    """Processes here, or a Dask cluster; and how many workers there are."""
    if scheduler is None:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        count = workers or os.cpu_count() or 1
        pool = ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"), initializer=one_thread)
        try:
            yield pool, count
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
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
        yield client.get_executor(pure=False), count


def one_thread() -> None:
    """A worker is one of many: it takes one processor, leaves Ctrl-C to the process that started it, and ends with it."""
    import multiprocessing
    import signal
    import threading
    from multiprocessing.connection import wait

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
