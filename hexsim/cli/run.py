"""`hexsim run`: one scenario on one machine, with its table, files and recording."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import many, options
from hexsim.cli.compare import compare
from hexsim.cli.console import (
    fraction_of,
    output,
    print_json,
    progress,
    step_of,
    stop_when_signalled,
    terminated_like_interrupted,
)
from hexsim.cli.errors import FULL
from hexsim.cli.sweep import sweep
from hexsim.errors import HexsimError, Interrupted
from hexsim.files.formats import LogFormat

if TYPE_CHECKING:
    from hexsim.declaration import Machine
    from hexsim.files.run_folder import RunFolder
    from hexsim.simulation import Run
    from hexsim.simulation.payload_fmu import PayloadFmu
    from hexsim.simulation.stream import Stream


def register(app: typer.Typer) -> None:
    app.command("run")(options.flattened(run))


def run(
    scenario: options.AnyScenario = None,
    motion: options.Motion = options.AS_DECLARED,
    seed: options.Seed = 0,
    compensator: options.CompensatorNames = "none",
    fast: options.Fast = False,
    timestep: options.TimeStep = None,
    out: options.Out = None,
    json: options.Json = False,
    settings: options.Sets = None,
    host: options.Packets = None,
    recording: options.Recording = True,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write figures and report.html.")] = True,
    log_format: Annotated[LogFormat, typer.Option(help="Format of the log file.")] = "parquet",
    mcap: Annotated[bool, typer.Option("--mcap", help="Write run.mcap for Foxglove, PlotJuggler and ROS.")] = False,
    payload: Annotated[
        Path | None, typer.Option(help="An FMU on the platform: takes its motion, gives force and moment.")
    ] = None,
    connect: Annotated[
        list[str] | None, typer.Option(help="Name in the payload's FMU: force_z_N=THEIRS or THEIRS*FACTOR. Repeat.")
    ] = None,
    stream: options.StreamTo = None,
    allow_native: options.AllowNative = False,
) -> None:
    """Run a scenario headless: table of acceleration peaks, log, figures, report and Rerun recording.

    Several compensators or values with commas, as -c none,adaptive or --set valve.overlap_m=0,5e-6: a run for each.
    """
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.recording.config import summary_of

    if scenario is None:
        print_what_there_is()
        raise typer.Exit(2)
    if is_folder(scenario):
        return run_own(Path(scenario), out, json)
    of_one = {"--mcap": mcap, "--payload": payload, "--connect": connect, "--stream": stream, "--no-report": not report}
    if many.is_grid(settings):
        many.refuse({**of_one, "--host": host, "--compensator all": compensator == many.ALL}, "many values")
        return sweep(
            scenario,
            out or many.default_table(scenario),
            settings,
            str(seed),
            compensator,
            motion,
            not fast,
            timestep,
            json=json,
            allow_native=allow_native,
        )
    if many.are_several(compensator):
        many.refuse(of_one, "several compensators")
        names = None if compensator == many.ALL else compensator
        return compare(
            scenario,
            names,
            motion,
            seed,
            fast,
            timestep,
            out,
            json,
            settings,
            host=host,
            recording=recording,
            log_format=log_format,
            allow_native=allow_native,
        )
    with_machine, what = options.prepare(scenario, motion, settings, allow_native=allow_native)
    if connect and not payload:
        raise HexsimError("--connect names the signals of a payload's FMU: give --payload too")
    if mcap:
        from hexsim.recording.mcap import check_library

        check_library()
    looker = options.stream_of(stream)
    with run_folder(out or default_folder(what.name)) as folder, progress() as bar, terminated_like_interrupted():
        from hexsim.scenarios.resources import check_resources
        from hexsim.scenarios.settings import machine_in
        from hexsim.simulation import simulate

        chosen = machine_in(what, with_machine)
        check_resources(chosen, what.duration_s, folder.out.absolute().parent)
        payloads = payload_on(chosen, payload, connect or [], allow_native) if payload else []

        done = simulate(
            with_machine,
            what,
            compensator=compensator,
            fast=fast,
            seed=seed,
            timestep=timestep,
            progress=fraction_of(bar, f"{what.name} on {with_machine.name}"),
            interventions=payloads,
            host=options.host_of(host),
        )
        place = keep(done, folder, step_of(bar), log_format=log_format, recording=recording, report=report, mcap=mcap)
    if json:
        print_json(summary_of(done))
    else:
        print_run(done, place)
    if looker:
        play(done, looker)
    if not done.complete:
        error = Interrupted if done.interrupted else HexsimError
        raise error(f"{done.reason.rstrip('.')}; the log so far is in {place}")


def play(run: Run, stream: Stream) -> None:
    """The log in real time to who looks on, until Ctrl-C."""
    from hexsim.simulation.stream import play_log

    typer.echo("playing the log in real time; Ctrl-C ends it", err=True)
    with contextlib.closing(stream), stop_when_signalled() as stop:
        play_log(run.log, stream, stop.is_set)


def is_folder(scenario: str) -> bool:
    """Whether there is a folder where a scenario is named; a scenario of hexsim's own goes before a folder of its name."""
    from hexsim.scenarios import available_scenarios

    return (
        os.path.isdir(scenario) and scenario not in available_scenarios()
    )  # isdir: no error for a name that no file can have


