"""Errors on runs that no fit has seen, and the test that every name must pass there, whatever the balances say.

    d = mean over a block of (error with the effect)^2 - (error without it)^2,   of each channel of each held-out run

No name stands where the mean of d lies above zero by more standard errors than chance explains. The errors are those of the
report: physical units, accelerations in the 50 Hz band.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from hexsim.declaration import Machine
from hexsim.readers.one_grid import splined
from hexsim.signals.channels import kind_of
from hexsim.smoothness import band_limit
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, without_effect
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray


def banded(channel: str, time: Array, signal: Array) -> Array:
    """Accelerations in the 50 Hz band, other signals as they are."""
    return band_limit(time, signal) if "acceleration" in channel else signal


def differences(problem: SimulatedProblem, i: int, machine: Machine | None) -> dict[str, Array]:
    """measured - simulated of log i after the settling time, by channel, 0 where repaired; infinite after a divergence."""
    start, time, log = problem.settle(i), problem.logs[i].time, problem.logs[i]
    answer = None if machine is None else problem.answer(machine, i)
    found = {}
    for k, (name, measured) in enumerate(problem.measured[i].items()):
        off = np.full(log.n, np.inf) if answer is None else measured - answer[k]
        if not np.all(np.isfinite(off)):
            found[name] = np.full(log.n - start, np.inf)
            continue
        off[log.repaired.get(name, [])] = 0.0
        found[name] = banded(name, time, off)[start:]
    return found


def channel_errors(problem: SimulatedProblem, i: int, machine: Machine) -> dict[str, float]:
    """rms of `differences`."""
    return {name: float(np.sqrt(np.mean(off**2))) for name, off in differences(problem, i, machine).items()}


def errors_of(problem: SimulatedProblem, machines: Sequence[Machine]) -> list[list[dict[str, float]]]:
    """`channel_errors` of every machine on every log, on all cores: a machine, a log."""
    k = len(problem.logs)
    jobs = [(machine, i) for machine in machines for i in range(k)]
    found = in_parallel(lambda job: channel_errors(problem, job[1], job[0]), jobs)
    return [found[j : j + k] for j in range(0, len(found), k)]


def noise_floor(problem: SimulatedProblem, i: int) -> dict[str, float]:
    """rms of the sensors' noise alone, through the same band."""
    rng, log = np.random.default_rng(0), problem.logs[i]
    floor = {}
    for name in problem.channels(i):
        noise = problem.noise[kind_of(name)] * rng.standard_normal(log.n)
        noise = splined(0.0 * noise, log.sampled[name], noise) if name in log.sampled else noise
        floor[name] = float(np.sqrt(np.mean(banded(name, log.time, noise)[problem.settle(i) :] ** 2)))
    return floor


@dataclass(frozen=True, kw_only=True)
class Growth:
    """A channel of a held-out run whose error an effect makes larger. without, with_it: rms in times the noise."""

    run: str
    channel: str
    without: float
    with_it: float

    @property
    def sentence(self) -> str:
        digits = 3  # as many as tell the two apart
        while digits < 8 and f"{self.without:.{digits}g}" == f"{self.with_it:.{digits}g}":
            digits += 1
        sizes = f"from {self.without:.{digits}g} to {self.with_it:.{digits}g} times its noise"
        return f"{self.channel} of held-out run {self.run} goes {sizes}"


def growths(problem: SimulatedProblem, without: Machine | None, with_it: Machine | None) -> list[Growth]:
    """The channels whose error grows by more than its block error from one machine to another, the worst first.

    Blocks are longer than a rest is correlated. The limit is the t-quantile beyond which chance takes a name that does
    nothing wrong once in 1/`rules.DOUBT` traces, all channels of all runs together. Less than `rules.MODEL_SHARE` of the noise's
    mean square is the difference between two implementations of one model.
    """
    jobs = [(machine, i) for i in range(len(problem.logs)) for machine in (without, with_it)]
    pairs = in_parallel(lambda job: differences(problem, job[1], job[0]), jobs)
    tests = sum(len(problem.channels(i)) for i in range(len(problem.logs)))
    found = []
    for i, log in enumerate(problem.logs):
        floor, (before, after) = noise_floor(problem, i), pairs[2 * i : 2 * i + 2]
        for name in problem.channels(i):
            sizes = [float(np.sqrt(np.mean(off[name] ** 2))) / floor[name] for off in (before, after)]
            if not np.isfinite(sizes[0]) or not grown(
                before[name] / floor[name], after[name] / floor[name], log.rate, tests
            ):
                continue
            found.append(Growth(run=log.name, channel=name, without=sizes[0], with_it=sizes[1]))
    return sorted(found, key=lambda one: -one.with_it / max(one.without, 1.0))


def grown(before: Array, after: Array, rate_Hz: float, tests: int) -> bool:
    """Is the mean square surely larger after than before? Both (n,) in times the noise; tests: how often that is asked."""
    if not np.all(np.isfinite(after)):
        return True
    count = max(round(len(before) / rate_Hz / rules.REST_BLOCK_S), rules.FEW)
    blocks = np.array([own.mean() for own in np.array_split(after**2 - before**2, count)])
    error = float(np.std(blocks, ddof=1)) / np.sqrt(count)
    limit = float(stdtrit(count - 1, 1.0 - rules.DOUBT / tests))
    return float(blocks.mean()) > max(limit * error, rules.MODEL_SHARE)


def refused(
    fit: Fit, base: Fit, problem: SimulatedProblem, named: Sequence[int] | None = None
) -> tuple[int, str] | None:
    """The effect of a hypothesis that may not be named, and why; None where all may. named: places of those that would be.

    The whole against the machine without effects, refitted; of several effects each against the whole without it.
    """
    places, machine = list(range(len(fit.candidates)) if named is None else named), fit.built()
    steps = [(places[-1], base.built())]
    steps += [(k, without_effect(fit, k).built()) for k in reversed(places) if len(places) > 1]
    for k, without in steps:
        if found := growths(problem, without, machine):
            return k, f"{fit.candidates[k].label} is not named: with it {found[0].sentence}"
    return None


def at_the_rest(problem: SimulatedProblem, fit: Fit) -> SimulatedProblem:
    """The problem with every kind of channel in units of what a fit leaves of it, its noise where that is more."""
    left: dict[str, float] = {}
    for i, misfit in enumerate(fit.misfit):
        for name, row in zip(problem.channels(i), misfit, strict=True):
            left[kind_of(name)] = max(left.get(kind_of(name), 1.0), float(np.sqrt(np.mean(row**2))))
    return replace(problem, noise={kind: value * left.get(kind, 1.0) for kind, value in problem.noise.items()})
