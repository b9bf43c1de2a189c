"""Forward selection of effects: screen, try the best by simulation, keep one, look again; at most three.

The screening column is linear and the machine is not, so every candidate near the top is refitted by simulation: first
on the opening seconds of each run, then the survivors on all of it. What decides is the misfit after the refit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import (
    Fit,
    evaluate,
    parameter_columns,
    refine,
    start_fit_at,
    with_effects,
    without_effect,
)
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.fitting.screening import Screened, screen
from hexsim.tracing.problems.problem import FitProblem, in_parallel

Array = np.ndarray
Tick = Callable[[str], None]


@dataclass(kw_only=True)
class Stage:
    """One round of the selection: the screening table and the refitted rivals, best first."""

    lines: list[Screened]
    rivals: list[Fit]


@dataclass(kw_only=True)
class Search:
    """The way from the refitted declared machine to the last hypothesis."""

    base: Fit
    best: Fit
    stages: list[Stage] = field(default_factory=list)


def scale_of(fit: Fit) -> float:
    """What a unit of chi2 is worth: 1 where the model reaches the noise, more where it does not."""
    return max(fit.reduced, 1.0)


def shortlist(lines: list[Screened], scale: float, alarm: float) -> list[Screened]:
    """The best shape of each effect and place, those with a gain that could matter, at most twice FEW.

    The column of an effect with more than one number is taken at one shape and promises the least that a refit takes:
    FEW more of them, where anything reaches the alarm.
    """
    best: dict[str, Screened] = {}
    for line in lines:
        key = line.candidate.label
        if key not in best or line.gain_chi2 > best[key].gain_chi2:
            best[key] = line
    ranked = sorted(best.values(), key=lambda line: -line.gain_chi2)
    if not ranked or ranked[0].gain_chi2 <= alarm * scale:
        return []
    few = rules.TELLABLE * ranked[0].gain_chi2
    worth = [line for line in ranked if line.gain_chi2 > max(alarm * scale, few)][: 2 * rules.FEW]
    shaped = [line for line in ranked if line.gain_chi2 > few and len(line.candidate.free()) > 1 and line not in worth]
    return worth + shaped[: rules.FEW]


def bending(lines: list[Screened], listed: list[Screened]) -> list[Screened]:
    """Those whose gain no linear column tells, half a typical size to start with."""
    others = [line for line in lines if line.candidate.effect.nonlinear_response and line not in listed]
    return [replace(line, size=rules.START) for line in others]


def cut(fit: Fit, whole: FitProblem, part: FitProblem) -> Fit:
    """The fit as seen by the head of the logs: its misfit and columns, cut."""
    lengths = [log.n - whole.settle(i) for i, log in enumerate(part.logs)]
    misfit = [m[:, :n] for m, n in zip(fit.misfit, lengths, strict=True)]
    columns = None if fit.columns is None else [c[:, :, :n] for c, n in zip(fit.columns, lengths, strict=True)]
    chi2 = float(sum(np.sum(np.square(m)) for m in misfit))
    return replace(fit, misfit=misfit, columns=columns, chi2=chi2, n=sum(m.size for m in misfit))


def try_candidate(
    fit: Fit, candidate: Candidate, size: float, problem: FitProblem, steps: int, relative: float = 0.0
) -> Fit | None:
    """The fit with the candidate added at about this size and refined; None when no size of it simulates."""
    size = float(np.clip(size, -rules.LARGEST_START, rules.LARGEST_START)) or 0.1
    for shrink in (1.0, 0.3, 0.1, 0.03):
        grown = with_effects(fit, [candidate], size * shrink, problem)
        if np.isfinite(grown.chi2):
            return refine(grown, problem, steps=steps, relative=relative)
    return None


def advance(fit: Fit, candidates: list[Candidate], problem: FitProblem, tick: Tick, least_gain: float) -> Stage:
    """Screen about the fit and refit the best rivals. An effect comes once.

    About a hypothesis that holds the next effect's column shows most of what it does: where no column promises half of
    the least gain (a share of the excess chi2) nothing is refitted. Rivals are told apart by a share of a gain
    (`rules.TELLABLE`): no step of a refit that takes less than that of the least gain is made.
    """
    enough = rules.TELLABLE * least_gain
    there = {candidate.label for candidate in fit.candidates}
    candidates = [candidate for candidate in candidates if candidate.label not in there]
    if fit.columns is None:
        fit = parameter_columns(fit, problem)
    lines = screen(fit, candidates, problem, lambda n: tick("screening"))
    listed = shortlist(lines, scale_of(fit), rules.alarm(fit.n))
    promised = max((line.gain_chi2 for line in listed), default=0.0)
    if not listed or (fit.candidates and promised < rules.MAIN * least_gain * (fit.chi2 - fit.n)):
        return Stage(lines=lines, rivals=[])
    head = problem.head(rules.OPENING_S)
    short = cut(fit, problem, head)
    tick("refitting rivals")

    def tried_with(some: list[Screened]) -> list[Fit]:
        found = in_parallel(
            lambda line: try_candidate(short, line.candidate, line.size, head, rules.FEW_STEPS, enough), some
        )
        return [rival for rival in found if rival is not None]

    quick = tried_with(listed)
    if not fit.candidates:
        left = min((rival.chi2 / rival.n for rival in quick), default=np.inf)
        # air in a leg whose balances hold does not mend another's
        reaching = (line for line in bending(lines, listed) if fit.chi2 - line.reach <= rules.NEAR * left * fit.n)
        quick += tried_with(list(reaching))
    if not quick:
        return Stage(lines=lines, rivals=[])
    quick.sort(key=lambda rival: rival.chi2)
    near = [rival for rival in quick[: rules.FEW] if rival.chi2 <= rules.NEAR * quick[0].chi2]
    worth = may_leave(quick[0].chi2 + rules.TELLABLE * max(short.chi2 - quick[0].chi2, 0.0))  # else it is none
    tried = in_parallel(lambda rival: refine(rival, head, fresh=True, relative=enough, worth=worth), near)
    tried.sort(key=lambda rival: rival.chi2)
    if head is problem:
        return Stage(lines=lines, rivals=ranked(tried, head))
    finalists = [rival for rival in tried if rival.chi2 <= rules.NEAR * tried[0].chi2]
    rivals = in_parallel(
        lambda rival: refine(start_fit_at(rival, problem), problem, fresh=True, relative=enough), finalists
    )
    return Stage(lines=lines, rivals=ranked(rivals, problem))


def ranked(rivals: list[Fit], problem: FitProblem) -> list[Fit]:
    """Refitted rivals, the best first, those left out whose effect does nothing."""
    return named_first(sorted((rival for rival in rivals if not inert(rival, problem)), key=information))


def named_first(rivals: list[Fit]) -> list[Fit]:
    """Of a tie at the top, a physical cause before one that stands for any cause of its form."""
    for k, rival in enumerate(rivals):
        tie = information(rival) - information(rivals[0]) < rules.SIGNIFICANT * scale_of(rivals[0])
        if tie and not rival.candidates[-1].effect.generic:
            return [rival, *rivals[:k], *rivals[k + 1 :]]
    return rivals


def residual_at_noise_level(misfit: Sequence[Array], share: float = 1.0, fall: float = 0.0) -> bool:
    """Nothing but noise is left: every channel and its means over 25 and 400 samples (the latter loosely).

    share: of the run that the misfit is of; then the problem is whether the whole run can still be at the noise, the
    rest of it being no better than noise.  fall: of chi2 that may still come, all of it where it is wanted. A change whose
    sum of squares is that takes no more than its root from the root of any sum.
    """
    for m in misfit:
        for width, limit in rules.NOISE_WINDOWS:
            n = m.shape[1] // width
            means = m[:, : n * width].reshape(m.shape[0], -1, width).mean(axis=2) * np.sqrt(width)
            most = n * max(limit**2 - (1.0 - share), 0.0) / share
            if not np.all(np.sqrt(np.sum(means**2, axis=1)) - np.sqrt(max(fall, 0.0)) < np.sqrt(most)):
                return False
    return True


def pruned(fit: Fit, problem: FitProblem) -> Fit:
    """Without the effects that the others make superfluous; a refit that cannot come near enough ends early."""
    for k in range(len(fit.candidates) - 1, -1, -1):
        if len(fit.candidates) < 2 or not residual_at_noise_level(fit.misfit):
            break
        most = fit.chi2 + rules.alarm(fit.n) * scale_of(fit)
        less = refine(start_fit_at(without_effect(fit, k), problem), problem, fresh=True, worth=may_leave(most))
        if less.chi2 < most:
            fit = less
    return fit


def may_leave(most: float) -> Callable[[Fit, float], bool]:
    """For `refine`: may a fit whose next step promises so much still leave less than this chi2?"""
    return lambda fit, promise: np.sqrt(fit.chi2) - np.sqrt(rules.NEAR * max(promise, 0.0)) < np.sqrt(most)


def information(fit: Fit) -> float:
    """Bayes' information criterion: of two that do alike, the one with fewer numbers."""
    return fit.chi2 + float(np.log(fit.n)) * scale_of(fit) * sum(len(c.free()) for c in fit.candidates)


