"""The state of a trace: what it knows so far. Every step takes one and gives the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hexsim.machine import Machine
from hexsim.tracing import rules
from hexsim.tracing.checks.finding import Finding
from hexsim.tracing.dependence import Dependence
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.fitting.rest_hidden import Hidden
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.fitting.screening import Screened
from hexsim.tracing.fitting.selection import Search
from hexsim.tracing.predictable import Predicted
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray
Verdict = Literal["explained", "partly", "unexplained", "nothing missing"]
Tell = Callable[[str], None]  # what a long step is at, for the progress bar


@dataclass(frozen=True, kw_only=True, eq=False)
class Violation:
    """One balance at one place: its residual against the sensors' noise and against runs of the model."""

    name: str
    where: str
    place: int  # row of the balance's residual
    unit: str
    rms: float
    sigma: float
    null: float  # largest rms of the null runs over sigma
    machine: Machine  # with the balance's own fit
    all_sigma: Array  # of every row of the balance

    @property
    def violation(self) -> float:
        return self.rms / self.sigma

    @property
    def above_null(self) -> float:
        """Times the largest null run."""
        return self.violation / max(self.null, 1.0)

    @property
    def violated(self) -> bool:
        return self.above_null > rules.VIOLATED


@dataclass(frozen=True, kw_only=True, eq=False)
class UnexplainedResidual:
    """A balance that stays violated: its residual and what it depends on."""

    violation: Violation
    balance: str
    dependence: Dependence


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Another name of one and the same term of the balances, with the number that does the same."""

    candidate: Candidate
    values: dict[str, float]
    standard_errors: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect of the final hypothesis with what speaks for it."""

    candidate: Candidate
    values: dict[str, float]
    standard_errors: dict[str, float]
    tied_with: tuple[str, ...]
    gain_cv: float
    blocks: int
    d_bic: float
    held_out: tuple[float, ...] = ()  # fall of chi2 in each held-out run
    single_leg: bool = False
    share: float = float("nan")  # of the rest's mean square that it takes, of a machine that no model fits
    readings: tuple[Reading, ...] = ()  # of the ties those that no log takes apart from it

    @property
    def apart(self) -> tuple[str, ...]:
        """Ties that another log may take apart from it."""
        one = {own.candidate.label for own in self.readings}
        return tuple(label for label in self.tied_with if label not in one)


@dataclass(frozen=True, kw_only=True)
class StepRecord:
    """A step that ran: its name, its wall time, and what it decided in one sentence."""

    name: str
    seconds: float
    sentence: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """What is known. Before a step has spoken its fields are empty, and the verdict is "unexplained".

    base: the declared machine refitted; final: the best hypothesis, base itself where no effect helps.
    screening, screened: the first round over the library and the number of residuals that it looked at.
    hidden: effect -> the size below which what is left hides it, and beside what, of a machine that no model fits.
    rest: of such a machine the hypotheses that its balances leave, the best first; of `rest_problem`.
    refused: effects that the balances or the fit runs ask for, and that make a held-out channel worse: a sentence each.
    predicted: rests that follow a signal though each sample of them is as small as noise.
    ties: an effect of `final` -> label -> the hypothesis that does as well.  decided: the last step's sentence.
    """

    machine: Machine
    fit_problem: SimulatedProblem
    validate_problem: SimulatedProblem
    findings: dict[str, list[Finding]]
    base: Fit
    final: Fit
    search: Search
    verdict: Verdict = "unexplained"
    violations: list[Violation] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)
    balance_problem: BalanceProblem | None = None
    screening: list[Screened] = field(default_factory=list)
    screened: int = 0
    hidden: dict[str, Hidden] = field(default_factory=dict)
    rest: tuple[RestFit, ...] = ()
    rest_problem: BalanceProblem | None = None
    refused: tuple[str, ...] = ()
    predicted: tuple[Predicted, ...] = ()
    ties: list[dict[str, Fit]] = field(default_factory=list)
    effects: list[NamedEffect] = field(default_factory=list)
    unexplained: list[UnexplainedResidual] = field(default_factory=list)
    learned: list[dict[str, Any]] = field(default_factory=list)
    experiments: list[dict[str, Any]] = field(default_factory=list)
    scenarios: dict[str, str] = field(default_factory=dict)
    error: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    budget: list[dict[str, Any]] = field(default_factory=list)
    steps: tuple[StepRecord, ...] = ()
    decided: str = ""
    report: dict[str, Any] = field(default_factory=dict)

    @property
    def fitted(self) -> Machine:
        """The machine that the trace ends with: parameters refitted, effects added."""
        return self.final.fitted_machine()


@dataclass(frozen=True, kw_only=True)
class Step:
    """One row of docs/tracing.md. doing: what the progress bar says; share: of the time of a usual trace."""

    name: str
    doing: str
    share: float
    run: Callable[[Trace, Tell], Trace]
