"""Runs and their comparison, and sweeps over many."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from compensation import Compensator
from hexsim.declaration import Machine as DeclaredMachine
from hexsim.errors import HexsimError
from hexsim.face.given import (
    Machine,
    check_run_options,
    compensator_of,
    faced,
    plain_value,
    prepared,
    settings_of,
    shown,
)
from hexsim.face.show import Picture, chosen, html_table, picture_of
from hexsim.files.formats import LogFormat
from hexsim.files.run_folder import default_folder, run_folder
from hexsim.recording import figures as drawings
from hexsim.recording.report import run_sentence
from hexsim.recording.run_files import MIN_ROWS, write_run
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit
from hexsim.recording.summary_table import axis_header, axis_rows, comparison_rows, facts, number
from hexsim.scenarios import Scenario
from hexsim.simulation import simulation
from hexsim.simulation.hosted import Host
from hexsim.studies import compare as comparisons
from hexsim.studies import sweep as sweeps
from hexsim.studies.workers import Workers

AnyMachine = str | Path | DeclaredMachine
AnyScenario = str | Path | Scenario
AnyCompensator = str | Compensator
KEYS_OF_A_TABLE = ("key", "values_key", "inputs")  # by which an interrupted sweep goes on


class Run:
    """A finished run, or one that ended early: `complete`, `interrupted` (by the user) and `reason` say so.

    log: table with a row a sample and a column a signal, SI units at the end of the names; a measured log has the same
    columns, the truth behind them is the simulation's own.
    figures: axis ("z" .. "yaw", of a bench "leg") -> name with unit -> number, {"z": {"peak_band_m_s2": 0.73, ...}}.
    summary: the figures and all that summary.json holds. learned: what the compensator learned, an entry a leg.
    """

    def __init__(self, run: simulation.Run) -> None:
        self._run = run
        self.log: pl.DataFrame = run.log
        self.summary: dict[str, Any] = run.summary
        self.figures: dict[str, dict[str, Any]] = run.summary["axes"]
        self.machine: Machine = faced(run.machine)
        self.scenario: Scenario = run.scenario
        self.compensator: str = run.compensator
        self.learned: list[dict[str, Any]] = run.compensator_parameters
        self.warnings: list[str] = list(run.warnings)
        self.complete: bool = run.complete
        self.interrupted: bool = run.interrupted
        self.reason: str = run.reason

    def plot(self, what: str = "acceleration") -> Picture:
        """A picture of the run: motion, acceleration, parasitic, flow_curve, pressures, spectrum or points.

        Raises HexsimError for another name, or where the log lacks what it shows.
        """
        signals = _signals({"": self})[""]
        there = {name: lambda make=make: make(signals) for name, make in drawings.makers().items()}
        return picture_of(chosen(what, there), what)

    def to_folder(
        self,
        path: str | Path | None = None,
        *,
        log_format: LogFormat = "parquet",
        recording: bool = True,
        report: bool = True,
    ) -> Path:
        """Write what `hexsim run` writes: log, summary.json, config.toml, figures, report.html, Rerun recording; the folder.

        path: None: `runs/<time>-<scenario>`. Raises HexsimError where it cannot be written.
        """
        with _folder(path, self.scenario.name) as folder:
            write_run(self._run, folder.path, log_format=log_format, recording=recording, report=report)
            return folder.finish(self.complete)

    def __repr__(self) -> str:
        ended = "" if self.complete else f"; ended early: {self.reason}"
        axis = _first_driven(self)
        peak = "" if axis is None else f", peak {_peak(self, axis)} in {AXIS_NAMES[axis]}"
        return f"<Run {_title(self)}, {number(self.summary['duration_s'])} s{peak}{ended}>"

    def _repr_html_(self) -> str:
        driven = _driven(self)
        rows = [cells for _, cells in axis_rows(self.summary, driven)]
        notes = [
            run_sentence(self.summary, driven),
            *(f"{name}: {value}" for name, value in facts(self.summary, self._run)[3:]),
        ]
        return html_table(axis_header(self.summary), rows, _title(self), [*notes, *self.warnings])


def run(
    scenario: AnyScenario,
    machine: AnyMachine | None = None,
    compensator: AnyCompensator = "none",
    set: Mapping[str, Any] | None = None,
    *,
    fast: bool = False,
    seed: int = 0,
    timestep: float | None = None,
    host: Host | str | None = None,
    allow_native: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a scenario on a machine, each a name, a path or an object. machine: None: the scenario's own.

    set: values by dotted key, {"valve.overlap_m": 2e-5} of the machine, {"scenario.duration_s": 8.0} of the scenario.
    fast: tendon model in place of full legs (peak within 0.1 %). seed: of all sensor noise; same seed, same log to the
    bit. timestep: constant [s], None: chosen. host: packets of a host that knows no future, "60,jitter=0.2".
    allow_native: foreign FMUs of the scenario may run. progress: called with the fraction done.
    Raises HexsimError before the run for what cannot be done. A run that diverges or is interrupted comes back with
    `complete` False and its log so far.

    >>> run = hx.run("heave", machine="bench", set={"scenario.duration_s": 4.0})
    >>> run.log["position_m"].len()
    4000
    >>> run.figures["leg"]["fundamental_m_s2"] < 0.05 * (2 * 3.1416 * 0.5) ** 2  # the loop follows late
    True
    """
    check_run_options(seed, timestep)
    with_machine, what = prepared(scenario, machine, set, allow_native)
    done = simulation.simulate(
        with_machine,
        what,
        compensator=compensator_of(compensator),
        fast=fast,
        seed=int(seed),
        timestep=timestep,
        host=_host(host),
        progress=progress,
    )
    return Run(done)


