"""Of a machine that no hypothesis brings to the noise: the effects that are sure all the same, and what is left beside them.

The balances decide, each in units of its own rest, with the nuisance effects of any machine fitted beside (`rest_level`).
An effect is named if all of this holds (docs/tracing.md):

    share        it takes much of the mean square of the rest, or brings its own balance to the noise
    own          most of what it takes lies in its own balance
    unseen       it does so on the held-out runs
    harmless     a sensor's effect makes no other row worse
    rivals       effects that do as well within the blocks are a tie
    remarkable   it is larger than what any machine has of it
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import (
    Fit,
    coordinates_of,
    refine,
    start_fit,
    start_fit_at,
    with_effects,
    without_effect,
)
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds
from hexsim.tracing.fitting.rest_evidence import Evidence, evidence_of, sure
from hexsim.tracing.fitting.rest_hidden import Hidden, hidden_of
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.fitting.rest_priors import acts_late, effects_of, least_remarkable
from hexsim.tracing.fitting.screening import columns_of
from hexsim.tracing.fitting.selection import inert, residual_at_noise_level
from hexsim.tracing.held_out import at_the_rest, refused
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.state import Step, Tell, Trace
from hexsim.tracing.steps.balance_search import joint_problem, with_fast_rows
from hexsim.tracing.steps.verdict import held_out_gains, named_effect
from hexsim.tracing.steps.violations import own_machine

Array = np.ndarray
Job = tuple[float, Candidate, Array]  # what the column promises, the effect, the coordinates to begin with


def rivals_of(
    base: RestFit, possible: Sequence[Candidate], problem: BalanceProblem, named_already: bool
) -> tuple[list[RestFit], dict[str, Hidden]]:
    """The candidates whose columns promise most, each added to the base and refitted, the best first; and what is hidden.

    hidden: effect -> the size below which it would not be named beside this rest, and what covers it.
    """
    asked: dict[str, Job] = {}
    hidden: dict[str, Hidden] = {}
    for candidate, own in zip(possible, columns_of(base.fit, list(possible), problem), strict=True):
        if not all(np.all(np.isfinite(column)) for column in own):
            continue
        job, covered = promise_of(base, candidate, own, problem)
        if covered is not None:
            hidden.setdefault(candidate.effect.name, covered)
        if job[0] > asked.get(candidate.label, (-np.inf,))[0]:
            asked[candidate.label] = job
    jobs = worth_a_refit(list(asked.values()), bending=not named_already)
    least = rules.MAIN * least_fall(problem)

    def tried_with(job: Job) -> RestFit | None:
        promised, candidate, start = job
        begins = -least_fall(problem) if promised > least else least  # a promise may begin with a loss
        return rest_level.begun_with(base, candidate, problem, start, begins, max(promised, least))

    slow = rest_level.cost_of(base.fit, problem.slow_alone())
    begun = [(slow - own.cost, own) for own in in_parallel(tried_with, jobs) if own is not None]
    contend = rules.MAIN * max((fall for fall, _ in begun), default=0.0)  # of what falls less, no more is asked
    tried = in_parallel(lambda own: rest_level.ended(base, own[1], problem, own[0] > contend), begun)
    acting = [rival for rival in tried if not inert(rival.fit, problem)]
    return sorted(acting, key=lambda rival: rival.cost), hidden


def promise_of(
    base: RestFit, candidate: Candidate, own: Sequence[Array], problem: BalanceProblem
) -> tuple[Job, Hidden | None]:
    """What a candidate promises and the coordinates that its column asks for; what the rest hides of it.

    A column tells little of a delay that is much longer than its step: its typical size is asked besides.
    """
    number, slow = candidate.effect.parameters[0], problem.slow_alone()
    bare, columns = rest_level.without_nuisance(base, candidate)
    grown = [np.concatenate([X, x[None]]) for X, x in zip(columns, own, strict=True)]
    system, bounds = rest_level.weighted_system(bare, grown, problem), coordinate_bounds(number)
    start, fall = rest_level.newton_step(bare, system, bounds)
    if slow is not problem:
        alone, promised = rest_level.newton_step(bare, rest_level.weighted_system(bare, grown, slow), bounds)
        start, fall = (alone, promised) if promised > fall else (start, fall)
    here = np.append(coordinates_of(bare), 0.0)
    start = here + (start - here) * min(1.0, rules.LARGEST_START / max(abs(start[-1]), 1e-9))
    start[-1] = start[-1] or 0.1
    if acts_late(candidate):
        typical = np.append(here[:-1], rest_level.STARTS[0])
        left = rest_level.cost_of(rest_level.initialise(bare, candidate, typical, problem), slow)
        promised = rest_level.cost_of(base.fit, slow) - left
        start, fall = (typical, promised) if promised > fall else (start, fall)
    return (fall, candidate, start), hidden_of(bare, system[0], candidate, least_fall(problem))


def worth_a_refit(asked: Sequence[Job], bending: bool) -> list[Job]:
    """Those whose columns promise most. bending: before them, each effect whose column tells little, at its best place."""
    ranked = sorted(asked, key=lambda job: -job[0])
    first: dict[str, Job] = {}
    for job in ranked:
        if bending and np.isinf(job[1].effect.parameters[0].neutral):
            first.setdefault(job[1].effect.name, (np.inf, *job[1:]))
    labels = {candidate.label for _, candidate, _ in first.values()}
    others = [job for job in ranked if job[1].label not in labels]
    return [*first.values(), *others][: 4 * rules.FEW]


def least_fall(problem: BalanceProblem) -> float:
    """Fall of J by an effect that takes the least share."""
    return -rest_level.independent(problem) * float(np.log(1.0 - rules.EXPLAINS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sure:
    """What `sure_effects` found. tried: the evidence for every effect that was judged, sure or not, a round a list.

    hidden: effect -> what the rest hides of it.  left: hypotheses that stay beside `best`: ties of what is named,
    each with what was named after it, or where nothing is named the rivals that come nearest to it.
    """

    best: RestFit
    left: list[RestFit]
    named: list[Evidence]
    tried: list[list[Evidence]]
    hidden: dict[str, Hidden]
    problem: BalanceProblem


def grown_by_one(
    base: RestFit, trace: Trace, problem: BalanceProblem, unseen: BalanceProblem
) -> tuple[RestFit | None, list[Evidence], dict[str, Hidden], list[RestFit]]:
    """The base with the next sure effect, or None; the evidence for what was judged, that of the sure one last; `hidden`;
    the rivals that stay."""
    there = {c.label for c in effects_of(base.fit)}
    possible = [c for c in trace.candidates if c.label not in there]
    begun, hidden = rivals_of(base, possible, problem, bool(there))
    rivals = contenders(begun, base, problem)
    standing = [own for own in rivals[: rules.FEW] if base.cost - own.cost >= rules.MAIN * least_fall(problem)]
    if not standing:
        return None, [], hidden, []
    rival, tried = standing[0], [evidence_of(base, standing[0], rivals, problem, unseen)]
    if not sure(tried[0]):
        return None, tried, hidden, standing
    tie = [own for own in rivals if label_of(own) in (*tried[0].tied, label_of(rival))]
    likeliest = min(tie, key=lambda own: likelihood(own, unseen)) if len(tie) > 1 else rival
    if likeliest is not rival:
        own = evidence_of(base, likeliest, rivals, problem, unseen)
        rival, tried = (likeliest, [*tried, own]) if sure(own) else (rival, tried)
    return rival, tried, hidden, [other for other in rivals if label_of(other) in tried[-1].tied][: rules.FEW]


def propagate(tie: RestFit, best: RestFit, problem: BalanceProblem) -> RestFit | None:
    """A tie of an earlier effect with the effect that `best` has got since."""
    own, size = best.fit.candidates[-1], rest_level.size_of(best.fit)
    if own.label in {c.label for c in effects_of(tie.fit)}:
        return None
    return rest_level.with_effect(tie, own, problem, size)


def label_of(rival: RestFit) -> str:
    return rival.fit.candidates[-1].label


def likelihood(rival: RestFit, unseen: BalanceProblem) -> tuple[bool, bool, float]:
    """Of a tie the first: what any machine has so much of, a physical cause, then what leaves least of all runs.

    What a nuisance effect of ordinary size does as well is fitted and not named.
    """
    candidate = rival.fit.candidates[-1]
    small = candidate.effect.name in rules.ORDINARY and abs(rest_level.size_of(rival.fit)) < least_remarkable(candidate)
    left = rival.cost + rest_level.cost_of_rows(start_fit_at(rival.fit, unseen), unseen)
    return not small, candidate.effect.generic, left


def contenders(rivals: Sequence[RestFit], base: RestFit, problem: BalanceProblem) -> list[RestFit]:
    """The rivals, the best of them refitted with all columns anew: what stands beside an effect decides between two.

    Beside what acts late, begun without the small spool too: with each effect a part of a delay may pass into one.
    """
    best = max((base.cost - rival.cost for rival in rivals), default=0.0)
    least = max(rules.MAIN * least_fall(problem), rules.MAIN * best)
    near = [rival for rival in rivals[: rules.FEW] if base.cost - rival.cost > least]
    late = (rest_level.without_lag(rival, problem) for rival in near if any(map(acts_late, effects_of(rival.fit))))
    begun = [*near, *(own for own in late if own is not None)]
    anew = in_parallel(lambda rival: rest_level.renewed(rival, problem), begun)
    better = [
        min((rival, *(own for own in anew if label_of(own) == label_of(rival))), key=lambda found: found.cost)
        for rival in near
    ]
    return sorted([*better, *rivals[len(near) :]], key=lambda rival: rival.cost)


def is_sensor_lag(candidate: Candidate, found: Sequence[Evidence], beside: Fit | None = None) -> bool:
    """Is it the gain of a sensor that is late? A filter is late and damps; how much of it is gain no run says.

    beside: the fit with its nuisance effects. An accelerometer that is late by a part of a sample damps the oil's own motion
    too, and against it the position's gain says the same as its own.
    """
    late = candidate.effect.name.removesuffix("_gain") + "_delay"
    if any((own.candidate.effect.name, own.candidate.where) == (late, candidate.where) for own in found):
        return True
    return candidate.effect.name in ("accelerometer_gain", "position_gain") and any(
        own.effect.name == "accelerometer_delay" and values["delay_s"] > rules.CLOCK_S
        for own, values in (zip(beside.candidates, beside.values, strict=True) if beside else ())
    )


def beside_its_own(found: RestFit, legs: Sequence[str], small: Sequence[Candidate], problem: BalanceProblem) -> RestFit:
    """A hypothesis refitted with nuisance effects of these legs alone, besides what all legs share of them.

    A leg's own null offset does a part of what a leak in that leg does. Only what adds up: two spools in a row are none.
    """
    there = {c.label for c in found.fit.candidates}
    adding = [c for c in small if c.effect.places == "leg" and np.isfinite(c.effect.parameters[0].neutral)]
    own = [alone for leg in legs for c in adding if (alone := replace(c, where=leg)).label not in there]
    return rest_level.refined(with_effects(found.fit, own, 0.0, problem), problem) if own else found


def beside_small(trace: Trace) -> tuple[RestFit, BalanceProblem, BalanceProblem]:
    """The declared machine with its nuisance effects, refitted; the balances of the fit runs and those of the held-out ones."""
    machine = own_machine(trace.machine, trace.violations)
    problem, unseen = (
        with_fast_rows(joint_problem(runs, trace.violations, machine), runs, machine)
        for runs in (trace.fit_problem, trace.validate_problem)
    )
    small = rest_level.ordinary_effects(trace.candidates)
    bare = start_fit(trace.machine, trace.base.priors, problem)
    return rest_level.start_rest_fit(bare, small, problem), problem, unseen


def sure_effects(trace: Trace, tell: Tell) -> Sure:
    """Forward selection at the level of the rest; nothing named where nothing is sure."""
    best, problem, unseen = beside_small(trace)
    found: list[Evidence] = []
    rounds: list[list[Evidence]] = []
    hidden: dict[str, Hidden] = {}
    left: list[RestFit] = []
    while len(found) < rules.MOST_EFFECTS and len(rounds) < 2 * rules.MOST_EFFECTS:
        tell(f"looking for sure effects, {len(found)} found")
        grown, tried, hidden, stay = grown_by_one(best, trace, problem, unseen)
        rounds.append(tried)
        if grown is None:
            left = left if found else stay
            break
        best, own = grown, tried[-1]
        left = [more for one in left if (more := propagate(one, best, problem))] + (
            stay if own.remarkable > 1.0 else []
        )
        if own.remarkable > 1.0:
            found += [] if is_sensor_lag(own.candidate, found, best.fit) else [own]
        elif found:
            break  # effects come in the order of what they take: what is left takes less than what any machine has
    small = rest_level.ordinary_effects(trace.candidates)
    legs = sorted({own.candidate.where for own in found if own.candidate.where.startswith("leg")})
    best, *left = in_parallel(lambda one: beside_its_own(one, legs, small, problem), [best, *left])
    return Sure(best=best, left=left, named=found, tried=rounds, hidden=hidden, problem=problem)


def name_the_sure(trace: Trace, tell: Tell) -> Trace:
    """Verdict `partly` where an effect is sure: the machine with it and with its nuisance effects."""
    if residual_at_noise_level(trace.final.misfit) or not trace.violations:
        return replace(trace, decided="not needed: nothing but noise is left")
    found = sure_effects(trace, tell)
    rest = (found.best, *found.left) if found.named else (*found.left, found.best)
    trace = replace(trace, hidden=found.hidden, rest=rest, rest_problem=found.problem)
    if not found.named:
        return replace(trace, decided="no effect is sure beside what is left")
    fit = stated_of(found, trace)
    final = replace(start_fit_at(fit, trace.fit_problem), covariance=fit.covariance)
    final, named, said = named_by_simulation(final, found.named, trace, tell)
    trace = replace(trace, refused=(*trace.refused, *said))
    if not named:
        return replace(trace, decided="; ".join(said))
    gains = held_out_gains(final, trace.base, trace.validate_problem)
    effects = [
        named_effect(trace, final, own.candidate, own.tied, gains, share=own.share, unseen=own.unseen) for own in named
    ]
    words = "; ".join(f"{own.label} takes {own.share:.0%} of the rest, {own.unseen:.0%} held out" for own in named)
    decided = "; ".join((words, *said))
    return replace(trace, final=final, verdict="partly", effects=effects, ties=[{} for _ in effects], decided=decided)


def stated_of(found: Sure, trace: Trace) -> Fit:
    """What is named, with its errors; of a bench on which anything named acts late refitted `beside_own_samples`, where it can be
    simulated (of a hexapod each column would take a second)."""
    best, problem = found.best, found.problem
    if not trace.machine.is_hexapod and any(map(acts_late, effects_of(best.fit))):
        own = problem.beside_own_samples(trace.fit_problem)
        start = start_fit_at(best.fit, own)
        best, problem = (rest_level.refined(start, own), own) if np.isfinite(start.chi2) else (best, problem)
    return replace(best.fit, covariance=rest_level.covariance_of(best, problem, trace.candidates))


def named_by_simulation(
    final: Fit, named: Sequence[Evidence], trace: Trace, tell: Tell
) -> tuple[Fit, list[Evidence], list[str]]:
    """The machine and those of its effects that make no channel of a held-out run worse; and why the others are not named.

    The numbers of the balances are tried first. Where a channel grows the hypothesis is refitted by simulation, as the machine
    that it is held against was: a refit that leaves the balances' number is another machine, and names nothing.
    """
    kept, said = list(named), []
    while kept:
        if (no := harmed(final, kept, trace)) is None:
            return final, kept, said
        tell(f"refitting {kept[-1].label} by simulation")
        fitted = refit_beside_rest(final, trace)
        if alike(fitted, final, kept) and (no := harmed(fitted, kept, trace)) is None:
            return fitted, kept, said
        said.append(no[1])
        own = next(own for own in kept if own.candidate == final.candidates[no[0]])
        kept.remove(own)
        bare = without_effect(final, no[0])
        final = replace(start_fit_at(bare, trace.fit_problem), covariance=bare.covariance)
    return trace.base, [], said


def harmed(final: Fit, named: Sequence[Evidence], trace: Trace) -> tuple[int, str] | None:
    """The named effect of a machine that makes a held-out channel worse, and how; nuisance effects are none."""
    places = [final.candidates.index(own.candidate) for own in named]
    return refused(final, trace.base, trace.validate_problem, places)


def refit_beside_rest(final: Fit, trace: Trace) -> Fit:
    """The hypothesis refitted by simulation with every channel in units of what the refitted machine leaves of it.

    With noise as the unit the channel that is off most would be fitted at the cost of all others.
    """
    problem = at_the_rest(trace.fit_problem, trace.base)
    declared = replace(final, deviations=trace.base.deviations)
    starts = [start_fit_at(fit, problem) for fit in (final, declared)]
    start = min(starts, key=lambda fit: fit.chi2)
    fitted = refine(start, problem, steps=rules.FEW_STEPS, fresh=True, relative=rules.BASE_TOLERANCE, many=True)
    return replace(start_fit_at(fitted, trace.fit_problem), covariance=fitted.covariance)


def alike(fitted: Fit, final: Fit, named: Sequence[Evidence]) -> bool:
    """Has a refit by simulation kept the numbers of the named effects, within a tenth or three standard errors?"""
    for own in named:
        k = final.candidates.index(own.candidate)
        size, there = rest_level.size_of(fitted, k), rest_level.size_of(final, k)
        if abs(size - there) > max(rules.TELLABLE * abs(there), rules.ERRORS * coordinate_error(final, k)):
            return False
    return True


def coordinate_error(fit: Fit, k: int) -> float:
    """Standard error of the first number of an effect, as a coordinate; 0 where none is known."""
    if fit.covariance is None:
        return 0.0
    place = fit.places(k).start
    return float(np.sqrt(max(fit.covariance[place, place], 0.0)))


STEP = Step(name="sure effects", doing="looking for sure effects", share=0.15, run=name_the_sure)
