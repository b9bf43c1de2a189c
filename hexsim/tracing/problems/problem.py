"""What a fit asks of a problem: residuals of a machine over logs, in units of their noise."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import Any, Self

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.attempt import attempted

Array = np.ndarray
N_CORES = max(os.cpu_count() or 1, 1)


class FitProblem(ABC):
    """Logs, and how far a machine is from each. What refit, screening, selection and ties need, and nothing more.

    A problem says its `residual`; the rest follows. Problems are frozen: `head` and `with_input_uncertainty` give others.
    """

    logs: tuple[Log, ...]

    @abstractmethod
    def residual(self, machine: Machine, i: int) -> Array:
        """(measured - model)/noise of log i, (n_channels, n_used); NaN after a divergence. Raises for a machine that cannot be
        built: searches ask `misfit`, or `evaluated`."""

    @abstractmethod
    def channels(self, i: int) -> list[str]:
        """Names of the rows of the residual of log i."""

    @abstractmethod
    def used(self, i: int) -> int:
        """Samples of each row of the residual of log i."""

    @property
    def samples(self) -> int:
        """Residuals in all."""
        return sum(len(self.channels(i)) * self.used(i) for i in range(len(self.logs)))

    @property
    def rest_times_s(self) -> Array | float:
        """Correlation time of what a model leaves, of every row [s]: so far apart its samples count as independent."""
        return rules.REST_TIME_S

    def slow_alone(self) -> Self:
        """The same problem in which quick rows do not count; itself where there are none."""
        return self

    def settle(self, i: int) -> int:
        """First sample of log i that counts."""
        return 0

    def head(self, duration_s: float) -> Self:
        """The same problem about the first seconds of each log; itself when no log is longer."""
        return self

    def with_input_uncertainty(self, machine: Machine) -> Self:
        """The problem with what no model can know because its inputs are measured; itself where nothing is simulated."""
        return self

    def evaluated(self, machine: Machine | None, i: int) -> Array:
        """The residual of log i, infinite for a machine that cannot be built (None: not even declared) or diverges."""
        rest = None if machine is None else attempted(lambda: self.residual(machine, i))
        if rest is None:
            return np.full((len(self.channels(i)), self.used(i)), np.inf)
        return rest if np.isfinite(rest).all() else np.full(rest.shape, np.inf)

    def misfit(self, machines: Sequence[Machine | None]) -> list[Array]:
        """`evaluated` of many machines at once, on all cores: a log, (n_machines, n_channels, n_used), the caller's own."""
        jobs = [(machine, i) for machine in machines for i in range(len(self.logs))]
        found: list[Array] = []
        for job, residual in enumerate(in_turn(lambda job: self.evaluated(*job), jobs)):
            k, i = divmod(job, len(self.logs))
            if k == 0:
                found.append(np.empty((len(machines), *residual.shape)))
            found[i][k] = residual  # at once: a list of all of them would be a second copy
        return found

    @property
    def duration_s(self) -> float:
        """Length of the longest log."""
        return max(log.n / log.rate for log in self.logs)


def chi2_of(misfit: list[Array]) -> float:
    """Sum of squares; inf when a simulation diverged."""
    with np.errstate(over="ignore"):  # a pressure that ran away before the load did
        total = float(sum(np.sum(np.square(m)) for m in misfit))
    return total if np.isfinite(total) else np.inf


def drop_diverged(columns: list[Array]) -> list[Array]:
    """These columns of all logs, 0 for a number whose neighbour's simulation diverges: it stays where it is."""
    finite = np.all([np.isfinite(c).all(axis=(1, 2)) for c in columns], axis=0)
    for own in columns:
        own[~finite] = 0.0
    return columns


def in_parallel(function: Callable[[Any], Any], jobs: Iterable[Any]) -> list[Any]:
    """function(job) of every job, in their order, on all cores; compiled simulations release the interpreter.

    Who asks works too, and so it is with jobs of a job: cores that have come to the end of theirs help with what is left.
    """
    return list(in_turn(function, jobs))


def in_turn(function: Callable[[Any], Any], jobs: Iterable[Any]) -> Iterator[Any]:
    """`in_parallel`, each result as its turn comes: none is kept that the caller does not keep."""
    waiting = deque((job, Future()) for job in jobs)
    results = deque(future for _, future in waiting)
    helpers = [_threads().submit(_work, function, waiting) for _ in range(min(N_CORES, len(waiting)) - 1)]
    try:
        while results:
            result = results.popleft()
            while not result.done() and _one(function, waiting):
                pass  # as long as another core is at it, the next
            yield result.result()
    finally:
        waiting.clear()
        for helper in helpers:
            helper.cancel()


def _work(function: Callable[[Any], Any], waiting: deque[tuple[Any, Future]]) -> None:
    """Do jobs until none waits."""
    while _one(function, waiting):
        pass


def _one(function: Callable[[Any], Any], waiting: deque[tuple[Any, Future]]) -> bool:
    """Do the first job that waits. False: none does."""
    try:
        job, result = waiting.popleft()
    except IndexError:
        return False
    try:
        result.set_result(function(job))
    except Exception as error:
        waiting.clear()  # all before it have begun; the others will not be asked for
        result.set_exception(error)
    return True


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=max(N_CORES - 1, 1), thread_name_prefix="hexsim fits")
