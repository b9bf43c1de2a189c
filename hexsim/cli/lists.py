"""`hexsim list`: machines, scenarios, compensators and effects by their names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import typer

from hexsim.cli import options
from hexsim.cli.console import output, print_json

Rows = list[tuple[str, ...]]  # the header first


def register(app: typer.Typer) -> None:
    app.command("list")(list_names)


def list_names(
    what: Annotated[
        Literal["machines", "scenarios", "compensators", "effects"] | None,
        typer.Argument(help="One of them; default all."),
    ] = None,
    json: options.Json = False,
) -> None:
    """Names of machines, scenarios, compensators and effects. Your own: a file, or package.module:Class."""
    found = {name: LISTS[name]() for name in ([what] if what else LISTS)}
    if json:
        tables = {
            name: [dict(zip(header, row, strict=True)) for row in rows] for name, (header, *rows) in found.items()
        }
        return print_json(tables[what] if what else tables)
    for name, rows in found.items():
        if not what:
            output().print(f"\n{name}")
        show(rows)


def show(rows: Rows) -> None:
    """A table, its first column in bold."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(rows[0]):
        table.add_column(name, no_wrap=index == 0, style="bold" if index == 0 else None)
    for row in rows[1:]:
        table.add_row(*row)
    output().print(table)


def machines() -> Rows:
    """Machines that travel with hexsim."""
    from hexsim.machine import available_machines, load_machine

    rows: Rows = [("name", "kind", "load", "stroke")]
    for name in available_machines():
        machine = load_machine(name)
        mass = machine.load.platform_mass_kg or machine.load.moving_mass_kg
        rows.append((name, machine.machine.kind, f"{mass:g} kg", f"{machine.cylinder.stroke_m:g} m"))
    return rows


def scenarios() -> Rows:
    """Scenarios that travel with hexsim."""
    from hexsim.scenarios import available_scenarios, load_scenario

    found = [load_scenario(name) for name in available_scenarios()]
    rows = [(s.name, s.description, f"{s.duration_s:g} s", s.machine_name) for s in found]
    return [("name", "what it asks", "duration", "machine"), *rows]


def compensators() -> Rows:
    """Compensators by name; your own is package.module:Class."""
    import compensation

    return [("name", "what it is"), *((name, _first_sentence(name)) for name in compensation.available())]


def _first_sentence(name: str) -> str:
    import compensation

    try:
        made = compensation.create(name)
    except (ValueError, TypeError) as error:
        return str(error)
    return made.description


def effects() -> Rows:
    """Effects that a machine file can switch on and tracing can find."""
    from hexsim.hydraulics.effects import library

    rows = [
        (effect.name, effect.balance, effect.description, ", ".join(parameter.name for parameter in effect.parameters))
        for effect in library().values()
    ]
    return [("name", "balance", "what it is", "parameters"), *rows]


LISTS: dict[str, Callable[[], Rows]] = {
    "machines": machines,
    "scenarios": scenarios,
    "compensators": compensators,
    "effects": effects,
}
