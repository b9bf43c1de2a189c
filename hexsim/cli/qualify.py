"""`hexsim qualify`: the motion tests of the field on a machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hexsim.cli import options
from hexsim.cli.console import fraction_of, output, print_json, progress, terminated_like_interrupted


def register(app: typer.Typer) -> None:
    app.command("qualify")(qualify)


def qualify(
    machine: options.MachineName = None,
    out: options.Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and shorter motions: under a minute.")] = False,
    compensator: Annotated[str, typer.Option("--compensator", "-c", help="Name or package.module:Class.")] = "none",
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """Motion tests of flight simulators on a machine: half-hertz noise, describing function, turn-around and more."""
    from hexsim.files.run_folder import default_folder, run_folder

    with_machine, _ = options.prepare("heave", options.Motion(machine=machine), settings)
    with (
        run_folder(out or default_folder(f"qualify-{with_machine.name}")) as folder,
        progress() as bar,
        terminated_like_interrupted(),
    ):
        from hexsim.qualify import qualify as run

        report = fraction_of(bar, f"qualifying {with_machine.name}")
        result = run(with_machine, folder.path, quick, report, compensator)
        place = folder.finish()
    if json:
        print_json(result)
    else:
        print_qualification(result, place)


def print_qualification(result: dict[str, Any], place: Path) -> None:
    """Every row that has a limit, then how many were reported without one."""
    from rich.table import Table

    from hexsim.recording.summary_table import number

    console = output()
    title = (
        f"{result['machine']}, compensator {result['compensator']}: {'passed' if result['passed'] else 'NOT passed'}"
    )
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(("test", "axis", "figure", "value", "limit", "unit", "")):
        table.add_column(name, justify="right" if index in (3, 4) else "left")
    judged = [row for row in result["rows"] if row["passed"] is not None]
    for row in judged:
        style = None if row["passed"] else "red"
        cells = (row["test"], row["axis"], row["figure"], number(row["value"]), number(row["limit"]), row["unit"])
        table.add_row(*cells, "pass" if row["passed"] else "fail", style=style)
    console.print(table)
    console.print()
    console.print(f"{len(result['rows']) - len(judged)} more figures without a limit are in the report")
    console.print(f"files    {place}")
