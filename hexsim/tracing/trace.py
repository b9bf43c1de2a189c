"""`trace`: a declared machine and its logs in, a verdict out. Steps as in docs/tracing.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.machine import Machine, load_machine
from hexsim.machine.files import find_machine_file
from hexsim.readers import log_files, read_log
from hexsim.signals.channels import noise_of
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.checks.checks import refuse_misleading
from hexsim.tracing.checks.finding import Finding
from hexsim.tracing.checks.same_machine import check_same_machine
from hexsim.tracing.fitting.fit import Fit, polished, refine, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, candidates, priors
from hexsim.tracing.fitting.selection import Search, Stage, cut, information, search
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.report.content import report_of, write_report
from hexsim.tracing.result import TraceResult
from hexsim.tracing.steps.experiments import experiment_for
from hexsim.tracing.steps.held_out_errors import error_table
from hexsim.tracing.steps.learned import learned_fit
from hexsim.tracing.steps.proposals import proposed_shapes
from hexsim.tracing.steps.residuals import attributed, unexplained_residuals
from hexsim.tracing.steps.search import balance_search, joint_problem, simulated_rivals
from hexsim.tracing.steps.ties import with_ties
from hexsim.tracing.steps.verdict import (
    judged,
    name_effects,
    pruned,
    refit_with_own_input_uncertainty,
    refit_without_effects,
    residual_at_noise_level,
)
from hexsim.tracing.steps.violations import Violation, violations

Progress = Callable[[str, float], None]


def read_runs(folder: Path, names: Sequence[str], machine: Machine) -> tuple[list[Log], dict[str, list[Finding]]]:
    """Read and check the named logs."""
    logs, findings = [], {}
    for name in names:
        file = read_log(log_files(folder, name))
        findings[file.name] = refuse_misleading(file, machine)
        logs.append(file)
    return logs, findings


def feedback_of(machine: Machine, logs: Sequence[Log], noise: dict[str, float]) -> int:
    """0 when the logged volts are those of the declared position loop, 1 when another controller was at work."""
    K, limit = machine.controller.gain_V_per_m, machine.valve.voltage_max_V
    for log in logs:
        if log.setpoint is None:
            return 1
        if log.volts is None:
            continue
        asked = np.clip(K * (log.setpoint - log.position), -limit, limit)
        every = max(round(log.rate / machine.controller.rate_Hz), 1)
        off = np.median(np.abs(log.volts - asked)[:, ::every])
        if off > 5 * K * noise["position_m"] and off > 0.02 * np.std(log.volts):
            return 1
    return 0


def trace(
    machine_folder: Path | str,
    fit: Sequence[str] = ("fit",),
    validate: Sequence[str] = ("validate",),
    out: Path | str | None = None,
    progress: Progress | None = None,
) -> TraceResult:
    """Hold the declared machine against its logs and name what it lacks.

    fit: logs that everything is chosen and fitted on; validate: held-out logs. Raises HexsimError for bad data.
    Writes report.json, machine.toml, report.html and scenarios into `out` if given.
    """
    tell = progress or (lambda step, fraction: None)
    if not fit or not validate:
        raise HexsimError("tracing needs at least one log to fit and one held-out log to validate: give both")
    folder = find_machine_file(machine_folder).parent
    machine = load_machine(machine_folder)
    tell("reading logs", 0.0)
    fit_logs, findings = read_runs(folder, fit, machine)
    validate_logs, more = read_runs(folder, validate, machine)
    findings |= more
    findings["all logs"] = check_same_machine([*fit_logs, *validate_logs], machine)
    noise = noise_of(machine, fit_logs)
    feedback = feedback_of(machine, [*fit_logs, *validate_logs], noise)
    problem = SimulatedProblem(logs=tuple(fit_logs), noise=noise, feedback=feedback)
    held_out = replace(problem, logs=tuple(validate_logs))
    result = trace_logs(machine, problem, held_out, findings, tell)
    if out is not None:
        write_report(result, Path(out))
    tell("done", 1.0)
    return result


def trace_logs(
    machine: Machine,
    problem: SimulatedProblem,
    held_out: SimulatedProblem,
    findings: dict[str, list[Finding]],
    tell: Progress,
) -> TraceResult:
    """Steps 1 to 10 on logs that are read and checked."""
    known = priors(machine)
    tell("balances", 0.05)
    lines = violations(machine, machine, problem)
    tell("searching in the balances", 0.2)
    proposed = proposed_shapes(own_machine(machine, lines), problem.logs)
    possible = worth_screening(machine, lines, proposed)
    joint = joint_problem(problem, lines, own_machine(machine, lines))
    in_balances = balance_search(machine, known, possible, joint)
    tell("refitting declared parameters", 0.35)
    base, problem, held_out = refitted_base(in_balances.base, problem, held_out)
    found = Search(base=base, best=base, stages=[Stage(lines=in_balances.stages[0].lines, rivals=[])])
    if not residual_at_noise_level(base.misfit):
        found.stages[0].rivals = simulated_rivals(in_balances, problem, lambda step: tell(step, 0.5))
    final = pruned(found.stages[0].rivals[0], problem) if found.stages[0].rivals else base
    final, base, problem, held_out = refit_with_own_input_uncertainty(final, base, problem, held_out)
    detect = found.stages[0].lines, joint.samples
    if not residual_at_noise_level(final.misfit) or (not final.candidates and not machine.is_hexapod):
        tell("screening effects by simulation", 0.6)
        by_simulation = simulated_search(base, possible, problem, tell)
        if by_simulation.stages:
            detect = by_simulation.stages[0].lines, base.n
        if not final.candidates or information(by_simulation.best) < information(final):
            found = by_simulation
            final = pruned(by_simulation.best, problem)
        final, base, problem, held_out = refit_with_own_input_uncertainty(final, base, problem, held_out)
    if final.candidates and residual_at_noise_level(final.misfit):
        tell("last refit", 0.8)
        final = polished(final, problem)
    base = refit_without_effects(final, base, problem)
    tell("held-out runs", 0.85)
    verdict, final = judged(base, final, problem, held_out)
    ties: list[dict[str, Fit]] = []
    if verdict == "explained":
        tell("looking for ties", 0.87)
        final, ties = with_ties(final, possible, problem)
    named = name_effects(found, base, final, ties, held_out)
    tell("what is left", 0.9)
    kept = final if verdict in ("explained", "nothing missing") else base
    rests = [] if verdict in ("explained", "nothing missing") else unexplained_residuals(lines, problem)
    lines = attributed(lines, named, rests)
    learned = []
    if rests:
        tell("learned term", 0.93)
        grown = learned_fit(rests[0], machine, known, base, problem, held_out)
        if grown is not None:
            kept, learned = grown[0], [grown[1]]
    result = TraceResult(
        machine=machine,
        fitted=kept.fitted_machine(),
        verdict=verdict,
        effects=named,
        violations=lines,
        search=found,
        base=base,
        final=kept,
        error=error_table(held_out, machine, base.fitted_machine(), kept.fitted_machine()),
        fit_problem=problem,
        validate_problem=held_out,
        findings=findings,
        unexplained=rests,
        ties=ties,
        learned=learned,
        detect_lines=detect[0],
        detect_n=detect[1],
    )
    add_experiments(result)
    result.report = report_of(result)
    return result


def simulated_search(base: Fit, possible: list[Candidate], problem: SimulatedProblem, tell: Progress) -> Search:
    """The search with simulated columns: on the opening seconds where they lack something, on the whole runs otherwise."""

    def tick(step: str) -> None:
        tell(step, 0.7)

    head = problem.head(rules.TRIAGE_S)
    if head is problem or residual_at_noise_level(cut(base, problem, head).misfit):
        return search(base, possible, problem, tick, least_gain=rules.LEAST_GAIN_SIMULATED)
    opening = refine(start_fit_at(base, head), head, fresh=True, relative=rules.BASE_TOLERANCE)
    found = search(opening, possible, head, tick, least_gain=rules.LEAST_GAIN_SIMULATED)
    rivals = simulated_rivals(found, problem, tick)
    stages = [replace(stage, rivals=[]) for stage in found.stages]
    if rivals:
        stages[-1].rivals = rivals
    return replace(found, base=base, best=rivals[0] if rivals else base, stages=stages)


def refitted_base(
    start: Fit, problem: SimulatedProblem, held_out: SimulatedProblem
) -> tuple[Fit, SimulatedProblem, SimulatedProblem]:
    """The declared machine refitted, and the questions with what no simulation can know about it."""
    first = problem.with_input_uncertainty(start.fitted_machine())
    base = refine(start_fit_at(start, first), first, fresh=True, relative=rules.BASE_TOLERANCE)
    problem, held_out = (q.with_input_uncertainty(base.fitted_machine()) for q in (problem, held_out))
    return refine(start_fit_at(base, problem), problem, fresh=True, relative=rules.BASE_TOLERANCE), problem, held_out


def add_experiments(result: TraceResult) -> None:
    """For every tie the motion that would separate it, as a scenario file."""
    for k, effect in enumerate(result.effects):
        for label, rival in result.ties[k].items():
            names = (effect.candidate.label, label)
            found = experiment_for(result.final, rival, names, result.fit_problem.noise)
            result.scenarios[found.file_name] = found.text()
            description = found.tables["description"]
            result.experiments.append(
                {
                    "effects": list(names),
                    "file": found.file_name,
                    "description": description[0].upper() + description[1:],
                    "chi2": found.separation,
                }
            )


def own_machine(machine: Machine, lines: Sequence[Violation]) -> Machine:
    """The machine with parameters that the force balance prefers: where shapes are read off."""
    return next((line.machine for line in lines if line.name == "force"), machine)


def worth_screening(
    machine: Machine, lines: Sequence[Violation], proposed: dict[str, dict[str, float]]
) -> list[Candidate]:
    """All effects on a bench. On a hexapod: in all legs alike, and in the legs that are violated, the worst at least."""
    everything = candidates(machine, proposed)
    legs = [line for line in lines if line.where.startswith("leg ")]
    if machine.n_legs == 1 or not legs:
        return everything
    worst = max(legs, key=lambda line: line.violation / line.null)
    there = {line.where for line in legs if line.violated} | {worst.where}
    return [c for c in everything if not c.where.startswith("leg ") or c.where in there]
