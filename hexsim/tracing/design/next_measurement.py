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

from hexsim.errors import HexsimError
from hexsim.scenarios.scenario import Scenario, scenario_from_dict
from hexsim.tracing import rules
from hexsim.tracing.design.ceiling import Ceiling, ceiling_of
from hexsim.tracing.design.information import KNOWING, Number, OpenRefits, Promise, hypothesis
from hexsim.tracing.design.motions import MotionFamily
from hexsim.tracing.design.rest import OpenRest, labels_of, open_rest
from hexsim.tracing.design.words import beside_one_term, cannot_tell, expected_words, purpose_of, with_the_sums
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import Fit, with_effects
from hexsim.tracing.fitting.fitted_numbers import totals_of
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.held_out import at_the_rest
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.state import Trace

Tell = Callable[[str, float], None]
Open = OpenRest | OpenRefits


@dataclass(frozen=True, kw_only=True, eq=False)
class NextMeasurement:
    """A motion with what it is for, what it is expected to give and what it cannot tell; what no motion tells."""

    tables: dict[str, Any]
    purpose: str
    promise: Promise
    numbers: tuple[Number, ...]
    cannot: tuple[str, ...]
    ceiling: Ceiling
    load_kg: float | None = None  # that is on the machine in this motion

    @property
    def scenario(self) -> Scenario:
        return scenario_from_dict(self.tables)

    @property
    def hangs_on(self) -> tuple[str, ...]:
        """Of each number the nuisance effect that its expected error hangs on, or "" (`believed.hangs_on`)."""
        return self.promise.hangs_on or ("",) * len(self.numbers)

    def text(self) -> str:
        """The scenario file; what is expected stands in its first lines."""
        lines = [f"# {line}" for line in self.lines()]
        return "\n".join([*lines, "", tomli_w.dumps(self.tables)])

    def lines(self) -> list[str]:
        """Purpose, expected separation and errors, and what it cannot tell."""
        found = [self.purpose]
        for (one, other), size in self.promise.separations.items():
            found.append(f"expected separation of {one} and {other}: {self.promise.words(size)}")
        for number, error, beside in zip(self.numbers, self.promise.errors, self.hangs_on, strict=True):
            found.append(expected_words(number, error, beside))
        if self.load_kg:
            found.append(
                f"put {self.load_kg:.4g} kg on it; its log: hexsim trace ... --load {self.load_kg:.4g} --loaded NAME"
            )
        return found + [f"it cannot tell {item}" for item in self.cannot]

    def to_json(self) -> dict[str, Any]:
        """What `report.json` says of it."""
        return {
            "purpose": self.purpose,
            "separations": [
                {"effects": list(pair), self.promise.measure: size, "separated": pair not in self.promise.tied}
                for pair, size in self.promise.separations.items()
            ],
            "numbers": [
                {
                    "effect": number.effect, "parameter": number.name, "value": number.value,
                    "standard_error": number.standard_error, "expected": error, "hangs_on": beside, "least": least,
                    "because": why,
                }
                for number, error, beside, least, why in zip(
                    self.numbers, self.promise.errors, self.hangs_on,
                    self.ceiling.errors, self.ceiling.declared, strict=True,
                )
            ],
            "information": self.promise.information,
            "load_kg": self.load_kg,
            "cannot": list(self.cannot),
            "scenario": self.tables,
        }  # fmt: skip


