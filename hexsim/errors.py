"""One root for every error that is the user's to mend, and how its sentence is made."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

SHOWN = 60  # characters of a value that a sentence repeats


class HexsimError(Exception):
    """A problem with what the user gave: one sentence that says what, where, what is allowed and what to do.

    The command line prints the sentence and ends with exit code 2; no traceback. Control characters of the names and
    values in it appear as their codes.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__("".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in sentence))


class Interrupted(HexsimError):
    """The user ended it: one sentence that says what is kept. The command line's exit code is a shell's, 130."""


def shortened(text: str, length: int = SHOWN) -> str:
    """The text, or its beginning and how long it is."""
    return text if len(text) <= length else f"{text[:length]}... ({len(text)} characters)"


def one_of(given: str, names: Sequence[str]) -> str:
    """ "give one of ...", names that look like the given one first."""
    close = get_close_matches(given[:SHOWN], names)
    asked = f"did you mean {' or '.join(close)}? " if close else ""
    return f"{asked}give one of {', '.join(names)}"


def refuse_missing_file(what: str, given: str) -> None:
    """HexsimError where a name can only be meant as a file that is not there, or is of no kind that is read."""
    path = Path(given)
    if os.path.isfile(path):
        raise HexsimError(f"{shortened(given)} is no {what} file: give a file of another kind, by its ending")
    if path.suffix or len(path.parts) > 1:
        folder = next((parent for parent in path.parents if os.path.isdir(parent)), Path())
        there = "" if folder == path.parent else f" (nor the folder {shortened(str(path.parent))})"
        raise HexsimError(
            f"there is no {what} file {shortened(given, 300)}{there}: check the path, from {shortened(os.getcwd())}"
        )


@contextmanager
def library_errors(sentence: str, *kept: type[BaseException]) -> Iterator[None]:
    """Whatever a library raises on foreign data or a full disk, as HexsimError(f"{sentence}: its first line").

    Rust panics too, which are no Exceptions. `kept` pass through, as do HexsimError and the user's interruption.
    """
    try:
        yield
    except (HexsimError, KeyboardInterrupt, SystemExit, GeneratorExit, *kept):
        raise
    except BaseException as error:
        said = getattr(error, "strerror", None) or next(iter(str(error).splitlines()), "") or type(error).__name__
        raise HexsimError(f"{sentence}: {shortened(said, 200)}") from None
