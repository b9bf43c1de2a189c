"""`hexsim tune-loop`: a controller for a machine, with what the loop does before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from hexsim.cli import options
from hexsim.cli.console import fraction_of, output, print_json, progress, terminated_like_interrupted, text_table

if TYPE_CHECKING:
    from hexsim.studies.tune_loop import Tuning


def register(app: typer.Typer) -> None:
    app.command("tune-loop")(tune_loop)


def tune_loop(
    machine: options.GivenMachine,
    out: options.Out = None,
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """Tune the controller: feed-forward, gain, pressure feedback; margins and bandwidth before and after, a new machine file."""
    from hexsim.files.run_folder import default_folder, run_folder

    declared, _ = options.prepare("heave", options.Motion(machine=machine), settings)
    with (
        run_folder(out or default_folder(f"tune-loop-{declared.name}")) as folder,
        progress() as bar,
        terminated_like_interrupted(),
    ):
        from hexsim.studies.tune_loop import tune
        from hexsim.studies.tune_report import figures_json, write_tuning

        tuning = tune(declared, fraction_of(bar, f"tuning {declared.name}"))
        write_tuning(tuning, folder.path, machine)
        place = folder.finish()
    if json:
        print_json(figures_json(tuning))
        return
    _print(tuning)
    output().print(f"files    {place}: machine.toml has the new [controller]")


def _print(tuning: Tuning) -> None:
    """Margins of the linear model, then the measured response of every axis, before and after."""
    from hexsim.motion_computer.margins import stability_sentence
    from hexsim.studies.tune_report import tables

    for title, header, rows in tables(tuning):
        output().print(text_table(title, header, rows))
        output().print()
    for name, figures in zip(("before", "after"), tuning.margins, strict=True):
        if sentence := stability_sentence(figures):
            output().print(f"{name}: {sentence}")
