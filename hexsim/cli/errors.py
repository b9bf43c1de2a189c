"""What goes wrong ends in one sentence on stderr and exit code 2, without a traceback."""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
from itertools import pairwise
from typing import Any

import typer
from typer.core import TyperGroup

from hexsim.errors import HexsimError, Interrupted, shortened

UsageError: Any = typer.BadParameter.__bases__[0]  # click's, which newer versions of Typer hold inside
EXIT_CODE: int = UsageError.exit_code  # of every refusal
INTERRUPTED = 128 + signal.SIGINT  # as a shell gives it
TAG = re.compile(r"(\\*)(\[[a-z#/@][^[]*?\])")  # what Rich takes for markup
MOVED = {
    "machines": "list machines",
    "scenarios": "list scenarios",
    "compensators": "list compensators",
    "effects": "list effects",
    "measure": "test log",
    "valve": "test valve",
    "schema": "export schema",
}
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # the disk, the user's share of it, the largest file allowed


class SentenceGroup(TyperGroup):
    """Turns the user's errors into a sentence; anything else is a bug and keeps its traceback.

    Help texts are text: brackets in them, as in [kg] and [uncertainty], are no markup of Rich's.
    """

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        _escape_help(self)

    def resolve_command(self, ctx: typer.Context, args: list[str]) -> Any:
        """The command. An old name is refused with the new one."""
        if args and args[0] in MOVED:
            raise HexsimError(f"hexsim {args[0]} is now hexsim {MOVED[args[0]]}")
        for before, text in pairwise(["hexsim", *args]):
            if not text or (text.startswith("--") and text.endswith("=") and text.count("=") == 1):
                raise HexsimError(
                    f"after {before} stands {text or 'an empty text'}: a variable of the shell that is not set? "
                    "give a value, or leave the option out"
                )
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: typer.Context) -> Any:
        for stream in (sys.stdout, sys.stderr):  # a locale without a sign shows it as its code
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
        code = EXIT_CODE
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except HexsimError as error:
            say(str(error))
            code = INTERRUPTED if isinstance(error, Interrupted) else EXIT_CODE
        except UsageError as error:
            if "extra argument" in error.message and any(
                word in sys.argv for word in ("--compensators", "-c", "--set")
            ):
                error.message += " Values of one option go together, with commas and without spaces: none,adaptive."
            elif "unable to parse string as a number" in error.message:
                error.message += ": write it without a unit; the help names the unit."
            raise
        except KeyboardInterrupt:
            say("interrupted by the user; nothing was kept")
            code = INTERRUPTED
        except BrokenPipeError:  # the reader of our output went away, as `head` does
            _drop_output()
            raise typer.Exit(0) from None
        except OSError as error:
            if error.errno in FULL:
                _drop_output()
                place = f" {error.filename}" if error.filename else ", nor print"
                say(f"cannot write{place}: {error.strerror}; make room, or give --out another place")
            elif error.filename is not None:  # a name that is too long, a folder that may not be looked into
                say(f"cannot use {shortened(str(error.filename))}: {error.strerror}; give another file or folder")
            else:
                raise
        except BaseException as error:
            if (
                type(error).__name__ != "PanicException"
            ):  # of polars' Rust: no Exception, on a file whose bytes are not right
                raise
            say(f"a file is damaged: {next(iter(str(error).splitlines()), '')}")
        raise typer.Exit(code)


def _escape_help(command: Any) -> None:
    """Each help text of a command, its options and its commands with brackets escaped for Rich."""
    for part in (command, *command.params):
        for name in ("help", "short_help", "epilog"):
            text = getattr(part, name, None)
            if text:
                setattr(part, name, TAG.sub(r"\1\1\\\2", text))
    for other in getattr(command, "commands", {}).values():
        _escape_help(other)


def _drop_output() -> None:
    """What is still to be printed goes nowhere, so that Python does not fail on it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def say(
    sentence: str,
    *,
    most_characters: int = 2000,  # a screenful
) -> None:
    """One line on stderr."""
    typer.echo(f"hexsim: {shortened(' '.join(sentence.split()), most_characters)}", err=True)
