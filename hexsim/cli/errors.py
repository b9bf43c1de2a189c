"""What goes wrong ends in one sentence on stderr and exit code 2, without a traceback."""

from __future__ import annotations

import os
import sys
from typing import Any

import typer
from typer.core import TyperGroup

from hexsim.errors import HexsimError

EXIT_CODE = 2


class SentenceGroup(TyperGroup):
    """Turns the user's errors into a sentence; anything else is a bug and keeps its traceback."""

    def invoke(self, ctx: typer.Context) -> Any:
        try:
            return super().invoke(ctx)
        except HexsimError as error:
            say(str(error))
        except KeyboardInterrupt:
            say("interrupted by the user; nothing was kept")
        except BrokenPipeError:  # the reader of our output went away, as `head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        raise typer.Exit(EXIT_CODE)


def say(sentence: str) -> None:
    """One line on stderr."""
    typer.echo(f"hexsim: {' '.join(sentence.split())}", err=True)
