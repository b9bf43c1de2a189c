"""Before "nothing missing" is said: is what is left of every channel noise, or does it follow a signal?

A library need not know the cause: an IMU whose axes are not square, a transducer that reads another pressure too. Below the
noise in every sample, it is 30 standard deviations in all of them. See `hexsim.tracing.predictable`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hexsim.machine import Machine
from hexsim.signals.channels import channel_arrays, kind_of
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.fitting.selection import residual_at_noise_level
from hexsim.tracing.predictable import Predicted, predicted
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.simulation.rig import LOGGED_VOLTS
from hexsim.tracing.state import Step, Tell, Trace

Array = np.ndarray


def signals_without_noise(log: Log) -> tuple[dict[str, Array], dict[str, Array]]:
    """Of a simulated log: its channels, volts and velocities by name, and the velocity that tells the direction of each."""
    own = channel_arrays(log)
    speed = np.gradient(log.position, 1.0 / log.rate, axis=1)
    legs = {f"_{k + 1}_" if log.n_legs > 1 else "": v for k, v in enumerate(speed)}
    for k, v in enumerate(speed):
        place = f"_{k + 1}" if log.n_legs > 1 else ""
        own[f"velocity{place}_m_s"] = v
        if log.volts is not None:
            own[f"valve{place}_V"] = log.volts[k]
    mean = speed.mean(axis=0)
    return own, {name: next((v for place, v in legs.items() if place in name), mean) for name in own}


def rests(machine: Machine, problem: SimulatedProblem) -> Iterator[tuple[Array, dict[str, Array], dict[str, Array]]]:
    """(rest over its noise (n_channels, n), signals, velocities) of every log."""
    for i in range(len(problem.logs)):
        own, speeds = signals_without_noise(problem.simulated(machine, i))
        first = problem.settle(i)
        yield (
            problem.residual(machine, i),
            {name: x[first:] for name, x in own.items()},
            {name: v[first:] for name, v in speeds.items()},
        )


def without_own(
    channels: Sequence[str], rests: Sequence[Array], signals: Sequence[dict[str, Array]], rate: float, noise: Array
) -> list[Array]:
    """The rests less what a small gain and a small delay of each channel itself leave: a s + b ds/dt, fitted to all runs.

    noise (n_channels,): what a rest is in units of. A log's clock and its writer's integrator are no better than these
    (`rules.READING`, `rules.CLOCK_S`); larger ones are not taken off whole.
    """
    out = [rest.copy() for rest in rests]
    for k, channel in enumerate(channels):
        if channel not in signals[0]:
            continue
        own = [run[channel] / noise[k] for run in signals]
        columns = [np.stack([x - x.mean(), np.gradient(x, 1.0 / rate)]) for x in own]
        normal = sum(column @ column.T for column in columns)
        asked = sum(column @ rest[k] for column, rest in zip(columns, rests, strict=True))
        if not np.all(np.diag(normal) > 0.0):
            continue
        most = np.array([rules.READING, rules.CLOCK_S])
        found = np.clip(np.linalg.lstsq(normal, asked, rcond=1e-9)[0], -most, most)
        for rest, column in zip(out, columns, strict=True):
            rest[k] -= found @ column
    return out


def predicted_rests(trace: Trace) -> list[Predicted]:
    """The strongest dependence of every channel's rest beside the final machine, fit and held-out runs together."""
    problems, machine = (trace.fit_problem, trace.validate_problem), trace.fitted
    runs = [run for problem in problems for run in rests(machine, problem)]
    rest, signals, speeds = (list(part) for part in zip(*runs, strict=True))
    channels, rate = problems[0].channels(0), problems[0].logs[0].rate
    noise = np.array([problems[0].noise[kind_of(name)] for name in channels])
    return predicted(channels, without_own(channels, rest, signals, rate, noise), signals, speeds, rate)


def hold_against_signals(trace: Trace, tell: Tell) -> Trace:
    """ "nothing missing" becomes "unexplained" where a channel's rest follows a signal; so does "explained" by an effect that
    the noise alone could hide: one that stands in for another leaves a part of it."""
    small = trace.verdict == "explained" and residual_at_noise_level(trace.base.misfit)
    if trace.verdict != "nothing missing" and not small:
        return replace(trace, decided="not needed: something is missing")
    if trace.fit_problem.feedback == LOGGED_VOLTS:
        return replace(trace, decided="not asked: logged volts drive the model, and they hold the position's noise")
    found = predicted_rests(trace)
    sure = [own for own in found if own.share > rules.SLIGHT and own.above > rules.ERRORS]
    if not sure:
        most = (
            f"{found[0].channel} follows {found[0].signal} with {found[0].share:.1%} of it" if found else "no channel"
        )
        return replace(trace, decided=f"what is left follows no signal; most: {most}")
    sentences = "; ".join(own.sentence for own in sure[:3])
    if small:
        named = " and ".join(candidate.label for candidate in trace.final.candidates)
        sentences = f"{named} helps and is not sure: beside it, {sentences}"
    return replace(trace, verdict="unexplained", final=trace.base, predicted=tuple(sure), decided=sentences)


STEP = Step(name="noise only", doing="holding what is left against the signals", share=0.03, run=hold_against_signals)