def next_measurement(
    trace: Trace, duration_s: float = rules.MOTION_S, tell: Tell | None = None, *, first: int = 4 * rules.FEW, rounds: int = 1,
    may_load: bool = True, largest: float = 1.0,
) -> NextMeasurement:  # fmt: skip
    """The motion of this length that tells most about what the trace has left open.

    first: motions tried at first; rounds: how often as many come from the best of them. may_load: the machine's additional
    mass may be asked for, where somebody can put it on. It is asked for where no effect is named: what is left at another
    load is another rest, and a cause has the same number in both. largest: share of the machine's limits to use.

    Raises HexsimError where no motion of the family can be simulated.
    """
    say = tell or (lambda doing, fraction: None)
    say("what is left open", 0.0)
    asked = what_is_open(trace)
    numbers = tuple(asked.first.numbers)
    wanted = worst(numbers) if len(asked.labels) == 1 else None
    may_load = may_load and trace.machine.load.additional_mass_kg is not None
    family = MotionFamily(
        trace.machine, duration_s, may_load and bool(numbers), must_load=may_load and not numbers, largest=largest
    )
    tried = _search(family, partial(_promise, family, asked), wanted, (first, rounds), say)
    if not tried:
        raise HexsimError(
            f"machine {trace.machine.name} with {asked.labels[0]} diverges in every motion inside its limits that was "
            "simulated: no motion can be designed from these numbers; check stroke and cushions, or measure any rich motion"
        )
    say("checking it by refits", 1.0)
    tables, found = checked(asked, contenders(tried), wanted, family)
    ceiling = ceiling_of(asked.first, [own.told for _, own in tried if own.told is not None])
    load_kg = trace.machine.load.additional_mass_kg if "machine" in tables else None
    if found.tied and not may_load:
        would = asked.with_load(heavier := rules.HEAVIER * trace.machine.load.carried_mass_kg)
        log = replace(family.log(tables), loaded=True)
        load_kg = heavier if set(found.tied) - set(would.checked(log, would.promise(log)).tied) else None
    apart = {pair: max(own.separations.get(pair, 0.0) for _, own in tried) for pair in found.tied}
    alike = load_kg is None and bool(apart) and max(apart.values()) < rules.SAME * found.needed
    purpose = purpose_of(tables, asked.labels, found, numbers, wanted, load_kg, ceiling, alike)
    purpose = beside_one_term(purpose, trace.effects)
    if wanted is not None:
        own = [c for c in trace.final.candidates if c.label == numbers[wanted].effect]
        purpose = with_the_sums(purpose, [total for c in own for total in totals_of(trace.final, c)])
    tables["description"] = purpose[:1000]
    return NextMeasurement(
        tables=tables,
        purpose=purpose,
        promise=found,
        numbers=numbers,
        cannot=cannot_tell(trace, found, numbers, ceiling),
        ceiling=ceiling,
        load_kg=load_kg if "machine" in tables else None,
    )


def checked(
    asked: Open, best: list[tuple[dict[str, Any], Promise]], wanted: int | None, family: MotionFamily
) -> tuple[dict[str, Any], Promise]:
    """The first of the best motions whose refits separate what it promises; else the one that they leave the most."""
    tried = []
    for tables, promised in best:
        tried.append((tables, asked.checked(family.log(tables), promised)))
        if tried[-1][1].tied == promised.tied:
            break
    return max(tried, key=lambda item: (-len(item[1].tied), _worth(item, wanted)))


def _worth(item: tuple[dict[str, Any], Promise], wanted: int | None) -> float:
    """What is made large: a load is work, and must bring something."""
    tables, promised = item
    return promised.worth(wanted) - (rules.TELLABLE if "machine" in tables else 0.0)


def what_is_open(trace: Trace) -> Open:
    """The hypotheses that the logs leave: in the balances where no model reaches the noise, else by simulation."""
    if in_the_balances(trace):
        assert trace.rest_problem is not None
        named = frozenset(effect.candidate.label for effect in trace.effects)
        return open_rest(standing(trace), named, trace.candidates, trace.rest_problem, trace.fit_problem)
    jobs = surviving(trace)
    problem = at_the_rest(trace.fit_problem, jobs[0][1])
    named = frozenset(effect.candidate.label for effect in trace.effects)
    if trace.verdict == "unexplained" and not jobs[0][1].candidates:
        jobs, named = [(jobs[0][0], with_small_realities(jobs[0][1], trace))], frozenset({""})
    return OpenRefits(
        hypotheses=tuple(
            hypothesis(label, fit, problem, named if k == 0 else frozenset()) for k, (label, fit) in enumerate(jobs)
        ),
        problem=problem,
    )


def in_the_balances(trace: Trace) -> bool:
    """Do the balances say what is open?"""
    return bool(trace.rest) and trace.verdict in ("partly", "unexplained")


