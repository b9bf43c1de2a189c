"""Long work of a command: what it is at and how long it may take, on a terminal or in a pipe, and an end at once by Ctrl-C."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from hexsim.cli.console import doing_of, progress

T = TypeVar("T")
EVERY_S = 10.0  # between two lines where stderr is no terminal
KNOWN_FROM = 0.05  # share that must be done before a remaining time is said
LOOK_S = 0.1  # between two looks whether the work is done: so soon a signal is answered
INTERRUPTED = 130  # exit code, as a shell gives it


@contextmanager
def doing() -> Iterator[Callable[[str, float], None]]:
    """A callback (what is being done, fraction done): a bar on a terminal, else a line on stderr every `EVERY_S`."""
    with progress() as bar:
        if not bar.disable:
            yield doing_of(bar, lambda: None)
            return
        told, over, began = ["starting", 0.0], threading.Event(), time.monotonic()

        def show(what: str, fraction: float) -> None:
            told[:] = [what, fraction]

        def lines() -> None:
            while not over.wait(EVERY_S):
                print(line_of(*told, time.monotonic() - began), file=sys.stderr, flush=True)

        threading.Thread(target=lines, daemon=True).start()
        try:
            yield show
        finally:
            over.set()


def line_of(what: Any, fraction: Any, seconds: float) -> str:
    """hexsim: 35 %, refitting hypotheses, 20 s so far, about 40 s left."""
    left = f", about {span(seconds * (1.0 - fraction) / fraction)} left" if fraction >= KNOWN_FROM else ""
    return f"hexsim: {fraction:.0%}, {what}, {span(seconds)} so far{left}"


def span(seconds: float) -> str:
    """40 s, 3 min, 2 h."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def interruptible(work: Callable[[], T]) -> T:
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
    while not done.wait(LOOK_S):
        pass
    if raised:
        raise raised[0]
    return result[0]


def leave(sentence: str) -> None:
    """End the process after an interrupt: threads that still simulate are not waited for."""
    from hexsim.cli.errors import say

    say(sentence)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(INTERRUPTED)
