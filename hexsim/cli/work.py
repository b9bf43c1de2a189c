"""Long work of a command: what it is at and how long it may take, on a terminal or in a pipe, and an end at once by Ctrl-C."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from hexsim.cli.console import doing_of, progress
from hexsim.errors import HexsimError

T = TypeVar("T")


@contextmanager
def doing() -> Iterator[Callable[[str, float], None]]:
    """A callback (what is being done, fraction done): see `progress`."""
    with progress() as bar:
        yield doing_of(bar, lambda: None)


@contextmanager
def made(out: Path) -> Iterator[None]:
    """A folder that is there while something is written into it, and gone afterwards where nothing was."""
    there = out.exists()
    try:
        if not there:
            out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HexsimError(
            f"cannot write the folder {out}: {error.strerror or error}; give --out another place"
        ) from None
    try:
        yield
    finally:
        if not there:
            with suppress(OSError):
                out.rmdir()


def interruptible(
    work: Callable[[], T],
    *,
    look_s: float = 0.1,  # between two looks whether the work is done: so soon a signal is answered
) -> T:
    """What `work` gives, done in a thread: a signal is answered at once, though a compiled simulation computes there."""
    done, result, raised = threading.Event(), [], []

    def run() -> None:
        try:
            result.append(work())
        except BaseException as error:
            raised.append(error)
        finally:
            done.set()

    threading.Thread(target=run, daemon=True, name="hexsim work").start()
    while not done.wait(look_s):
        pass
    if raised:
        raise raised[0]
    return result[0]


def leave(sentence: str) -> None:
    """End the process after an interrupt: threads that still simulate are not waited for."""
    from hexsim.cli.errors import INTERRUPTED, say

    say(sentence)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(INTERRUPTED)
