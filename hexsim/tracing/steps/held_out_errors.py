"""Error of the model on a log, per signal: declared, refitted, with the effect; and the sensors' own noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hexsim.declaration import Machine
from hexsim.tracing.held_out import errors_of, noise_floor
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace


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
        machines["and nuisance effects"] = trace.fitted
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
