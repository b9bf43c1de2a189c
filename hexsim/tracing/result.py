"""Everything a trace found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hexsim.machine import Machine
from hexsim.tracing.checks.finding import Finding
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.screening import Screened
from hexsim.tracing.fitting.selection import Search
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps.residuals import UnexplainedResidual
from hexsim.tracing.steps.verdict import NamedEffect, Verdict
from hexsim.tracing.steps.violations import Violation


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
    fit_problem: SimulatedProblem
    validate_problem: SimulatedProblem
    findings: dict[str, list[Finding]]
    detect_lines: list[Screened]
    detect_n: int
    unexplained: list[UnexplainedResidual] = field(default_factory=list)
    ties: list[dict[str, Fit]] = field(default_factory=list)  # an effect: label -> the hypothesis that does as well
    learned: list[dict[str, Any]] = field(default_factory=list)
    experiments: list[dict[str, Any]] = field(default_factory=list)
    scenarios: dict[str, str] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
