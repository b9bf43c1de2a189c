"""`hexsim run` with several compensators, and `hexsim compare`: side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import completion, options
from hexsim.cli.console import output, print_json, progress, step_of, terminated_like_interrupted, text_table
from hexsim.cli.errors import FULL
from hexsim.errors import HexsimError, Interrupted
from hexsim.files.formats import LogFormat

if TYPE_CHECKING:
    from hexsim.simulation import Run


def register(app: typer.Typer) -> None:
    app.command("compare", hidden=True)(options.flattened(compare))


def compare(
    scenario: options.ScenarioName,
    compensators: Annotated[
        str | None,
        typer.Option(
            "--compensators",
            "-c",
            help="Names separated by commas; default all there are.",
            autocompletion=completion.several(completion.compensators),
        ),
    ] = None,
    motion: options.Motion = options.AS_DECLARED,
    seed: options.Seed = 0,
    fast: options.Fast = False,
    timestep: options.TimeStep = None,
    out: options.Out = None,
    json: options.Json = False,
    settings: options.Set = None,
    host: options.Packets = None,
    recording: options.Recording = True,
    log_format: Annotated[LogFormat, typer.Option(help="Format of the log files.")] = "parquet",
    allow_native: options.AllowNative = False,
) -> None:
    """Run a scenario with several compensators: table, figure, report, compare.json, one recording."""
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.scenarios.resources import check_resources
    from hexsim.scenarios.settings import machine_in
    from hexsim.studies.compare import compare as run_all
    from hexsim.studies.compare import comparison_tables, names_of, write_comparison

    with_machine, what = options.prepare(scenario, motion, settings, allow_native=allow_native)
    names = names_of(compensators, with_machine)
    with run_folder(out or default_folder(f"compare-{what.name}")) as folder, progress() as bar:
        check_resources(machine_in(what, with_machine), len(names) * what.duration_s, folder.out.absolute().parent)
        tasks = {name: bar.add_task(name, total=1.0) for name in names}
        with terminated_like_interrupted():
            runs = run_all(
                with_machine,
                what,
                names,
                fast=fast,
                seed=seed,
                timestep=timestep,
                host=options.host_of(host),
                progress=lambda name, fraction: bar.update(tasks[name], completed=fraction),
            )
            try:
                write_comparison(runs, folder.path, log_format=log_format, recording=recording, step=step_of(bar))
            except (HexsimError, OSError) as error:
                if isinstance(error, OSError) and error.errno not in FULL:
                    raise
                raise HexsimError(f"{error}; what could be kept is in {folder.finish(complete=False)}") from None
        ended = next((run for run in runs.values() if run.interrupted), None)
        place = folder.finish(complete=ended is None)
    if json:
        print_json(comparison_tables(runs))
    else:
        print_comparison(runs, str(place))
    if ended is not None:
        raise Interrupted(f"{ended.reason} with {ended.compensator}; what was done is in {place}")


def print_comparison(runs: Mapping[str, Run], place: str) -> None:
    """One table a driven axis; the lowest peak in green."""
    from rich.table import Table

    from hexsim.recording.felt import felt_of
    from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit
    from hexsim.recording.summary_table import comparison_rows, number

    console, first = output(), next(iter(runs.values()))
    people = felt_of(runs)
    for axis in [name for name in Signals.of_run(first).driven_axes if name in first.summary["axes"]]:
        unit = axis_unit(axis).replace("_s2", "/s²")
        title = f"{first.scenario.name} on {first.machine.name}: {AXIS_NAMES[axis]} [{unit}]"
        table = Table(
            title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim"
        )
        table.add_column("compensator", no_wrap=True)
        for head in ("peak 50 Hz", "of first", "peak raw", "bump p-p", "noise rms", "fundamental", "tracking mm"):
            table.add_column(head, justify="right", no_wrap=True)
        rows = comparison_rows(runs, axis)
        best = min((row["peak_band"] for row in rows if row["peak_band"] is not None and not row["note"]), default=None)
        for row in rows:
            keys = ("peak_band", "ratio", "peak_raw", "bump_pp", "noise_rms", "fundamental", "tracking_mm")
            style = "green" if best is not None and row["peak_band"] == best else None
            table.add_row(row["name"], *(number(row[key]) for key in keys), style=style)
        console.print(table)
        console.print()
        _print_felt(people, axis)
    for name, run in runs.items():
        if not run.complete:
            console.print(f"{name}: {run.reason}", style="yellow")
    for warning in sorted({text for run in runs.values() for text in run.warnings if text != run.reason}):
        console.print(f"note    {warning}")
    console.print(f"files   {place}")


def _print_felt(people: Mapping[str, Mapping[str, Mapping[str, float | None]]], axis: str) -> None:
    """What a person feels along an axis, a row a compensator."""
    from hexsim.recording.felt import FELT_HEADS, felt_cells

    rows = [(name, *felt_cells(axes[axis])) for name, axes in people.items() if axis in axes]
    if rows:
        output().print(text_table("what a person feels", ("compensator", *FELT_HEADS), rows))
        output().print()