def inert(fit: Fit, problem: FitProblem, least: float = 1.0) -> bool:
    """Does the last effect stand where it does nothing? Then what helped was another part of it: the line of a pump whose
    largest flow no motion takes is a supply droop, and no tie of one. least: chi2 that it must be worth, at the noise."""
    size = fit.candidates[-1].effect.parameters[0]
    if not np.isinf(size.neutral):
        return False
    unbound = (*fit.values[:-1], fit.values[-1] | {size.name: size.bounds[1]})
    return evaluate(replace(fit, values=unbound), problem).chi2 - fit.chi2 < least * scale_of(fit)


def search(
    base: Fit,
    candidates: list[Candidate],
    problem: FitProblem,
    tick: Tick = lambda step: None,
    done: Callable[[Fit], bool] = lambda fit: residual_at_noise_level(fit.misfit),
    least_gain: float = rules.SLIGHT,
    most: int = rules.MOST_EFFECTS,
    begun: Search | None = None,
) -> Search:
    """From the refitted declared machine to at most so many effects, or until nothing is left to explain.

    begun: a search that `most` ended, which goes on.
    """
    found = begun or Search(base=base, best=base)
    while True:
        stage = advance(found.best, candidates, problem, tick, least_gain)
        found.stages.append(stage)
        if not stage.rivals:
            return found
        best = stage.rivals[0]
        excess = max(found.best.chi2 - found.best.n, rules.SIGNIFICANT)
        gain = found.best.chi2 - best.chi2
        if gain < rules.alarm(best.n) * scale_of(best) or gain < least_gain * excess:
            return found
        found.best = best
        if done(best) or len(best.candidates) >= most:
            return found
