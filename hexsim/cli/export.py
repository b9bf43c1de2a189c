"""`hexsim export`: the machine for other people's tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hexsim.cli import options
from hexsim.cli.console import output, print_json
from hexsim.cli.schema import schema
from hexsim.errors import HexsimError


def register(app: typer.Typer) -> None:
    group = typer.Typer(
        help="For other tools: FMU (Simulink, Amesim, dSPACE), MuJoCo plugin, compensator in C, MCAP (Foxglove, ROS), JSON schema.",
        no_args_is_help=True,
    )
    for command in (fmu, plugin, compensator, mcap, schema):
        group.command()(command)
    app.add_typer(group, name="export")


def fmu(
    machine: options.GivenMachine,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write, MACHINE.fmu.")],
    what: Annotated[
        Literal["plant", "machine"],
        typer.Option(
            help="plant: valve volts in, motion and pressures out; machine: setpoints in, controllers inside."
        ),
    ] = "plant",
    tendon: Annotated[bool, typer.Option("--tendon", help="The tendon model: faster, peaks to 0.7 %.")] = False,
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Version of FMI.")] = 2,
    linux_only: Annotated[bool, typer.Option("--linux-only", help="Leave Windows out.")] = False,
    mujoco_dll: Annotated[
        Path | None, typer.Option(help="mujoco.dll of the installed version; default: fetched by pip, once.")
    ] = None,
    timestep: Annotated[
        float | None, typer.Option(help="Constant time step of the integration (s); default: chosen from the machine.")
    ] = None,
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """FMI co-simulation, Linux and Windows (64 bit): runs without Python. Needs `pip install hexsim[fmu]` for the export."""
    from hexsim.export import export_fmu
    from hexsim.machine import load_machine
    from hexsim.machine.files import changed

    changes = {key: options.parse_value(text) for key, text in options.parse_changes(settings).items()}
    declared = changed(load_machine(machine), changes, source="--set")
    windows, left_out = (None, "") if linux_only else _windows_library(mujoco_dll)
    variables = export_fmu(
        declared,
        out,
        model="tendon" if tendon else "full",
        timestep=timestep,
        fmi=3 if fmi == 3 else 2,
        windows=windows,
        what=what,
    )
    counts = {name: len(getattr(variables, name)) for name in ("inputs", "outputs", "parameters")}
    size, systems = out.stat().st_size, ["linux64", *(["win64"] if windows else [])]
    if json:
        print_json({"fmu": str(out), "what": what, "fmi": fmi, "systems": systems, **counts, "bytes": size})
    else:
        console = output()
        console.print(f"fmu     {out}, {size / 1e6:.1f} MB, FMI {fmi}.0, {' and '.join(systems)}")
        console.print(f"        {', '.join(f'{count} {name}' for name, count in counts.items())}")
    if left_out:
        typer.echo(f"Windows is left out: {left_out}", err=True)


def plugin(
    machine: options.GivenMachine,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write.")],
    timestep: Annotated[float | None, typer.Option(help="Time step of the MJCF (s); default 1e-4.")] = None,
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """MuJoCo plugin of the hydraulic leg, and the machine as an MJCF that uses it: for MuJoCo without hexsim."""
    from hexsim.export.plugin import export_plugin
    from hexsim.machine import load_machine
    from hexsim.machine.files import changed

    changes = {key: options.parse_value(text) for key, text in options.parse_changes(settings).items()}
    written = export_plugin(changed(load_machine(machine), changes, source="--set"), out, timestep)
    if json:
        print_json({"files": {path.name: path.stat().st_size for path in written}})
    else:
        for path in written:
            output().print(f"{path}, {path.stat().st_size / 1e3:.0f} kB")


def compensator(
    name: Annotated[str, typer.Argument(help="Name of the compensator: adaptive.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")],
    target: Annotated[
        Literal["x86_64-linux", "x86_64-windows", "aarch64-linux"], typer.Option(help="Where it will run.")
    ] = "x86_64-linux",
    machine: Annotated[
        str, typer.Option("--machine", "-m", help="Machine whose data sheet the header has as a start.")
    ] = "bench",
    leg: Annotated[int, typer.Option(min=1, max=6, help="Its leg.")] = 1,
    learned: Annotated[
        Path | None, typer.Option(help="learned.json of a run with it: start parameters in the header.")
    ] = None,
    json: options.Json = False,
) -> None:
    """Object file, library, C header, example and documentation for an integrator: no Python, no allocation."""
    from hexsim.export.compensator import export_compensator, learned_of
    from hexsim.hydraulics.resolve import resolve
    from hexsim.machine import load_machine
    from hexsim.motion_computer.data_sheet import compensator_context
    from hexsim.motion_computer.leg_load import ExpectedLoad

    declared = load_machine(machine)
    load = ExpectedLoad.of(resolve(declared))
    context = compensator_context(declared, None, min(leg, declared.n_legs), load)
    written = export_compensator(
        name, target, out, context, None if learned is None else learned_of(name, learned, leg)
    )
    if json:
        print_json(
            {"compensator": name, "target": target, "files": {path.name: path.stat().st_size for path in written}}
        )
    else:
        for path in written:
            output().print(f"{path}, {path.stat().st_size / 1e3:.0f} kB")


def mcap(
    log: Annotated[Path, typer.Argument(help="Folder of a run, or a log (.parquet, .csv, .csv.gz).")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; default: run.mcap in the folder, LOG.mcap.")
    ] = None,
    json: options.Json = False,
) -> None:
    """A log for Foxglove, PlotJuggler and ROS tools: topics of JSON messages with schemas. Needs `pip install hexsim[ros]`."""
    from hexsim.files.log_files import find_log, read_log
    from hexsim.recording.mcap import check_library, config_beside, write_log_as_mcap

    check_library()
    path = find_log(log) if log.is_dir() else log
    table = read_log(path)
    out = out or path.with_name("run.mcap" if log.is_dir() else f"{path.name.split('.')[0]}.mcap")
    if out.suffix != ".mcap":
        raise HexsimError(f"{out}: the name of an MCAP file ends in .mcap")
    write_log_as_mcap(table, out, config_beside(path))
    if json:
        print_json({"mcap": str(out), "rows": table.height, "bytes": out.stat().st_size})
    else:
        output().print(f"{out}, {out.stat().st_size / 1e6:.1f} MB, {table.height} rows of {table.width - 1} signals")


def _windows_library(given: Path | None) -> tuple[bytes | None, str]:
    """MuJoCo for Windows, or why there is none. A file that is given must be one."""
    from hexsim.export.mujoco_library import windows_library

    try:
        return windows_library(given), ""
    except HexsimError as error:
        if given:
            raise
        return None, str(error)
