"""Error of the model on a log, per signal: declared, refitted, with the effect; and the sensors' own noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.channels import kind_of
from hexsim.smoothness import band_limit
from hexsim.tracing.problems.problem import in_parallel
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


def errors_of(problem: SimulatedProblem, machines: Sequence[Machine]) -> list[list[dict[str, float]]]:
    """`channel_errors` of every machine on every log, on all cores: a machine, a log."""
    k = len(problem.logs)
    jobs = [(machine, i) for machine in machines for i in range(k)]
    found = in_parallel(lambda job: channel_errors(problem, job[1], job[0]), jobs)
    return [found[j : j + k] for j in range(0, len(found), k)]


def error_table(
    problem: SimulatedProblem, declared: Machine, refit: Machine, fitted: Machine
) -> dict[str, dict[str, dict[str, float]]]:
    """The report's `error`: log -> channel -> declared, refit, with_effect, noise."""
    models, table = errors_of(problem, [declared, refit, fitted]), {}
    for i, log in enumerate(problem.logs):
        errors = [*(own[i] for own in models), noise_floor(problem, i)]
        columns = dict(zip(("declared", "refit", "with_effect", "noise"), errors, strict=True))
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
        if (machine := part.built()) is not None:
            machines[f"with {named[k - 1].label.replace('_', ' ')}"] = machine
    if trace.verdict == "partly":
        machines["and small realities"] = trace.fitted
    if trace.learned:
        machines["with the learned curve"] = trace.fitted
    return machines


def budget_of(trace: Trace, table: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[dict[str, Any]]:
    """Rows (channel, run, step, rms, multiple of noise) on held-out motion. table: `error_table`, where most of it stands."""
    problem, steps, rows = trace.validate_problem, budget_machines(trace), []
    known = {"declared": trace.machine, "refit": steps["parameters refitted"], "with_effect": trace.fitted}
    stands = {
        step: next((kind for kind, own in known.items() if own == machine), "") for step, machine in steps.items()
    }
    others = [step for step, kind in stands.items() if not kind]
    made = dict(zip(others, errors_of(problem, [steps[step] for step in others]), strict=True))
    for i, log in enumerate(problem.logs):
        for step, kind in stands.items():
            for channel, own in table[log.name].items():
                rms = own[kind] if kind else made[step][i][channel]
                multiple = rms / max(own["noise"], 1e-300)
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
        budget=budget_of(trace, table),
        decided=f"largest error of the last model: {worst:.3g} times the noise",
    )


STEP = Step(name="held-out errors", doing="errors on held-out motion", share=0.01, run=held_out_errors)
