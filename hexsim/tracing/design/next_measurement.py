"""Design of the next measurement: what a trace has left open, and the motion that tells most about it.

A tie, or hypotheses of which none is good enough, are to be separated; else the worst number is to be sharpened; else
all numbers together. `scipy.optimize.differential_evolution` chooses among the motions of `motions.MotionFamily`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import tomli_w
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from hexsim.errors import HexsimError
from hexsim.scenarios.scenario import Scenario, scenario_from_dict
from hexsim.tracing import rules
from hexsim.tracing.design.information import (
    Hypothesis,
    Number,
    Promise,
    at_the_rest,
    hypothesis,
    loaded,
    promise,
    refitted_separation,
)
from hexsim.tracing.design.motions import MotionFamily
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import Fit, refine, start_fit_at
from hexsim.tracing.fitting.selection import try_candidate, with_candidate
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.state import NamedEffect, Trace
from hexsim.tracing.steps.experiments import heavier_load, setpoint_log

DURATION_s = 20.0
FIRST, ROUNDS = 16, 2  # motions tried at first, and rounds of as many that come from the best of them
CONTENDERS = 3  # of a machine that is not explained
SHARP = 0.1  # a number known to this share is sharp
SEPARATED = 4 * rules.TIE_CHI2  # least chi2 that separates two hypotheses
Tell = Callable[[str, float], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class NextMeasurement:
    """A motion with what it is for, what it is expected to give and what it cannot tell."""

    tables: dict[str, Any]
    purpose: str
    promise: Promise
    numbers: tuple[Number, ...]
    cannot: tuple[str, ...]

    @property
    def scenario(self) -> Scenario:
        return scenario_from_dict(self.tables)

    def text(self) -> str:
        """The scenario file; what is expected stands in its first lines."""
        lines = [f"# {line}" for line in self.lines()]
        return "\n".join([*lines, "", tomli_w.dumps(self.tables)])

    def lines(self) -> list[str]:
        """Purpose, expected separation and errors, and what it cannot tell."""
        found = [self.purpose]
        for (one, other), chi2 in self.promise.separations.items():
            found.append(f"expected separation of {one} and {other}: chi2 {chi2:.3g}")
        for number, error in zip(self.numbers, self.promise.errors, strict=True):
            now = f"{number.standard_error:.2g}"
            found.append(f"{number.effect} {number.name} = {number.value:.4g}: error {now} now, {error:.2g} expected")
        return found + [f"it cannot tell {item}" for item in self.cannot]

    def to_json(self) -> dict[str, Any]:
        """What `report.json` says of it."""
        return {
            "purpose": self.purpose,
            "separations": [
                {"effects": list(pair), "chi2": chi2} for pair, chi2 in self.promise.separations.items()
            ],
            "numbers": [
                {
                    "effect": number.effect, "parameter": number.name, "value": number.value,
                    "standard_error": number.standard_error, "expected": error,
                }
                for number, error in zip(self.numbers, self.promise.errors, strict=True)
            ],
            "information": self.promise.information,
            "cannot": list(self.cannot),
            "scenario": self.tables,
        }  # fmt: skip


def next_measurement(
    trace: Trace, duration_s: float = DURATION_s, tell: Tell | None = None, *, first: int = FIRST, rounds: int = ROUNDS,
    may_load: bool = True,
) -> NextMeasurement:  # fmt: skip
    """The motion of this length that tells most about what the trace has left open.

    first: motions tried at first; rounds: how often as many come from the best of them. may_load: a heavier load may be
    asked for, where somebody can put it on.

    Raises HexsimError where no motion of the family can be simulated.
    """
    say = tell or (lambda doing, fraction: None)
    say("what is left open", 0.0)
    jobs = surviving(trace)
    problem = at_the_rest(trace.fit_problem, jobs[0][1])
    named = frozenset(effect.candidate.label for effect in trace.effects)
    if trace.verdict == "unexplained" and not jobs[0][1].candidates:
        jobs, named = [(jobs[0][0], with_small_realities(jobs[0][1], trace))], frozenset({""})
    hypotheses = [
        hypothesis(label, fit, problem, named if k == 0 else frozenset()) for k, (label, fit) in enumerate(jobs)
    ]
    numbers = tuple(hypotheses[0].numbers)
    wanted = worst(numbers) if len(hypotheses) == 1 else None
    family = MotionFamily(trace.machine, duration_s)
    best = _search(family, partial(_promise, family, hypotheses, problem.noise), wanted, (first, rounds), say)
    if best is None:
        raise HexsimError(
            f"machine {trace.machine.name}: no motion inside its limits could be simulated; check stroke and cushions"
        )
    say("checking it by refits", 1.0)
    tables, found = checked(best[0], hypotheses, problem.noise)
    if may_load and found.separations and min(found.separations.values()) < SEPARATED:
        heavier = checked(best[0] | {"machine": heavier_load(trace.machine)}, hypotheses, problem.noise)
        tables, found = max((tables, found), heavier, key=lambda pair: min(pair[1].separations.values(), default=0.0))
    purpose = _purpose(tables, hypotheses, numbers, wanted)
    tables["description"] = purpose[:1000]
    return NextMeasurement(
        tables=tables, purpose=purpose, promise=found, numbers=numbers, cannot=_cannot(trace, found, numbers)
    )


def checked(
    tables: dict[str, Any], hypotheses: list[Hypothesis], noise: dict[str, float]
) -> tuple[dict[str, Any], Promise]:
    """The motion with what it promises, separations lowered to what a refit in this motion alone leaves of them."""
    own = [loaded(one, tables.get("machine", {})) for one in hypotheses]
    log = setpoint_log(own[0].fit.machine, tables)
    found, by_label = promise(own, log, noise), {one.label: one for one in own}
    separations = {
        pair: min(chi2, refitted_separation(by_label[pair[0]], by_label[pair[1]], log, noise))
        for pair, chi2 in found.separations.items()
    }
    return tables, replace(found, separations=separations)


def surviving(trace: Trace) -> list[tuple[str, Fit]]:
    """Hypotheses that the logs leave, the best first: of a tie its members, of an unexplained machine the best rivals."""
    effects = [effect.candidate.label for effect in trace.effects]
    found = [(" and ".join(effects) or _label(trace.final), trace.final)]
    for tied in trace.ties:
        found += [(label, rival) for label, rival in tied.items()]
    if trace.verdict == "partly":
        pairs = [(effect, label) for effect in trace.effects for label in effect.tied_with]
        found += [(label, rival) for effect, label in pairs if (rival := in_place_of(effect, label, trace))]
    if trace.verdict == "unexplained":
        rivals = [rival for stage in trace.search.stages for rival in stage.rivals]
        rivals = sorted(rivals, key=lambda rival: rival.chi2)[:CONTENDERS]
        found = [(_label(rival), rival) for rival in rivals] or found
    unique = dict(reversed(found))
    return [(label, unique[label]) for label in dict(found)]


def with_small_realities(fit: Fit, trace: Trace) -> Fit:
    """The machine with a little of what any machine has beside it: a motion that knows these shows what is hidden."""
    for candidate in rest_level.ordinary_effects(trace.candidates):
        start = rest_level.SPOOL_START if np.isinf(candidate.effect.parameters[0].neutral) else 0.0
        fit = with_candidate(fit, candidate, start, trace.fit_problem)
    return replace(fit, columns=None, covariance=None)


def in_place_of(effect: NamedEffect, label: str, trace: Trace) -> Fit | None:
    """The partly explained machine with another effect in the place of a named one, refitted; None where it cannot be.

    The balances have tied the two; their refits by simulation are made here.
    """
    own = [candidate for candidate in trace.candidates if candidate.label == label]
    k = trace.final.candidates.index(effect.candidate)
    head, problem = trace.fit_problem.head(rules.TRIAGE_S), trace.fit_problem
    there = [candidate.label for candidate in trace.final.candidates]
    gone = {k, there.index(label)} if label in there else {k}  # its small reality, too
    keep = [i for i in range(len(there)) if i not in gone]
    bare = replace(
        trace.final, candidates=tuple(trace.final.candidates[i] for i in keep), covariance=None,
        values=tuple(trace.final.values[i] for i in keep), columns=None,
    )  # fmt: skip
    start, jobs = start_fit_at(bare, head), [(candidate, size) for candidate in own[:1] for size in (-1.0, 1.0)]
    tried = in_parallel(lambda job: try_candidate(start, job[0], job[1], head, rules.TRIAGE_STEPS), jobs)
    best = min((fit for fit in tried if fit is not None), key=lambda fit: fit.chi2, default=None)
    return None if best is None else refine(start_fit_at(best, problem), problem, steps=rules.TRIAGE_STEPS)


def _label(fit: Fit) -> str:
    return " and ".join(candidate.label for candidate in fit.candidates) or "the declared machine"


def worst(numbers: tuple[Number, ...]) -> int | None:
    """Place of the number with the largest relative error; None where all are sharp or there is none."""
    if not numbers:
        return None
    place = int(np.argmax([np.nan_to_num(number.relative, nan=np.inf) for number in numbers]))
    return place if numbers[place].relative > SHARP else None


def _promise(
    family: MotionFamily, hypotheses: list[Hypothesis], noise: dict[str, float], point: np.ndarray
) -> tuple[dict[str, Any], Promise] | None:
    tables = family.scenario(point)
    if tables is None:
        return None
    return tables, promise(hypotheses, setpoint_log(family.machine, tables), noise)


def _search(
    family: MotionFamily,
    judge: Callable[[np.ndarray], tuple[dict[str, Any], Promise] | None],
    wanted: int | None,
    size: tuple[int, int],
    say: Tell,
) -> tuple[dict[str, Any], Promise] | None:
    """The best motion that differential evolution finds, from points spread by Sobol's sequence."""
    kept: list[tuple[float, tuple[dict[str, Any], Promise]]] = []
    tried, (first, rounds) = 0, size

    def cost(point: np.ndarray) -> float:
        nonlocal tried
        tried += 1
        say("designing the next measurement", tried / (first * (rounds + 1)))
        found = judge(point)
        worth = -np.inf if found is None else found[1].worth(wanted)
        if found is None or not np.isfinite(worth):
            return 1e9
        kept.append((worth, found))
        return -worth

    low, high = np.transpose(family.bounds)
    start = qmc.scale(qmc.Sobol(len(low), rng=0).random(first), low, high + 1e-9)
    settings: dict[str, Any] = {"init": start, "workers": in_parallel}  # scipy's stubs know neither
    differential_evolution(
        cost, family.bounds, integrality=family.integrality, maxiter=rounds, polish=False, rng=0, updating="deferred",
        tol=0.0, **settings,
    )  # fmt: skip
    return max(kept, key=lambda item: item[0])[1] if kept else None


