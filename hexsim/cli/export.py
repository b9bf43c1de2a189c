"""`hexsim export`: the machine for other people's tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hexsim.cli import options
from hexsim.cli.console import output, print_json


def register(app: typer.Typer) -> None:
    group = typer.Typer(
        help="The machine for other tools: Simulink, Amesim, dSPACE and the like.", no_args_is_help=True
    )
    group.command("fmu")(fmu)
    app.add_typer(group, name="export")


def fmu(
    machine: Annotated[str, typer.Argument(help="Name, folder or TOML file of a machine.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write, MACHINE.fmu.")],
    what: Annotated[Literal["plant"], typer.Option(help="plant: valve volts in, motion and pressures out.")] = "plant",
    tendon: Annotated[
        bool, typer.Option("--tendon", help="The tendon equal of the legs: faster, peaks to 0.1 %.")
    ] = False,
    timestep: Annotated[float, typer.Option(help="Time step of the integration (s), constant.")] = 1e-4,
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """FMI 2.0 co-simulation, Linux (64 bit): runs without Python. Needs `pip install hexsim[fmu]` for the export."""
    from hexsim.export import export_fmu
    from hexsim.machine import load_machine
    from hexsim.machine.files import changed

    changes = {key: options.parse_value(text) for key, text in options.parse_changes(settings).items()}
    declared = changed(load_machine(machine), changes, source="--set")
    variables = export_fmu(declared, out, model="tendon" if tendon else "full", timestep=timestep)
    counts = {name: len(getattr(variables, name)) for name in ("inputs", "outputs", "parameters")}
    size = out.stat().st_size
    if json:
        print_json({"fmu": str(out), "what": what, **counts, "bytes": size})
    else:
        console = output()
        console.print(f"fmu     {out}, {size / 1e6:.1f} MB")
        console.print(f"        {', '.join(f'{count} {name}' for name, count in counts.items())}")