class Comparison(Mapping[str, Run]):
    """Runs of one scenario by the name of their compensator: comparison["adaptive"].log."""

    def __init__(self, runs: Mapping[str, simulation.Run]) -> None:
        self._runs = {name: Run(one) for name, one in runs.items()}

    def __getitem__(self, name: str) -> Run:
        return self._runs[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._runs)

    def __len__(self) -> int:
        return len(self._runs)

    @property
    def figures(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Compensator -> axis -> name with unit -> number."""
        return {name: one.figures for name, one in self.items()}

    @property
    def table(self) -> pl.DataFrame:
        """A row a compensator and driven axis; accelerations in m/s2 or rad/s2 by the axis; ratio: peak over the first's."""
        raw, rows = self._raw(), []
        for axis in _driven(next(iter(self.values()))):
            for row in comparison_rows(raw, axis):
                rows.append({"axis": axis, "compensator": row.pop("name"), **row})
        return pl.DataFrame(rows, infer_schema_length=None)

    def plot(self, axis: str | None = None) -> Picture:
        """Acceleration of a driven axis, a row a compensator; axis: None: the first."""
        signals = _signals(self)
        there = {
            name: lambda name=name: drawings.comparison(signals, name) for name in _driven(next(iter(self.values())))
        }
        what = axis or next(iter(there))
        return picture_of(chosen(what, there), what)

    def to_folder(
        self, path: str | Path | None = None, *, log_format: LogFormat = "parquet", recording: bool = True
    ) -> Path:
        """Write what `hexsim compare` writes: compare.json, config.toml, logs, figures, report.html, recording; the folder."""
        with _folder(path, f"compare-{next(iter(self.values())).scenario.name}") as folder:
            comparisons.write_comparison(self._raw(), folder.path, log_format=log_format, recording=recording)
            return folder.finish(not any(one.interrupted for one in self._raw().values()))

    def _raw(self) -> dict[str, simulation.Run]:
        return {name: one._run for name, one in self.items()}

    def __repr__(self) -> str:
        axis = _first_driven(next(iter(self.values())))
        peaks = ", ".join(f"{name} {'' if axis is None else _peak(one, axis)}".rstrip() for name, one in self.items())
        first = next(iter(self.values()))
        return f"<Comparison of {first.scenario.name} on {first.machine.name}: {peaks}>"

    def _repr_html_(self) -> str:
        head = ("axis", "compensator", "peak 50 Hz", "of first", "peak raw", "bump p-p", "tracking mm", "")
        keys = ("peak_band", "ratio", "peak_raw", "bump_pp", "tracking_mm")
        rows = [
            (row["axis"], row["compensator"], *(number(row[key]) for key in keys), row["note"])
            for row in self.table.iter_rows(named=True)
        ]
        return html_table(head, rows, repr(self)[1:-1])


def compare(
    scenario: AnyScenario,
    compensators: Sequence[AnyCompensator] | None = None,
    machine: AnyMachine | None = None,
    set: Mapping[str, Any] | None = None,
    *,
    fast: bool = False,
    seed: int = 0,
    timestep: float | None = None,
    host: Host | str | None = None,
    allow_native: bool = False,
    progress: Callable[[str, float], None] = lambda name, fraction: None,
) -> Comparison:
    """The same scenario, machine and seed once with each compensator, names or objects; None: all that hexsim has.

    The other arguments as in `hx.run`; progress(name, fraction of that run). Raises HexsimError for an unknown compensator
    before the first run.

    >>> both = hx.compare("heave", ["none", "exact"], machine="bench", set={"scenario.duration_s": 6.0})
    >>> both["exact"].figures["leg"]["peak_band_m_s2"] < both["none"].figures["leg"]["peak_band_m_s2"]
    True
    """
    check_run_options(seed, timestep)
    with_machine, what = prepared(scenario, machine, set, allow_native)
    names = comparisons.names_of(None, with_machine) if compensators is None else compensators
    if isinstance(names, str) or not isinstance(names, Iterable) or not list(names):
        raise HexsimError(f"compensators is {shown(compensators)}: give a list, such as ['none', 'adaptive']")
    checked = [compensator_of(one) for one in names]
    for one in checked:
        simulation.make_compensators(one, with_machine)  # an unknown one is refused before the first run
    done = comparisons.compare(
        with_machine,
        what,
        checked,
        fast=fast,
        seed=int(seed),
        timestep=timestep,
        host=_host(host),
        progress=progress,
    )
    return Comparison(done)


def sweep(
    scenario: AnyScenario,
    grid: Mapping[str, Sequence[Any]] | None = None,
    machine: AnyMachine | None = None,
    set: Mapping[str, Any] | None = None,
    *,
    seeds: Iterable[int] = (0,),
    compensators: Iterable[str] = ("none",),
    draws: int = 0,
    fast: bool = True,
    timestep: float | None = None,
    workers: int = 1,
    out: str | Path | None = None,
    allow_native: bool = False,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
) -> pl.DataFrame:
    """Every combination of the grid's values, seeds and compensators: a row a run, with its settings and figures.

    grid: {"valve.overlap_m": [0.0, 1e-5, 2e-5]}, dotted key -> values. set: values that all runs share. draws: each on so
    many machines within [uncertainty]. Columns: scenario, machine, compensator, seed, a column a setting, complete, error
    (null, or why that run failed), the figures (`leg_peak_band_m_s2`, ...); `.to_pandas()` where pandas is installed.
    workers: processes; 1: this one. A script that asks for more keeps the call below `if __name__ == "__main__":`.
    out: table (.parquet) to keep; the same call goes on with it where it was interrupted. progress(done, total, failed).
    Raises HexsimError for a key or value that is not allowed, before the first run.

    >>> table = hx.sweep("heave", {"valve.overlap_m": [0.0, 2e-5]}, machine="bench", set={"scenario.duration_s": 4.0})
    >>> table.select("valve.overlap_m", "complete").rows()
    [(0.0, True), (2e-05, True)]
    """
    check_run_options(0, timestep)
    with_machine, what = prepared(scenario, machine, set, allow_native)
    values = {key: _values(key, given) for key, given in settings_of(grid or {}, "grid").items()}
    many = {"seeds": _list("seeds", seeds), "compensators": _list("compensators", compensators)}
    for seed in many["seeds"]:
        check_run_options(seed)
    for name, given, least in (("workers", workers, 1), ("draws", draws, 0)):
        if not isinstance(given, int) or isinstance(given, bool) or given < least:
            raise HexsimError(f"{name} is {shown(given)}: give a whole number from {least} on")
    for one in many["compensators"]:
        if not isinstance(one, str):
            raise HexsimError(f"a compensator of a sweep is {shown(one)}: give its name, which is what the table holds")
        simulation.make_compensators(one, with_machine)
    cases = sweeps.cases(
        what,
        with_machine,
        settings=values,
        seeds=[int(seed) for seed in many["seeds"]],
        compensators=many["compensators"],
        fast=fast,
        timestep=timestep,
        draws=draws,
    )
    with tempfile.TemporaryDirectory(prefix="hexsim-sweep-") as made:
        place = Path(out) if out is not None else Path(made) / "sweep.parquet"
        executor = InThisProcess() if workers == 1 else Workers(workers)
        try:
            sweeps.sweep(cases, executor, place, workers=workers, progress=progress)
        finally:
            executor.shutdown(cancel_futures=True)
        files = [place] if place.is_file() else sorted(place.glob("part-*.parquet"))
        table = pl.concat([pl.read_parquet(file) for file in files])
    order = pl.DataFrame({"key": [case.key for case in cases]})
    return order.join(table, on="key", how="left", maintain_order="left").drop(KEYS_OF_A_TABLE)


def _host(given: Any) -> Host | None:
    """A host by its words or as an object."""
    if given is not None and not isinstance(given, str | Host):
        raise HexsimError(f"host is {shown(given)}: give its packets a second and what else it has, '60,jitter=0.2'")
    return Host.parse(given) if isinstance(given, str) else given


class InThisProcess(Executor):
    """Runs at once what is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def _values(key: str, given: Any) -> list[Any]:
    """The values of a key of the grid."""
    if isinstance(given, str | Mapping) or not isinstance(given, Iterable) or not (found := list(given)):
        raise HexsimError(f"grid: {key} is {shown(given)}: give a list of values, such as [0.0, 2e-5]")
    return [plain_value(value) for value in found]


def _list(name: str, given: Any) -> list[Any]:
    """Several of something."""
    if isinstance(given, str) or not isinstance(given, Iterable) or not (found := list(given)):
        raise HexsimError(f"{name} is {shown(given)}: give a list")
    return found


@contextmanager
def _folder(path: str | Path | None, name: str) -> Iterator[Any]:
    """A folder to write a result into, whole or not at all."""
    with run_folder(default_folder(name) if path is None else Path(path)) as folder:
        yield folder


def _signals(runs: Mapping[str, Run]) -> dict[str, Signals]:
    """The signals of runs that are long enough to draw."""
    found = {name: Signals.of_run(one._run, name or None) for name, one in runs.items() if one.log.height >= MIN_ROWS}
    if not found:
        raise HexsimError(f"a picture needs a log of {MIN_ROWS} rows: make the run longer, by scenario.duration_s")
    return found


def _driven(run: Run) -> tuple[str, ...]:
    """Driven axes that the run has figures of."""
    if run.log.height < MIN_ROWS:
        return ()
    return tuple(axis for axis in Signals.of_run(run._run).driven_axes if axis in run.figures)


def _first_driven(run: Run) -> str | None:
    return next(iter(_driven(run)), None)


def _peak(run: Run, axis: str) -> str:
    unit = axis_unit(axis)
    return f"{number(run.figures[axis].get(f'peak_band_{unit}'))} {unit.replace('_s2', '/s2')}"


def _title(run: Run) -> str:
    return f"{run.scenario.name} on {run.machine.name}, compensator {run.compensator}"
