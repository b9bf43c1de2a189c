"""Error of the model on a log, per signal: declared, refitted, with the effect; and the sensors' own noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.channels import kind_of
from hexsim.smoothness import band_limit
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace

Array = np.ndarray


def banded(channel: str, time: Array, signal: Array) -> Array:
    """Accelerations in the 50 Hz band, other signals as they are."""
    return band_limit(time, signal) if "acceleration" in channel else signal


def channel_errors(problem: SimulatedProblem, i: int, machine: Machine) -> dict[str, float]:
    """rms of measured - simulated of log i after the settling time, by channel; inf after a divergence."""
    answer, start = problem.answer(machine, i), problem.settle(i)
    time = problem.logs[i].time
    errors = {}
    for row, (name, measured) in zip(answer, problem.measured[i].items(), strict=True):
        difference = measured - row
        if not np.all(np.isfinite(difference)):
            errors[name] = float("inf")
            continue
        difference[problem.logs[i].repaired.get(name, [])] = 0.0
        errors[name] = float(np.sqrt(np.mean(banded(name, time, difference)[start:] ** 2)))
    return errors


def noise_floor(problem: SimulatedProblem, i: int) -> dict[str, float]:
    """rms of the sensors' noise alone, through the same band."""
    rng, log = np.random.default_rng(0), problem.logs[i]
    floor = {}
    for name in problem.channels(i):
        noise = problem.noise[kind_of(name)] * rng.standard_normal(log.n)
        floor[name] = float(np.sqrt(np.mean(banded(name, log.time, noise)[problem.settle(i) :] ** 2)))
    return floor


def error_table(
    problem: SimulatedProblem, declared: Machine, refit: Machine, fitted: Machine
) -> dict[str, dict[str, dict[str, float]]]:
    """The report's `error`: log -> channel -> declared, refit, with_effect, noise."""
    table = {}
    for i, log in enumerate(problem.logs):
        columns = {
            "declared": channel_errors(problem, i, declared),
            "refit": channel_errors(problem, i, refit),
            "with_effect": channel_errors(problem, i, fitted),
            "noise": noise_floor(problem, i),
        }
        table[log.name] = {
            name: {kind: column[name] for kind, column in columns.items()} for name in problem.channels(i)
        }
    return table


def budget_machines(trace: Trace) -> dict[str, Machine]:
    """The models of the error budget: step -> machine, from the declared one to the last."""
    machines = {"as declared": trace.machine, "parameters refitted": trace.base.fitted_machine()}
    named, final = [effect.candidate for effect in trace.effects], trace.final
    for k in range(1, len(named) + 1):
        kept = [j for j, own in enumerate(final.candidates) if own in named[:k]]
        part = replace(
            final, candidates=tuple(final.candidates[j] for j in kept), values=tuple(final.values[j] for j in kept)
        )
        machines[f"with {named[k - 1].label.replace('_', ' ')}"] = part.fitted_machine()
    if trace.verdict == "partly":
        machines["and small realities"] = trace.fitted
    if trace.learned:
        machines["with the learned curve"] = trace.fitted
    return machines


def budget_of(trace: Trace) -> list[dict[str, Any]]:
    """Rows (channel, run, step, rms, multiple of noise) on held-out motion."""
    problem, rows = trace.validate_problem, []
    for i, log in enumerate(problem.logs):
        floor = noise_floor(problem, i)
        for step, machine in budget_machines(trace).items():
            for channel, rms in channel_errors(problem, i, machine).items():
                multiple = rms / max(floor[channel], 1e-300)
                rows.append(
                    {"channel": channel, "run": log.name, "step": step, "rms": rms, "multiple_of_noise": multiple}
                )
    return rows


def held_out_errors(trace: Trace, tell: Tell) -> Trace:
    """Error of each model on the held-out logs, a signal a line."""
    table = error_table(trace.validate_problem, trace.machine, trace.base.fitted_machine(), trace.fitted)
    worst = max((row["with_effect"] / row["noise"] for rows in table.values() for row in rows.values()), default=0.0)
    return replace(
        trace,
        error=table,
        budget=budget_of(trace),
        decided=f"largest error of the last model: {worst:.3g} times the noise",
    )


STEP = Step(name="held-out errors", doing="errors on held-out motion", share=0.01, run=held_out_errors)
