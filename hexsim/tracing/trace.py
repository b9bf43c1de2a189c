"""`trace`: a declared machine and its logs in, a verdict out. Steps as in docs/tracing.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.machine import Machine, load_machine
from hexsim.machine.files import find_machine_file
from hexsim.tracing import rules
from hexsim.tracing.answer import Question, unknowable
from hexsim.tracing.balance_search import balance_search, joint_question, simulated_rivals, start_fit_at
from hexsim.tracing.channels import noise_of
from hexsim.tracing.checks import Finding, check_same_machine, refuse_misleading
from hexsim.tracing.errors_before_after import error_table
from hexsim.tracing.experiments import experiment_for
from hexsim.tracing.hypothesis import Candidate, candidates, priors
from hexsim.tracing.learned import learned_fit
from hexsim.tracing.localise import Violation, balance_named, violations
from hexsim.tracing.log import MeasuredLog, measured_log
from hexsim.tracing.proposals import proposed_shapes
from hexsim.tracing.readers import log_files, read_log
from hexsim.tracing.refit import Fit, refine
from hexsim.tracing.report import report_of
from hexsim.tracing.screening import Screened
from hexsim.tracing.search import Search, Stage, cut, information, scale_of, search
from hexsim.tracing.ties import with_ties
from hexsim.tracing.unexplained import Rest, rest_of
from hexsim.tracing.verdict import NamedEffect, Verdict, at_floor, base_beside, held_out_gains, pruned

Progress = Callable[[str, float], None]


@dataclass(kw_only=True)
class TraceResult:
    """Everything a trace found; `report` is the content of report.json."""

    machine: Machine
    fitted: Machine
    verdict: Verdict
    effects: list[NamedEffect]
    violations: list[Violation]
    search: Search
    base: Fit
    final: Fit
    error: dict[str, dict[str, dict[str, float]]]
    fit_question: Question
    validate_question: Question
    findings: dict[str, list[Finding]]
    detect_lines: list[Screened]
    detect_n: int
    unexplained: list[Rest] = field(default_factory=list)
    ties: list[dict[str, Fit]] = field(default_factory=list)  # an effect: label -> the hypothesis that does as well
    learned: list[dict[str, Any]] = field(default_factory=list)
    experiments: list[dict[str, Any]] = field(default_factory=list)
    scenarios: dict[str, str] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)


def read_runs(
    folder: Path, names: Sequence[str], machine: Machine
) -> tuple[list[MeasuredLog], dict[str, list[Finding]], list]:
    """Read and check the named logs."""
    logs, findings, files = [], {}, []
    for name in names:
        file = read_log(log_files(folder, name))
        findings[file.name] = refuse_misleading(file, machine)
        logs.append(measured_log(file.name, file.table, machine))
        files.append(file)
    return logs, findings, files


def feedback_of(machine: Machine, logs: Sequence[MeasuredLog], noise: dict[str, float]) -> int:
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
    fit_logs, findings, files = read_runs(folder, fit, machine)
    validate_logs, more, held_out_files = read_runs(folder, validate, machine)
    findings |= more
    findings["all logs"] = check_same_machine([*files, *held_out_files], machine)
    noise = noise_of(machine, fit_logs)
    feedback = feedback_of(machine, [*fit_logs, *validate_logs], noise)
    question = Question(logs=tuple(fit_logs), noise=noise, feedback=feedback)
    held_out = replace(question, logs=tuple(validate_logs))
    result = trace_logs(machine, question, held_out, findings, tell)
    if out is not None:
        from hexsim.tracing.report import write_report

        write_report(result, Path(out))
    tell("done", 1.0)
    return result


def trace_logs(
    machine: Machine, question: Question, held_out: Question, findings: dict[str, list[Finding]], tell: Progress
) -> TraceResult:
    """Steps 1 to 10 on logs that are read and checked."""
    known = priors(machine)
    tell("balances", 0.05)
    lines = violations(machine, machine, question)
    tell("searching in the balances", 0.2)
    proposed = proposed_shapes(own_machine(machine, lines), question.logs)
    possible = worth_screening(machine, lines, proposed)
    joint = joint_question(question, lines, own_machine(machine, lines))
    in_balances = balance_search(machine, known, possible, joint)
    tell("refitting declared parameters", 0.35)
    base, question, held_out = refitted_base(in_balances.base, question, held_out)
    found = Search(base=base, best=base, stages=[Stage(lines=in_balances.stages[0].lines, rivals=[])])
    if not at_floor(base.misfit):
        found.stages[0].rivals = simulated_rivals(in_balances, question, lambda step: tell(step, 0.5))
    final = pruned(found.stages[0].rivals[0], question) if found.stages[0].rivals else base
    final, base, question, held_out = seen_from_itself(final, base, question, held_out)
    detect = found.stages[0].lines, joint.samples
    if not at_floor(final.misfit) or (not final.candidates and not machine.is_hexapod):
        tell("screening effects by simulation", 0.6)
        by_simulation = simulated_search(base, possible, question, tell)
        if by_simulation.stages:
            detect = by_simulation.stages[0].lines, base.n
        if not final.candidates or information(by_simulation.best) < information(final):
            found = by_simulation
            final = pruned(by_simulation.best, question)
        final, base, question, held_out = seen_from_itself(final, base, question, held_out)
    base = base_beside(final, base, question)
    tell("held-out runs", 0.85)
    verdict, final = judged(base, final, question, held_out)
    ties: list[dict[str, Fit]] = []
    if verdict == "explained":
        tell("looking for ties", 0.87)
        final, ties = with_ties(final, possible, question)
    named = name_effects(found, base, final, ties, held_out)
    tell("what is left", 0.9)
    kept = final if verdict in ("explained", "nothing missing") else base
    rests = [] if verdict in ("explained", "nothing missing") else what_is_left(lines, question)
    lines = attributed(lines, named, rests)
    learned = []
    if rests:
        tell("learned term", 0.93)
        grown = learned_fit(rests[0], machine, known, base, question, held_out)
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
        fit_question=question,
        validate_question=held_out,
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


def simulated_search(base: Fit, possible: list[Candidate], question: Question, tell: Progress) -> Search:
    """The search with simulated columns: on the opening seconds where they lack something, on the whole runs otherwise."""

    def tick(step: str) -> None:
        tell(step, 0.7)

    head = question.head(rules.TRIAGE_S)
    if head is question or at_floor(cut(base, question, head).misfit):
        return search(base, possible, question, tick, least_gain=rules.LEAST_GAIN_SIMULATED)
    opening = refine(start_fit_at(base, head), head, fresh=True, relative=rules.BASE_TOLERANCE)
    found = search(opening, possible, head, tick, least_gain=rules.LEAST_GAIN_SIMULATED)
    rivals = simulated_rivals(found, question, tick)
    stages = [replace(stage, rivals=[]) for stage in found.stages]
    if rivals:
        stages[-1].rivals = rivals
    return replace(found, base=base, best=rivals[0] if rivals else base, stages=stages)


def refitted_base(start: Fit, question: Question, held_out: Question) -> tuple[Fit, Question, Question]:
    """The declared machine refitted, and the questions with what no simulation can know about it."""
    first = unknowable(question, start.fitted_machine())
    base = refine(start_fit_at(start, first), first, fresh=True, relative=rules.BASE_TOLERANCE)
    question, held_out = (unknowable(q, base.fitted_machine()) for q in (question, held_out))
    return refine(start_fit_at(base, question), question, fresh=True, relative=rules.BASE_TOLERANCE), question, held_out


def seen_from_itself(
    final: Fit, base: Fit, question: Question, held_out: Question
) -> tuple[Fit, Fit, Question, Question]:
    """A hypothesis near the noise judged by what no simulation can know about itself, if that brings it there.

    A delay or more static friction makes the same disturbances move the machine further than they move the declared one.
    """
    if not final.candidates or at_floor(final.misfit) or final.reduced > rules.NEAR_FLOOR:
        return final, base, question, held_out
    own, own_held_out = (unknowable(q, final.fitted_machine()) for q in (question, held_out))
    fit = pruned(refine(start_fit_at(final, own), own, fresh=True), own)
    if not at_floor(fit.misfit):
        return final, base, question, held_out
    return fit, refine(start_fit_at(base, own), own, fresh=True, relative=rules.BASE_TOLERANCE), own, own_held_out


def add_experiments(result: TraceResult) -> None:
    """For every tie the motion that would separate it, as a scenario file."""
    for k, effect in enumerate(result.effects):
        for label, rival in result.ties[k].items():
            names = (effect.candidate.label, label)
            found = experiment_for(result.final, rival, names, result.fit_question.noise)
            result.scenarios[found.file_name] = found.text()
            says = found.tables["says"]
            result.experiments.append(
                {
                    "effects": list(names),
                    "file": found.file_name,
                    "says": says[0].upper() + says[1:],
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


def judged(base: Fit, final: Fit, question: Question, held_out: Question) -> tuple[Verdict, Fit]:
    """Verdict on the last hypothesis: its rest is noise in the fit runs, and it helps in every held-out run."""
    if not final.candidates:
        return ("nothing missing", base) if at_floor(base.misfit) else ("unexplained", base)
    if at_floor(base.misfit) and base.chi2 - final.chi2 < rules.alarm(final.n) * scale_of(final):
        return "nothing missing", base
    helps = base.chi2 - final.chi2 > rules.alarm(final.n) * scale_of(final)
    if helps and at_floor(final.misfit) and all(gain > 0 for gain in held_out_gains(final, base, held_out)):
        return "explained", final
    return ("nothing missing" if at_floor(base.misfit) else "unexplained"), base


def what_is_left(lines: Sequence[Violation], question: Question) -> list[Rest]:
    """The violated balances with their dependence, the worst first; the worst of all when none is above its null."""

    def rank(line: Violation) -> float:
        above = line.violation / max(line.null, 1.0)
        return above + 1e6 * (line.name == "sensor" and above > rules.SENSOR_FIRST)

    worst = sorted(lines, key=rank, reverse=True)
    chosen = [line for line in worst if line.violated] or worst[:1]
    rests, seen = [], set()
    for line in chosen:
        balance = balance_named(line.name, question.logs[0])
        if (line.name, line.where.split()[0]) in seen and line.name == "platform":
            continue
        seen.add((line.name, line.where.split()[0]))
        rests.append(rest_of(balance, line, question.logs))
    return rests


def attributed(lines: list[Violation], named: Sequence[NamedEffect], rests: Sequence[Rest]) -> list[Violation]:
    """The continuity of a leg also as its valve balance: r_Q is the valve's when what explains it is the valve's."""
    out = []
    for line in lines:
        if line.name != "continuity":
            out.append(line)
            continue
        here = [e for e in named if e.candidate.where in (line.where, "all legs")]
        valve = any(e.candidate.effect.balance == "valve" for e in here)
        valve |= any(rest.balance == "valve" and rest.violation.where == line.where for rest in rests)
        own = not valve or any(e.candidate.effect.balance == "continuity" for e in here)
        quiet = replace(line, rms=min(line.rms, line.sigma * line.null))
        out.append(line if own else quiet)
        out.append(replace(line if valve else quiet, name="valve"))
    return out


def name_effects(
    found: Search, base: Fit, final: Fit, ties: Sequence[dict[str, Fit]], held_out: Question
) -> list[NamedEffect]:
    """Every effect of an explained hypothesis with its evidence."""
    if not ties:
        return []
    gains = tuple(held_out_gains(final, base, held_out))
    return [_named(found, base, final, k, tuple(tied), gains) for k, tied in enumerate(ties)]


def _named(
    found: Search, base: Fit, final: Fit, k: int, tied: tuple[str, ...], gains: tuple[float, ...]
) -> NamedEffect:
    candidate = final.candidates[k]
    lines = [line for stage in found.stages for line in stage.lines if line.candidate.label == candidate.label]
    gain = base.chi2 - final.chi2
    count = sum(len(c.free()) for c in final.candidates)
    return NamedEffect(
        candidate=candidate,
        values=final.values[k],
        standard_errors=final.standard_errors()[k],
        tied_with=tied,
        gain_chi2=gain,
        gain_cv=lines[0].gain_cv if lines else float("nan"),
        blocks=lines[0].blocks if lines else 0,
        d_bic=float(-gain + count * np.log(final.n)),
        held_out=gains,
        single_leg=final.machine.n_legs == 1,
    )