def _purpose(
    tables: dict[str, Any], hypotheses: list[Hypothesis], numbers: tuple[Number, ...], wanted: int | None
) -> str:
    if len(hypotheses) > 1:
        load = f", with a load of {next(iter(tables['machine'].values())):.0f} kg" if "machine" in tables else ""
        return f"to separate {', '.join(one.label for one in hypotheses)}{load}"
    if wanted is not None:
        number = numbers[wanted]
        return f"to know {number.name} of {number.effect} better: {number.value:.3g} +- {number.standard_error:.1g} now"
    if hypotheses[0].fit.candidates and not numbers:
        return "to know all declared parameters better, and what any machine has a little of: no hypothesis is left"
    return "to know all declared parameters better: nothing is left to be told apart"


def _cannot(trace: Trace, found: Promise, numbers: tuple[Number, ...]) -> tuple[str, ...]:
    """What stays open after it."""
    said = [
        f"{one} from {other}: chi2 {chi2:.2g} of at least {SEPARATED:g} that are needed"
        for (one, other), chi2 in found.separations.items()
        if chi2 < SEPARATED
    ]
    for number, error in zip(numbers, found.errors, strict=True):
        if number.value and error > SHARP * abs(number.value):
            said.append(f"{number.name} of {number.effect} to better than {100 * error / abs(number.value):.0f} %")
    for rest in trace.unexplained:
        said.append(f"what the rest of the {rest.balance} balance in {rest.violation.where} is: no hypothesis names it")
    return tuple(said)
