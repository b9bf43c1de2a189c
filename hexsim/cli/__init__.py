"""The command line. Each command is one file; heavy libraries are loaded by the command that needs them."""

from __future__ import annotations

import atexit
import gc
import os
import sys

import typer

from hexsim import __version__
from hexsim.cli import (
    compare,
    demo,
    export,
    friction,
    identify,
    lists,
    live,
    map_log,
    qualify,
    run,
    serve,
    sweep,
    trace,
    tune,
    tune_loop,
    view,
)
from hexsim.cli.errors import SentenceGroup

app = typer.Typer(
    name="hexsim",
    cls=SentenceGroup,
    help="Hydraulic six-DOF motion systems: run, compare compensators, trace measured data to missing effects.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    run,
    compare,
    sweep,
    live,
    serve,
    view,
    demo,
    map_log,
    trace,
    identify,
    friction,
    tune,
    tune_loop,
    qualify,
    export,
    lists,
):
    command.register(app)


def _tell_version(asked: bool) -> None:
    if asked:
        typer.echo(f"hexsim {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: bool = typer.Option(
        False, "--version", callback=_tell_version, is_eager=True, help="Print the version and exit."
    ),
) -> None:
    """Options before the command."""


def main() -> None:
    """Entry point of the `hexsim` command."""
    for name in ("stdout", "stderr"):  # closed (`>&-`), or a program without a console
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    # libraries make a million objects that stay: at Python's threshold of 700 looking through them takes a tenth of a run
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)  # nor once more at the end of the process, a fifth of a second
    app()