def surviving(trace: Trace) -> list[tuple[str, Fit]]:
    """Hypotheses that the logs leave, the best first: of a tie its members, of an unexplained machine the best rivals.

    Of one whose channels are at their noise and follow a signal all the same, none: no effect is larger than that.
    """
    if in_the_balances(trace):
        named = frozenset(effect.candidate.label for effect in trace.effects)
        rest = standing(trace)
        return list(zip(labels_of(rest, named), (one.fit for one in rest), strict=True))
    effects = [effect.candidate.label for effect in trace.effects]
    found = [(" and ".join(effects) or _label(trace.final), trace.final)]
    for tied in trace.ties:
        found += [(label, rival) for label, rival in tied.items() if label not in other_names(trace)]
    if trace.verdict == "unexplained" and not trace.predicted:
        rivals = [rival for stage in trace.search.stages for rival in stage.rivals]
        rivals = sorted(rivals, key=lambda rival: rival.chi2)[: rules.FEW]
        found = [(_label(rival), rival) for rival in rivals] or found
    unique = dict(reversed(found))
    return [(label, unique[label]) for label in dict(found)]


def other_names(trace: Trace) -> set[str]:
    """Labels that are a named effect's term under another name: nothing is to be told apart there."""
    return {own.candidate.label for effect in trace.effects for own in effect.readings}


def standing(trace: Trace) -> tuple[RestFit, ...]:
    """The hypotheses of the balances, one term under one name."""
    others = other_names(trace)
    return trace.rest[:1] + tuple(
        one for one in trace.rest[1:] if not others & {candidate.label for candidate in one.fit.candidates}
    )


def with_small_realities(fit: Fit, trace: Trace) -> Fit:
    """The machine with a little of what any machine has beside it: a motion that knows these shows what is hidden."""
    for candidate in rest_level.ordinary_effects(trace.candidates):
        start = rules.START if np.isinf(candidate.effect.parameters[0].neutral) else 0.0
        fit = with_effects(fit, [candidate], start, trace.fit_problem)
    return replace(fit, columns=None, covariance=None)


def _label(fit: Fit) -> str:
    return " and ".join(candidate.label for candidate in fit.candidates) or "the declared machine"


def worst(numbers: tuple[Number, ...]) -> int | None:
    """Place of the number with the largest relative error; None where all are sharp or there is none."""
    if not numbers:
        return None
    place = int(np.argmax([np.nan_to_num(number.relative, nan=np.inf) for number in numbers]))
    return place if numbers[place].relative > KNOWING.sharp else None


def _promise(family: MotionFamily, asked: Open, point: np.ndarray) -> tuple[dict[str, Any], Promise] | None:
    tables = family.scenario(point)
    if tables is None:
        return None
    return tables, asked.promise(family.log(tables))


def _search(
    family: MotionFamily,
    judge: Callable[[np.ndarray], tuple[dict[str, Any], Promise] | None],
    wanted: int | None,
    size: tuple[int, int],
    say: Tell,
) -> list[tuple[dict[str, Any], Promise]]:
    """All motions that differential evolution tries from `MotionFamily.first_points`, the best first."""
    kept: list[tuple[float, tuple[dict[str, Any], Promise]]] = []
    tried, (first, rounds) = 0, size

    def cost(point: np.ndarray) -> float:
        nonlocal tried
        tried += 1
        say("designing the next measurement", tried / (first * (rounds + 1)))
        found = judge(point)
        worth = -np.inf if found is None else _worth(found, wanted)
        if found is None or not np.isfinite(worth):
            return 1e9
        kept.append((worth, found))
        return -worth

    # scipy's stubs know neither of the two.
    settings: dict[str, Any] = {"init": family.first_points(first), "workers": in_parallel}
    differential_evolution(
        cost, family.bounds, integrality=family.integrality, maxiter=rounds, polish=False, rng=0, updating="deferred",
        tol=0.0, **settings,
    )  # fmt: skip
    return [item for _, item in sorted(kept, key=lambda item: -item[0])]


def contenders(ranked: list[tuple[dict[str, Any], Promise]]) -> list[tuple[dict[str, Any], Promise]]:
    """The best with a load and the best without, and the next best."""
    loaded = ["machine" in tables for tables, _ in ranked]
    firsts = {loaded.index(own) for own in set(loaded)}  # the best with a load, and the best without
    places = sorted(firsts | set(range(len(ranked))), key=lambda k: (k not in firsts, k))[: rules.FEW]
    return [ranked[k] for k in sorted(places)]
