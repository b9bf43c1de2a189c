"""When something is compiled, and for how long: what a first run takes is no figure of the machine's.

Every equation is compiled by numba at its first call and then kept (`hexsim.compiled`). Whoever measures how fast a
simulation runs takes these seconds off, and whoever waits for it is told.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event
from numba.core.caching import NullCache

KIND = "numba:compile"  # fires where a function is compiled and not where it is loaded from the cache
OWN = ("hexsim.", "compensation.")


class CompileTime(event.Listener):
    """seconds: spent compiling so far, in whichever thread; count: of hexsim's own functions that are kept afterwards.

    say: called once, with a text, as the first of these begins to be compiled.
    """

    def __init__(self, say: Callable[[str], None] = lambda text: None) -> None:
        self.seconds, self.count = 0.0, 0
        self._say = say
        self._local = threading.local()

    def on_start(self, event: Any) -> None:
        depth = getattr(self._local, "depth", 0)
        if depth == 0:
            self._local.begin = time.perf_counter()
        self._local.depth = depth + 1
        dispatcher: Any = (event.data or {}).get("dispatcher")
        is_kept = not isinstance(getattr(dispatcher, "_cache", None), (NullCache, type(None)))
        if is_kept and dispatcher.py_func.__module__.startswith(OWN):
            self.count += 1
            if self.count == 1:
                self._say("compiling (once)")

    def on_end(self, event: Any) -> None:
        self._local.depth = getattr(self._local, "depth", 1) - 1
        if self._local.depth == 0:
            self.seconds += time.perf_counter() - self._local.begin


@contextmanager
def compile_time(say: Callable[[str], None] = lambda text: None) -> Iterator[CompileTime]:
    """Listen to numba meanwhile; `say` gets "compiling (once)" if there is something to compile.

    real-time factor = simulated / (wall - compile_time.seconds)
    """
    listener = CompileTime(say)
    with event.install_listener(KIND, listener):
        yield listener
