"""Many runs: parameters x seeds x compensators, on any `concurrent.futures.Executor`, into a Parquet table.

The same code runs in processes here (`workers`) and on a Dask cluster (`Client.get_executor()`). A case is plain data,
so it travels; its key is a hash of the bytes of everything that decides its result. Each finished row goes at once to a
journal (one line with a checksum, synced), so a sweep that is killed goes on where it was: no row is lost, none is run
twice. A run that fails, or that ends its process, is a row with its error. A table in parts keeps keys and one part in
memory (`sweep_table`).
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hexsim import __version__
from hexsim.errors import HexsimError
from hexsim.files.json_files import plain
from hexsim.machine import Machine, machine_from_dict
from hexsim.machine.files import machine_tables
from hexsim.scenarios import Scenario, scenario_from_dict
from hexsim.scenarios.settings import apply_settings, loaded
from hexsim.simulation import simulate
from hexsim.studies.inputs import inputs_digest
from hexsim.studies.journal import Journal
from hexsim.studies.uncertainty import drawn

_ONE_A_PROCESS = threading.Lock()  # MuJoCo's callbacks are global: threads of a worker take turns
CHECK_EVERY_s = 5.0  # how often a sweep that waits looks after its workers
LOST_WORKER = "WorkerDied: the worker that ran it died, each time"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run as plain data. settings: dotted key -> value, as `hexsim run --set` takes them.

    draw: number of a machine within [uncertainty] (`studies.uncertainty`), whose settings come before these.
    inputs: digest of the files and the code that decide it (`inputs`). allow_native: foreign FMUs of the scenario may run.
    """

    scenario: dict[str, Any]
    machine: dict[str, Any]
    compensator: str = "none"
    seed: int = 0
    fast: bool = True
    timestep: float | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    draw: int | None = None
    inputs: str = ""
    allow_native: bool = False

    @property
    def key(self) -> str:
        """The same for the same case and the same bytes of its inputs, on every machine."""
        return self._hash(self.inputs)

    @property
    def values_key(self) -> str:
        """The same for the same declared values, whatever is in the files that they name."""
        return self._hash("")

    def _hash(self, inputs: str) -> str:
        values = {
            name: value
            for name, value in vars(self).items()
            if name not in ("inputs", "allow_native") and (name, value) != ("draw", None)
        }
        text = json.dumps({**values, "inputs": inputs, "hexsim": __version__}, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    def settings_on(self, machine: Machine) -> dict[str, Any]:
        """All settings, those of the drawn machine too."""
        return self.settings if self.draw is None else drawn(machine, self.draw) | self.settings


def cases(
    scenario: Scenario | str | Path,
    machine: Machine | str | Path,
    *,
    settings: Mapping[str, Sequence[Any]] | None = None,
    seeds: Iterable[int] = (0,),
    compensators: Iterable[str] = ("none",),
    fast: bool = True,
    timestep: float | None = None,
    draws: int = 0,
    most_cases: int = 100_000,  # each is held in memory, without its row
) -> list[Case]:
    """The product of all settings, compensators and seeds. Raises HexsimError where a setting is refused.

    draws: every point of the grid on so many machines within [uncertainty] (`studies.uncertainty`), the same for all.
    """
    machine, scenario = loaded(machine, scenario)
    settings, seeds, compensators = dict(settings or {}), _sequence(seeds), _sequence(compensators)
    built = range(draws) if draws else (None,)
    count = math.prod(len(values) for values in (*settings.values(), seeds, compensators, built))
    if count > most_cases:
        raise HexsimError(f"a sweep of {count} runs: give at most {most_cases}, fewer seeds or values")
    grid = [dict(zip(settings, values, strict=True)) for values in itertools.product(*settings.values())]
    for point in grid:  # refuse what cannot be before the first run
        apply_settings(scenario, machine, (drawn(machine, 0) if draws else {}) | point, "sweep")
    tables = {"scenario": scenario.to_dict(), "machine": machine_tables(machine)}
    inputs = [{one: inputs_digest(tables["scenario"], point, one) for one in compensators} for point in grid]
    allow_native = scenario.allow_native
    return [
        Case(
            **tables,
            compensator=compensator,
            seed=seed,
            fast=fast,
            timestep=timestep,
            settings=point,
            draw=draw,
            inputs=digests[compensator],
            allow_native=allow_native,
        )
        for draw, (point, digests), compensator, seed in itertools.product(
            built, zip(grid, inputs, strict=True), compensators, seeds
        )
    ]


def _sequence(values: Iterable[Any]) -> Sequence[Any]:
    return values if isinstance(values, Sequence) else list(values)


def run_case(case: Case) -> dict[str, Any]:
    """One row: what was run, its figures, or its error. Runs in a worker; never raises but for an interruption."""
    row = _begun(case)
    started = time.perf_counter()
    try:
        machine = machine_from_dict(case.machine, "sweep")
        settings = case.settings_on(machine)
        row |= {
            name: value if isinstance(value, (int, float, str, bool)) else str(value)
            for name, value in settings.items()
        }
        row |= _figures(case, machine, settings)
        if inputs_digest(case.scenario, case.settings, case.compensator) != case.inputs:
            raise HexsimError("its files or code are others than when the sweep began: run the sweep again")
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever it is, sys.exit too, the sweep goes on and the row says it
        row |= {"complete": False, "error": f"{type(error).__name__}: {error}"}
    return {**row, "wall_s": time.perf_counter() - started}


def _begun(case: Case) -> dict[str, Any]:
    """What is known of a run before it is made."""
    return {
        "key": case.key,
        "values_key": case.values_key,
        "inputs": case.inputs,
        "scenario": case.scenario.get("name", ""),
        "machine": case.machine.get("machine", {}).get("name", ""),
        "compensator": case.compensator,
        "seed": case.seed,
    }


def _figures(case: Case, machine: Machine, settings: dict[str, Any]) -> dict[str, Any]:
    """Simulate, and flatten the summary: z_peak_band_m_s2 and so on."""

    scenario = scenario_from_dict(case.scenario, "sweep", allow_native=case.allow_native)
    scenario, machine = apply_settings(scenario, machine, settings, "sweep")
    with _ONE_A_PROCESS, _interruptible():
        run = simulate(
            machine,
            scenario,
            compensator=case.compensator,
            fast=case.fast,
            seed=case.seed,
            timestep=case.timestep,
            figures_only=True,
        )
    if run.interrupted:
        raise KeyboardInterrupt
    figures = {
        f"{axis}_{name}": value for axis, values in run.summary["axes"].items() for name, value in values.items()
    }
    tracking = {f"tracking_rms_{leg}_m": value for leg, value in enumerate(run.summary["tracking_rms_m"], start=1)}
    rest = {"duration_s": run.summary["duration_s"], "realtime_factor": run.realtime_factor}
    return plain(
        {"complete": run.complete, "error": run.reason or None, **figures, **tracking, **rest}, none_for_nan=True
    )


@contextmanager
def _interruptible() -> Iterator[None]:
    """Where a pool's worker ignores Ctrl-C, a run in it does not: the run ends, the worker lives on."""
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    ):
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def sweep(
    grid_cases: Sequence[Case],
    executor: Executor,
    out: Path,
    *,
    workers: int = 1,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    retry_failed: bool = False,
    check: Callable[[], None] = lambda: None,
    in_flight: int = 4,  # cases handed out a worker: enough to keep it busy, few enough to forget on a kill
) -> int:
    """Run what is not there yet, write the table, and return how many were run. progress(done, total, failed).

    Rows of an earlier sweep in the same table stay, but for those of the same cases whose files or code have changed
    since. retry_failed: run failed cases again. check: raises HexsimError where no worker is left; called while waiting.
    Raises HexsimError when the executor is lost, with the rows kept.
    """
    by_key = {case.key: case for case in grid_cases}
    with Journal(Path(out)) as journal:
        there = {key: failed for key, failed in journal.failed.items() if not (failed and retry_failed)}
        missing = [case for key, case in by_key.items() if key not in there]
        done, failed = len(by_key) - len(missing), sum(there.get(key, False) for key in by_key)
        progress(done, len(by_key), failed)
        waiting, running = iter(missing), {}
        suspects: list[Case] = []  # one of them ended a worker that had several
        try:
            while True:
                for case in itertools.islice(waiting, in_flight * workers - len(running)):
                    running[executor.submit(run_case, case)] = case
                if not running and suspects:  # alone: who ends a worker now is the one
                    case = suspects.pop()
                    running[executor.submit(run_case, case)] = case
                    alone = True
                else:
                    alone = False
                if not running:
                    break
                finished: set[Future[dict[str, Any]]] = set()
                while not finished:
                    finished, _ = wait(running, timeout=CHECK_EVERY_s, return_when=FIRST_COMPLETED)
                    try:
                        check()
                    except HexsimError:
                        if alone:  # the next call must get past it
                            journal.add(_lost(next(iter(running.values())), LOST_WORKER))
                            running.clear()
                        raise
                for future in sorted(finished, key=_failed):  # what is there is kept before a loss ends the sweep
                    case = running.pop(future)
                    row = _row_of(future, case)
                    if row is None and not alone:
                        suspects.append(case)
                        continue
                    journal.add(row or _lost(case, LOST_WORKER))
                    done, failed = done + 1, failed + journal.failed[case.key]
                    progress(done, len(by_key), failed)
        except (BrokenExecutor, CancelledError) as error:  # workers killed; a Dask scheduler that went away
            raise HexsimError(
                f"the workers died ({str(error) or 'lost'}); {journal.status()}; run the same command again to go on"
            ) from None
        finally:
            for future in running:
                if not future.cancel() and future.done() and not _failed(future):
                    journal.add(future.result() | {"error": future.result().get("error")})
        journal.finish({key: case.values_key for key, case in by_key.items()})
    return len(missing)


def _failed(future: Future[dict[str, Any]]) -> bool:
    return future.cancelled() or future.exception() is not None


def _row_of(future: Future[dict[str, Any]], case: Case) -> dict[str, Any] | None:
    """The row of a finished run, with its error or None; None where Dask lost the worker that had it among others."""
    try:
        return {"error": None, **future.result()}
    except (KeyboardInterrupt, BrokenExecutor, CancelledError):
        raise
    except Exception as error:
        return None if type(error).__name__ == "KilledWorker" else _lost(case, f"{type(error).__name__}: {error}")


def _lost(case: Case, error: str) -> dict[str, Any]:
    """The row of a run that gave none."""
    return {**_begun(case), "complete": False, "error": error}