def run_own(folder: Path, out: Path | None, json: bool) -> None:
    """A folder in the place of a scenario is a machine of one's own, simulated from its recorded inputs."""
    from hexsim.cli.own_machine import run_own_folder
    from hexsim.own.folder import FILES, is_simulated

    if not is_simulated(folder):
        raise HexsimError(
            f"{folder} is a folder: hexsim run takes a scenario, or the folder of a machine of one's own whose {FILES[0]} "
            "declares [states] or [outputs]; hexsim run heave --machine FOLDER runs a machine.toml"
        )
    run_own_folder(folder, out, json)


def payload_on(machine: Machine, path: Path, connections: list[str], allow_native: bool) -> list[PayloadFmu]:
    """The FMU as what acts on the machine."""
    from hexsim.simulation.payload_fmu import PayloadFmu, parse_connections

    has_platform = machine.mechanics.has_platform
    return [PayloadFmu(path, parse_connections(connections), has_platform=has_platform, allow_native=allow_native)]


def keep(run: Run, folder: RunFolder, step, *, log_format: LogFormat, **files: bool) -> Path:
    """Write and place the files of a run (as `write_run`); whatever happens while plotting, what was simulated is kept."""
    from hexsim.recording.run_files import write_run

    try:
        write_run(run, folder.path, log_format=log_format, step=step, **files)
    except (HexsimError, OSError) as error:  # the disk is full, or has gone
        if isinstance(error, OSError) and error.errno not in FULL:
            raise
        whole = salvage(run, folder.path, log_format)
        raise HexsimError(
            f"{error if isinstance(error, HexsimError) else f'cannot write {error.filename}: {error.strerror}'}; "
            f"{', '.join(whole) or 'nothing'} could be kept, in {folder.finish(complete=False)}"
        ) from None
    except KeyboardInterrupt:
        run.complete, run.interrupted = False, True
        run.reason = "interrupted by the user while figures and recording were written"
        write_run(run, folder.path, log_format=log_format, recording=False, report=False)
    except Exception:  # a plot that fails is a bug, and must not cost the run
        write_run(run, folder.path, log_format=log_format, recording=False, report=False)
        folder.finish(run.complete)
        raise
    return folder.finish(run.complete)


def salvage(run: Run, folder: Path, log_format: LogFormat) -> list[str]:
    """Make room by what a plot can be made of again, and write what is still missing; the names of what is whole."""
    import shutil

    from hexsim.recording.run_files import write_essentials

    shutil.rmtree(folder / "figures", ignore_errors=True)
    for name in ("run.rrd", "report.html"):
        (folder / name).unlink(missing_ok=True)
    return write_essentials(run, folder, log_format, only_what_fits=True)


def print_what_there_is() -> None:
    """The three lists that a run is chosen from."""
    from hexsim.cli import lists

    for name in ("scenario", "machine", "compensator"):
        typer.echo(f"{name}s: hexsim run {'SCENARIO' if name == 'scenario' else f'SCENARIO --{name} NAME'}\n")
        lists.show(lists.LISTS[f"{name}s"]())
        typer.echo()


def print_run(run: Run, place: Path) -> None:
    """The table of figures, how it was run, and where its files are."""
    from rich.table import Table
    from rich.text import Text

    from hexsim.recording.signals import Signals
    from hexsim.recording.summary_table import axis_header, axis_rows, facts

    console, summary = output(), run.summary
    title = f"{summary['scenario']} on {summary['machine']}, compensator {summary['compensator']}"
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    header = axis_header(summary)
    for name in header:
        table.add_column(name, justify="left" if name in (header[0], header[-1]) else "right", no_wrap=True)
    driven = Signals.of_run(run).driven_axes if run.log.height > 1 else ()
    for is_driven, cells in axis_rows(summary, driven):
        table.add_row(*cells, style="bold" if is_driven else None)
    console.print(table)
    console.print()
    for name, value in facts(summary, run)[3:]:
        console.print(Text.assemble((f"{name:<17}", "dim"), value))
    for time_s, leg, message in run.messages[:5]:
        console.print(Text.assemble((f"{'message':<17}", "dim"), f"{time_s:.3f} s, leg {leg}: {message}"))
    if len(run.messages) > 5:
        console.print(Text.assemble((" " * 17, "dim"), f"and {len(run.messages) - 5} more, in the report"))
    for warning in (text for text in run.warnings if text != run.reason):
        console.print(Text.assemble((f"{'note':<17}", "yellow"), warning))
    console.print(Text.assemble((f"{'files':<17}", "dim"), str(place)))
    if (place / "run.rrd").exists():
        console.print(Text.assemble((f"{'look at it':<17}", "dim"), f"hexsim view {place}"))
