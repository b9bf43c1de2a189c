"""`hexsim machines`, `scenarios`, `compensators`, `effects`: what there is."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from hexsim.cli import options
from hexsim.cli.console import output, print_json


def register(app: typer.Typer) -> None:
    for command in (machines, scenarios, compensators, effects):
        app.command()(command)


def _show(header: Sequence[str], rows: Sequence[Sequence[str]], json: bool) -> None:
    if json:
        print_json([dict(zip(header, row, strict=True)) for row in rows])
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(header):
        table.add_column(name, no_wrap=index == 0, style="bold" if index == 0 else None)
    for row in rows:
        table.add_row(*row)
    output().print(table)


def machines(json: options.Json = False) -> None:
    """Machines that travel with hexsim."""
    from hexsim.machine import available_machines, load_machine

    rows = []
    for name in available_machines():
        machine = load_machine(name)
        mass = machine.load.platform_mass_kg or machine.load.moving_mass_kg
        rows.append((name, machine.machine.kind, f"{mass:g} kg", f"{machine.cylinder.stroke_m:g} m"))
    _show(("name", "kind", "load", "stroke"), rows, json)


def scenarios(json: options.Json = False) -> None:
    """Scenarios that travel with hexsim."""
    from hexsim.scenarios import available_scenarios, load_scenario

    found = [load_scenario(name) for name in available_scenarios()]
    rows = [(s.name, s.description, f"{s.duration_s:g} s", s.machine_name) for s in found]
    _show(("name", "what it asks", "duration", "machine"), rows, json)


def compensators(json: options.Json = False) -> None:
    """Compensators by name; your own is package.module:Class."""
    import compensation

    _show(("name", "what it is"), [(name, _first_sentence(name)) for name in compensation.available()], json)


def _first_sentence(name: str) -> str:
    import compensation

    try:
        made = compensation.create(name)
    except (ValueError, TypeError) as error:
        return str(error)
    return made.description


def effects(json: options.Json = False) -> None:
    """Effects that a machine file can switch on and tracing can find."""
    from hexsim.hydraulics.effects import library

    rows = [
        (effect.name, effect.balance, effect.description, ", ".join(parameter.name for parameter in effect.parameters))
        for effect in library().values()
    ]
    _show(("name", "balance", "what it is", "parameters"), rows, json)
