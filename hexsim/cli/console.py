"""Progress on stderr, tables and JSON on stdout."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, Literal

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, Task
    from rich.table import Table

LINE_EVERY_s = 10.0  # between two lines of progress where there is no terminal
COMPILING = "compiling (once)"


def output() -> Console:
    """Where tables go. Piped, a table is as wide as it needs. Brackets in names are no markup."""
    from rich.console import Console

    plain: Any = {"highlight": False, "markup": False, "emoji": False}
    console = Console(**plain)
    return console if console.is_terminal else Console(**plain, width=max(console.width, 120), soft_wrap=False)


def print_json(data: Any) -> None:
    """Strict JSON on stdout, in ASCII: any locale can print it."""
    import json

    from hexsim.files.json_files import plain

    typer.echo(json.dumps(plain(data, none_for_nan=True), indent=2, allow_nan=False))


@contextmanager
def progress() -> Iterator[Progress]:
    """A progress display on stderr that goes away when done; where stderr is no terminal, one line every 10 s.

    Both say "compiling (once)" while equations are compiled for the first time.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn

    from hexsim.compiled import while_compiling

    console = Console(stderr=True)
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task, told = bar.add_task(COMPILING, total=None, visible=False), []

        def compiling(begins: bool) -> None:
            bar.update(task, visible=begins)
            if begins and not console.is_terminal and not told:
                told.append(True)
                _say_progress(COMPILING)

        with while_compiling(compiling), progress_lines(bar) if not console.is_terminal else nullcontext():
            yield bar


@contextmanager
def compiling_said(say: Callable[[str], None]) -> Iterator[None]:
    """Meanwhile `say` gets "compiling (once)" when equations are compiled for the first time."""
    from hexsim.compiled import while_compiling

    told: list[bool] = []

    def compiling(begins: bool) -> None:
        if begins and not told:
            told.append(True)
            say(COMPILING)

    with while_compiling(compiling):
        yield


@contextmanager
def progress_lines(bar: Progress) -> Iterator[None]:
    """One line on stderr every `LINE_EVERY_s`: the task that is at work, how far it is and when it will be done."""
    ended = threading.Event()

    def say_it() -> None:
        while not ended.wait(LINE_EVERY_s):
            tasks = [task for task in bar.tasks if not task.finished and task.description != COMPILING]
            if tasks:
                compiles = any(task.visible for task in bar.tasks if task.description == COMPILING)
                line = progress_line(tasks[-1] if tasks[-1].total is None else tasks[0])
                _say_progress(f"{line}, {COMPILING}" if compiles else line)

    thread = threading.Thread(target=say_it, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _say_progress(text: str) -> None:
    """A line on stderr, unless the environment says HEXSIM_NO_PROGRESS."""
    if not os.environ.get("HEXSIM_NO_PROGRESS"):
        typer.echo(f"hexsim: {text}", err=True)


def progress_line(task: Task) -> str:
    """As "heave on bench: 42 %, about 25 s left"."""
    done = f": {task.percentage:.0f} %" if task.total is not None else ""
    left = task.time_remaining
    return f"{task.description}{done}{f', about {left:.0f} s left' if done and left else ''}"


def fraction_of(bar: Progress, description: str) -> Callable[[float], None]:
    """A new task of the display, as a callback that takes the fraction done."""
    task = bar.add_task(description, total=1.0)
    return lambda fraction: bar.update(task, completed=fraction)


def step_of(bar: Progress) -> Callable[[str], None]:
    """A callback that says which file is being written."""
    task = bar.add_task("writing", total=None)
    return lambda name: bar.update(task, description=f"writing {name}")


def doing_of(bar: Progress, check: Callable[[], None]) -> Callable[[str, float], None]:
    """A new task of the display, as a callback (what is being done, fraction done) that first lets `check` interrupt."""
    task = bar.add_task("starting", total=1.0)

    def show(doing: str, fraction: float) -> None:
        check()
        bar.update(task, description=doing, completed=fraction)

    return show


@contextmanager
def terminated_like_interrupted() -> Iterator[Callable[[], None]]:
    """SIGTERM, and the terminal's end (SIGHUP), end a run as Ctrl-C does, so that its partial log is kept.

    Gives a callback that raises KeyboardInterrupt again where a library has swallowed it.
    """
    caught: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        caught.append(number)
        raise KeyboardInterrupt

    def check() -> None:
        if caught:
            raise KeyboardInterrupt

    with _signals_go_to(interrupt):
        yield check


@contextmanager
def stop_when_signalled() -> Iterator[threading.Event]:
    """Ctrl-C, SIGTERM and the terminal's end set the event that is given: whoever runs in real time ends between two ticks,
    never within one. A second signal interrupts at once."""
    stop = threading.Event()

    def interrupt(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    with _signals_go_to(interrupt):
        yield stop
    if stop.is_set():
        gc.freeze()  # else Python's last collection walks through all that was compiled: 2 s in place of 0.3


@contextmanager
def _signals_go_to(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """The signals that end a program, meanwhile; only in the main thread can they be handled."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


def text_table(
    title: str, header: tuple[str, ...], rows: list[tuple[str, ...]], last: Literal["left", "right"] = "right"
) -> Table:
    """A table of a report: the first two columns begin at the left, the others end at the right, or as `last`."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(header):
        table.add_column(name, justify="left" if index < 2 else last)
    for row in rows:
        table.add_row(*row)
    return table
