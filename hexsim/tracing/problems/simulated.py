"""The model's answer to the logs: simulated channels, stacked and divided by their noise, ready for least squares."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.ndimage import uniform_filter1d

from hexsim.declaration import Machine
from hexsim.signals.channels import SETTLE_S, channel_arrays, kind_of
from hexsim.signals.log import MeasuredLog
from hexsim.tracing import rules
from hexsim.tracing.simulation.bench_simulator import simulate_bench
from hexsim.tracing.simulation.hexapod_simulator import simulate_hexapod

Array = np.ndarray


@cache
def _places(n_legs: int) -> dict[str, int]:
    """Rows of the simulations' outputs by channel."""
    if n_legs == 1:
        return {"position_m": 0, "pressure_bottom_Pa": 2, "pressure_supply_Pa": 3, "acceleration_m_s2": 4}
    places = {f"position_{i + 1}_m": i for i in range(6)} | {f"pressure_bottom_{i + 1}_Pa": 12 + i for i in range(6)}
    places |= {f"acceleration_{axis}_m_s2": 19 + i for i, axis in enumerate("xyz")}
    places |= {f"angular_acceleration_{axis}_rad_s2": 22 + i for i, axis in enumerate("xyz")}
    return places | {"pressure_supply_Pa": 18}


@dataclass(frozen=True, kw_only=True, eq=False)
class FitProblem:
    """Logs that a model must answer, with the noise of their channels.

    `misfit` is what every fit and test is made of. feedback: 0 the declared position loop, 1 the logged volts held to
    the logged position (see `leg_simulation.run_leg`). driven: how far no simulation can know the answer, a log (n_channels, n)
    in physical units, see `with_input_uncertainty`.
    """

    logs: tuple[MeasuredLog, ...]
    noise: dict[str, float]
    feedback: int = 0
    driven: tuple[Array, ...] = ()
    measured: tuple[dict[str, Array], ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", tuple(channel_arrays(log) for log in self.logs))

    def head(self, duration_s: float) -> FitProblem:
        """The same problem about the first seconds of each log; itself when no log is longer."""
        if self.duration_s <= duration_s + 1e-6:
            return self
        logs = tuple(log.head(duration_s) for log in self.logs)
        driven = tuple(
            np.ascontiguousarray(d[:, : log.n]) for d, log in zip(self.driven, logs, strict=bool(self.driven))
        )
        return replace(self, logs=logs, driven=driven)

    @property
    def duration_s(self) -> float:
        """Length of the longest log."""
        return max(log.n / log.rate for log in self.logs)

    def channels(self, i: int) -> list[str]:
        return list(self.measured[i])

    def settle(self, i: int) -> int:
        """First sample that counts."""
        return min(int(SETTLE_S * self.logs[i].rate), self.logs[i].n // 4)

    def blocks(self, i: int) -> int:
        """How many blocks of about a second log i has."""
        return max(int((self.logs[i].time[-1] - self.logs[i].time[0]) / rules.BLOCK_S), 2)

    def answer(self, machine: Machine, i: int) -> Array:
        """Simulated channels of log i in physical units (n_channels, n)."""
        out = self._outputs(machine, i)
        return out[[_places(self.logs[i].n_legs)[name] for name in self.channels(i)]]

    def _outputs(self, machine: Machine, i: int) -> Array:
        simulate = simulate_bench if self.logs[i].n_legs == 1 else simulate_hexapod
        return simulate(machine, self.logs[i], self.feedback)

    def simulated(self, machine: Machine, i: int) -> MeasuredLog:
        """Log i as the machine would have written it, without noise."""
        out, log = self._outputs(machine, i), self.logs[i]
        k = log.n_legs
        starts = (0, 1, 2, 3, 4) if k == 1 else (0, 6, 12, 18, 19)

        def like(rows: Array | None, first: int) -> Array | None:
            return None if rows is None else out[first : first + rows.shape[0]].copy()

        return replace(
            log,
            position=out[:k].copy(),
            volts=out[starts[1] : starts[1] + k].copy(),
            pressure=like(log.pressure, starts[2]),
            supply=None if log.supply is None else out[starts[3]].copy(),
            acceleration=like(log.acceleration, starts[4]),
            angular=like(log.angular, 22),
        )

    def sigma(self, i: int) -> Array:
        """What a channel may be off by: sensors' noise, and what no simulation can know. (n_channels, 1) or (n_channels, n)."""
        noise = np.array([self.noise[kind_of(name)] for name in self.channels(i)])[:, None]
        return np.hypot(noise, self.driven[i]) if self.driven else noise

    def _misfit(self, machine: Machine, i: int) -> Array:
        settle = self.settle(i)
        measured = np.stack(list(self.measured[i].values()))
        return ((measured - self.answer(machine, i)) / self.sigma(i))[:, settle:]

    def misfit(self, machines: Sequence[Machine]) -> list[Array]:
        """(measured - simulated)/noise of each log, (n_variants, n_channels, n_used); two threads."""
        jobs = [(machine, i) for machine in machines for i in range(len(self.logs))]
        results = list(_threads().map(lambda job: self._misfit(*job), jobs))
        k = len(self.logs)
        return [np.stack(results[i::k]) for i in range(k)]


def with_input_uncertainty(problem: FitProblem, machine: Machine) -> FitProblem:
    """The problem with what no simulation can know: the answer's spread when what drives the model is off a little.

    A slow passage with falling friction makes any difference grow, a hundredfold at some machines: there a log says nothing
    about a model. The declared loop's setpoints are off by UNKNOWN_SHARE of the position's noise. Where logged volts drive
    the model, they are off by their resolution and the position by its noise.
    """
    if problem.feedback == 1 and any(log.volts is None for log in problem.logs):
        return problem
    bare = replace(problem, driven=())
    jobs = [(i, seed) for i in range(len(problem.logs)) for seed in range(rules.UNKNOWN_SEEDS)]
    plain = list(_threads().map(lambda i: bare.answer(machine, i), range(len(problem.logs))))
    spreads = list(_threads().map(lambda job: (_disturbed(bare, machine, *job) - plain[job[0]]) ** 2, jobs))
    margin = rules.DRIVEN_MARGIN if problem.feedback == 1 else 1.0
    driven = []
    for i, log in enumerate(problem.logs):
        own = [spread for (k, _), spread in zip(jobs, spreads, strict=True) if k == i]
        width = max(int(rules.UNKNOWN_WINDOW_S * log.rate), 1)
        mean = uniform_filter1d(np.nan_to_num(np.mean(own, axis=0)), width, axis=1, mode="nearest")
        driven.append(margin * np.sqrt(np.maximum(mean, 0.0)))
    return replace(problem, driven=tuple(driven))


def _disturbed(problem: FitProblem, machine: Machine, i: int, seed: int) -> Array:
    """The answer (n_channels, n) when what drives the model is off at random."""
    log, rng = problem.logs[i], np.random.default_rng(seed)
    noise = problem.noise["position_m"] * rng.standard_normal(log.position.shape)
    if problem.feedback == 0:
        assert log.setpoint is not None
        off = replace(log, setpoint=log.setpoint + rules.UNKNOWN_SHARE * noise)
    else:
        assert log.volts is not None
        ticks = max(round(log.rate / machine.controller.rate_Hz), 1)
        steps = np.diff(np.unique(log.volts))
        half = 0.5 * float(np.quantile(steps, 0.1)) if len(steps) else 0.0
        rounding = np.repeat(rng.uniform(-half, half, (log.n_legs, log.n // ticks + 1)), ticks, axis=1)[:, : log.n]
        off = replace(log, volts=log.volts + rounding, position=log.position + noise)
    return replace(problem, logs=(off,)).answer(machine, 0)


@cache
def _threads() -> ThreadPoolExecutor:
    """The compiled simulations release the interpreter: as many at once as there are cores."""
    return ThreadPoolExecutor(max_workers=max(os.cpu_count() or 1, 1))
