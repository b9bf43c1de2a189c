"""`hexsim test valve`: the declared valve as a test stand would draw it."""

from __future__ import annotations

from hexsim.cli import options
from hexsim.cli.console import output, print_json


def valve(
    machine: options.GivenMachine,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """The declared valve as ISO 10770 would test it: flow, pressure gain, leakage, step and frequency response."""
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.machine import load_machine
    from hexsim.studies.valve_report import write_valve_report
    from hexsim.studies.valve_test import valve_test

    declared = load_machine(machine)
    with run_folder(out or default_folder(f"valve-{declared.name}")) as folder:
        test = valve_test(declared)
        write_valve_report(test, declared, folder.path)
        place = folder.finish()
    if json:
        print_json(test.figures)
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("figure", "value", "unit"):
        table.add_column(name, justify="right" if name == "value" else "left")
    for figure in test.table():
        table.add_row(*figure)
    output().print(table)
    output().print(f"files    {place}")
