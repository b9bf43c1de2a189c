"""Balances as a fit problem: their residuals at the measured point, over their noise, thinned to independent samples.

A balance costs milliseconds where a simulated run costs a tenth of a second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.balances import Balance
from hexsim.tracing.balances.balance import resolved_machine
from hexsim.tracing.balances.null import used_samples, window_weights
from hexsim.tracing.problems.problem import FitProblem
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class BalanceRows:
    """Rows of a balance that a problem looks at, and what noise makes of them.

    sigma: (n_places,) of every row of the balance.  rows: those that count.
    clean: a log, (n_places, n_used): the residual of a noise-free simulation, which is taken out.
    rest_time_s: correlation time of what a model leaves in them.
    """

    balance: Balance
    sigma: Array
    rows: tuple[int, ...]
    clean: tuple[Array, ...] = ()
    rest_time_s: float = rules.REST_TIME_S

    def residual(self, log: Log, machine: Machine, i: int, every: int) -> Array:
        """0 - residual over its noise (n_rows, n): what must be added for the balance to hold."""
        rows = list(self.rows)
        left = self.balance.residual_at(log, machine, used_samples(log, every))
        left = left - self.clean[i][:, ::every] if self.clean else left
        noise = self.sigma / np.abs(self.balance.noise_gains(resolved_machine(machine)))
        return -left[rows] / noise[rows, None] * window_weights(log)[::every]


@dataclass(frozen=True, kw_only=True, eq=False)
class BalanceProblem(FitProblem):
    """Balances of all logs as one problem. thin_s: time between the samples that count. simulation: see `beside_own_samples`."""

    logs: tuple[Log, ...]
    parts: tuple[BalanceRows, ...]
    thin_s: float = 0.01
    simulation: SimulatedProblem | None = None

    def residual(self, machine: Machine, i: int) -> Array:
        def rows(log: Log) -> Array:
            return np.concatenate([part.residual(log, machine, i, self.every(log)) for part in self.parts])

        own = 0.0 if self.simulation is None else rows(self.simulation.simulated(machine, i))
        return rows(self.logs[i]) - own

    def beside_own_samples(self, simulation: SimulatedProblem) -> Self:
        """The problem with what each machine's own noise-free samples leave taken out, in the place of what one machine's do.

        It changes with all that acts late: behind a spool nothing jumps with the volts, and what an accelerometer shows bends
        between two samples. Held at the declared machine it moves a delay by up to 0.2 ms. Each machine is simulated.
        """
        return replace(self, simulation=simulation, parts=tuple(replace(own, clean=()) for own in self.parts))

    def channels(self, i: int) -> list[str]:
        return [
            f"{part.balance.name} of {part.balance.places(self.logs[i])[k]}" for part in self.parts for k in part.rows
        ]

    @property
    def rest_times_s(self) -> Array:
        return np.concatenate([np.full(len(part.rows), part.rest_time_s) for part in self.parts])

    def slow_alone(self) -> Self:
        quick = [part.rest_time_s != rules.REST_TIME_S for part in self.parts]
        mute = (replace(p, rest_time_s=np.inf) if own else p for p, own in zip(self.parts, quick, strict=True))
        return replace(self, parts=tuple(mute)) if any(quick) else self

    def used(self, i: int) -> int:
        log = self.logs[i]
        return len(range(*used_samples(log, self.every(log)).indices(log.n)))

    def every(self, log: Log) -> int:
        """Samples of a log between two that count."""
        return max(int(self.thin_s * log.rate), 1)
