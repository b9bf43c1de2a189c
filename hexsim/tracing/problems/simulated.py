"""The model's answer to the logs: simulated channels, stacked and divided by their noise, ready for least squares."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from hexsim.declaration import Machine
from hexsim.readers.one_grid import as_read
from hexsim.signals.channels import SETTLE_S, channel_arrays, kind_of
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.memory import latest_of
from hexsim.tracing.problems.problem import FitProblem, in_parallel
from hexsim.tracing.simulation.rig import DECLARED_LOOP, LOGGED_VOLTS
from hexsim.tracing.simulation.simulator import simulate_log, simulated_or_refused
from hexsim.tracing.simulation.start import ringing_Pa

Array = np.ndarray
RING = np.sqrt(2.0)  # amplitude over rms


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedProblem(FitProblem):
    """Logs that a model must answer, with the noise of their channels.

    feedback: what gives the volts, see `simulation.rig.Controller`. shown: share of the position's noise that logged volts show;
    volts_share: see `simulation.rig.Controller`.
    input_uncertainty: how far no simulation can know the answer, a log (n_channels, n) in physical units.
    """

    logs: tuple[Log, ...]
    noise: dict[str, float]
    feedback: int = DECLARED_LOOP
    shown: float = 0.0
    volts_share: float = 0.0
    input_uncertainty: tuple[Array, ...] = ()
    measured: tuple[dict[str, Array], ...] = field(init=False)
    weights: tuple[Array | float, ...] = field(
        init=False
    )  # a log: (n_channels, n_used), 1.0 where nothing was repaired

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", tuple(channel_arrays(log) for log in self.logs))
        object.__setattr__(self, "weights", tuple(self._weight(i) for i in range(len(self.logs))))

    def _weight(self, i: int) -> Array | float:
        """Roots of the samples' weights: 0 where a sample was repaired, less than 1 between samples; the others of
        its channel weigh more than repaired ones left, so that noise keeps its size."""
        log = self.logs[i]
        if not log.repaired and not log.sampled:
            return 1.0
        rows = np.sqrt(np.stack([log.weight(name) for name in self.channels(i)]))[:, self.settle(i) :]
        return rows / np.sqrt(np.maximum((rows > 0).mean(axis=1, keepdims=True), 1.0 / log.n))

    def head(self, duration_s: float) -> Self:
        if self.duration_s <= duration_s + 1e-6:
            return self
        logs = tuple(latest_of(log, "head", duration_s, lambda log=log: log.head(duration_s)) for log in self.logs)
        known = zip(self.input_uncertainty, logs, strict=bool(self.input_uncertainty))
        return replace(
            self, logs=logs, input_uncertainty=tuple(np.ascontiguousarray(u[:, : log.n]) for u, log in known)
        )

    def channels(self, i: int) -> list[str]:
        return list(self.measured[i])

    def used(self, i: int) -> int:
        return self.logs[i].n - self.settle(i)

    def settle(self, i: int) -> int:
        return min(int(SETTLE_S * self.logs[i].rate), self.logs[i].n // 4)

    def answer(self, machine: Machine, i: int, off_Pa: Array | float = 0.0) -> Array:
        """Simulated channels of log i in physical units (n_channels, n)."""
        return np.stack(list(channel_arrays(self.simulated(machine, i, off_Pa)).values()))

    def simulated(self, machine: Machine, i: int, off_Pa: Array | float = 0.0) -> Log:
        """Log i as the machine would have written it, without noise, and its reader read it; channels that it has not are left out.

        off_Pa (n_legs,): added to the pressures in which it begins.
        """
        log = self.logs[i]
        out = simulate_log(machine, log, self.feedback, self.noise, off_Pa, self.volts_share)
        there = {
            stem: rows for stem, rows in out.items() if stem in ("position", "valve") or log.signal(stem) is not None
        }
        return as_read(replace(log, **there))

    def simulated_or_refused(self, machine: Machine, i: int) -> None:
        """Raises the reason where the machine cannot be built along log i."""
        simulated_or_refused(machine, self.logs[i], self.feedback, self.noise, volts_share=self.volts_share)

    def sigma(self, i: int) -> Array:
        """What a channel may be off by: sensors' noise, and what no simulation can know. (n_channels, 1) or (n_channels, n)."""
        noise = np.array([self.noise[kind_of(name)] for name in self.channels(i)])[:, None]
        return np.hypot(noise, self.input_uncertainty[i]) if self.input_uncertainty else noise

    def reweighted(self, columns: list[Array] | None, before: Self) -> list[Array] | None:
        """Columns (a log: (k, n_channels, n)) in units of what this problem leaves unknown, not another one of the same logs."""
        if columns is None or self is before:
            return columns
        shares = (before.sigma(i) / self.sigma(i) for i in range(len(self.logs)))
        return [own * share[:, -own.shape[2] :] for own, share in zip(columns, shares, strict=True)]

    def residual(self, machine: Machine, i: int) -> Array:
        rest = self.answer(machine, i)
        for row, measured, sigma in zip(rest, self.measured[i].values(), self.sigma(i), strict=True):
            np.subtract(measured, row, out=row)  # in place: each array of a long log takes tens of megabytes
            row /= sigma
        return rest[:, self.settle(i) :] * self.weights[i]

    def with_input_uncertainty(self, machine: Machine) -> Self:
        """The problem with what no simulation can know: the answer's spread when what drives the model is off a little.

        A slow passage with falling friction makes any difference grow, a hundredfold at some machines: there a log says
        nothing about a model. The declared loop's setpoints are off by the position's noise. Where logged
        volts drive the model, they are off by their resolution and the position by its noise. Oil that rings as a log begins
        rings in another phase.
        """
        if self.feedback == LOGGED_VOLTS and any(log.volts is None for log in self.logs):
            return self
        bare = replace(self, input_uncertainty=())
        jobs = [(i, seed) for i in range(len(self.logs)) for seed in range(rules.INPUT_SEEDS)]
        plain = in_parallel(lambda i: bare.answer(machine, i), range(len(self.logs)))
        spreads = in_parallel(lambda job: (bare._disturbed(machine, *job) - plain[job[0]]) ** 2, jobs)
        margin = rules.VIOLATED if self.feedback == LOGGED_VOLTS else 1.0
        spread = []
        for i, log in enumerate(self.logs):
            own = [square for (k, _), square in zip(jobs, spreads, strict=True) if k == i]
            width = max(int(rules.SPREAD_S * log.rate), 1)
            mean = uniform_filter1d(np.nan_to_num(np.mean(own, axis=0)), width, axis=1, mode="nearest")
            spread.append(margin * np.sqrt(np.maximum(mean, 0.0)))
        return replace(self, input_uncertainty=tuple(spread))

    def with_known_volts(self) -> Self:
        """The problem with the noise that the logged volts show. A model that is far off takes it for what it lacks: a fit begins
        without it."""
        return replace(self, volts_share=self.shown)

    def _disturbed(self, machine: Machine, i: int, seed: int) -> Array:
        """The answer (n_channels, n) when what drives the model is off at random."""
        log, rng = self.logs[i], np.random.default_rng(seed)
        off_Pa = RING * ringing_Pa(log, self.noise["pressure_bottom_Pa"]) * (1.0 if seed % 2 else -1.0)
        noise = self.noise["position_m"] * rng.standard_normal(log.position.shape)
        if self.feedback != LOGGED_VOLTS:
            assert log.setpoint is not None
            off = replace(log, setpoint=log.setpoint + noise)
        else:
            assert log.volts is not None
            ticks = max(round(log.rate / machine.controller.rate_Hz), 1)
            steps = np.diff(np.unique(log.volts))
            half = 0.5 * float(np.quantile(steps, 0.1)) if len(steps) else 0.0
            rounding = np.repeat(rng.uniform(-half, half, (log.n_legs, log.n // ticks + 1)), ticks, axis=1)[:, : log.n]
            off = replace(log, volts=log.volts + rounding, position=log.position + noise)
        return replace(self, logs=(off,)).answer(machine, 0, off_Pa)
