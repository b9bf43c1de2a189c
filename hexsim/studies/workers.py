"""Processes that each run one case at a time: one that dies costs its own case and is replaced.

A `ProcessPoolExecutor` fails as a whole when one of its processes dies, and does not say on which task.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection, wait
from typing import Any

CONTEXT = multiprocessing.get_context("spawn")  # a fork would copy locks that threads hold


class WorkerDied(Exception):
    """The process that ran a case ended without a result."""


class Workers(Executor):
    """`count` processes, begun when they are needed."""

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="sweep")  # one waits for each process
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._all: set[Worker] = set()
        self._ended = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._threads.submit(self._run, fn, args, kwargs)

    def _run(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        try:
            worker = self._idle.get_nowait()
        except queue.Empty:
            worker = Worker()
            self._all.add(worker)
        if self._ended:
            worker.end()
        try:
            result = worker.run(function, args, kwargs)
        except WorkerDied:
            self._all.discard(worker)
            raise
        self._idle.put(worker)
        return result

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; with `cancel_futures` those that are at work, too."""
        self._threads.shutdown(wait=wait and not cancel_futures, cancel_futures=cancel_futures)
        self._ended = True
        for worker in list(self._all):
            worker.end()
        self._threads.shutdown(wait=wait)


class Worker:
    """One process, and the pipe to it."""

    def __init__(self) -> None:
        self._pipe, theirs = CONTEXT.Pipe()
        self._process = CONTEXT.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def run(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        """The function's result or exception. Raises WorkerDied where the process ends without either."""
        try:
            self._pipe.send((function, args, kwargs))
            is_done, result = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            raise WorkerDied(f"the process that ran it died: {_how(self._process.exitcode)}") from None
        if is_done:
            return result
        raise result

    def end(self) -> None:
        self._process.kill()


def _how(code: int | None) -> str:
    """An exit code in words."""
    if code is not None and code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        return f"{name}{', as where memory runs out' if name == 'SIGKILL' else ''}"
    return f"exit code {code}"


def _work(pipe: Connection) -> None:
    """Take functions and give back what they return or raise, until the pipe ends."""
    one_thread()
    while True:
        try:
            function, args, kwargs = pipe.recv()
        except EOFError:
            return
        try:
            answer = True, function(*args, **kwargs)
        except BaseException as error:
            answer = False, error
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as error:  # a result that cannot travel
            pipe.send((False, RuntimeError(f"{type(error).__name__}: {error}")))


def one_thread() -> None:
    """A worker is one of many: it takes one processor, leaves Ctrl-C to the process that started it, and ends with it."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
