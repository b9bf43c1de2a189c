"""`hexsim friction`: Stribeck friction from a measured log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hexsim.cli import completion, options
from hexsim.cli.console import output, print_json
from hexsim.errors import HexsimError


def register(app: typer.Typer) -> None:
    app.command("friction")(friction)


def friction(
    log: Annotated[
        Path, typer.Argument(help="Log of the machine, or a run's folder; best of the scenario `friction`.")
    ],
    machine: Annotated[
        str | None,
        typer.Option(
            "--machine", "-m", help="Machine; default: the one beside the log.", autocompletion=completion.machines
        ),
    ] = None,
    leg: Annotated[int, typer.Option(min=1, max=6, help="Leg of a hexapod.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for friction.json, friction.png and machine.toml.")
    ] = None,
    mapping: options.Mapping = None,
    json: options.Json = False,
) -> None:
    """Stribeck parameters with errors and the friction-velocity map from a log (report 2.3.3)."""
    from hexsim.files.run_folder import run_folder
    from hexsim.machine import load_machine
    from hexsim.readers import read_log
    from hexsim.tracing.checks.imu import at_origin
    from hexsim.tracing.friction.figure import friction_figure, friction_table
    from hexsim.tracing.friction.identification import identify_friction

    declared = load_machine(machine or beside(log))
    measured = read_log(log, mapping, declared)
    result = identify_friction(at_origin(measured, declared), declared, leg)
    if out is not None:
        from hexsim.files.json_files import write_json
        from hexsim.machine import save_machine
        from hexsim.recording.figure_style import png

        with run_folder(out) as folder:
            write_json(folder.path / "friction.json", result.to_json())
            (folder.path / "friction.png").write_bytes(png(friction_figure(result)))
            save_machine(result.fitted_machine(), folder.path / "machine.toml", machine or beside(log))
            folder.finish()
    if json:
        print_json(result.to_json())
    else:
        console = output()
        console.print(friction_table(result))
        if out is not None:
            console.print(f"files    {out}")


def beside(log: Path) -> Path | str:
    """Where the machine of a log is declared: machine.toml in its folder, or the run's own config.toml."""
    folder = log if log.is_dir() else log.parent
    if not any((folder / name).is_file() for name in ("machine.toml", "config.toml")):
        raise HexsimError(f"there is no machine.toml beside {log}: give --machine with a name, folder or TOML file")
    return folder
