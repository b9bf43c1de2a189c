"""Hypotheses of the balances refitted by simulation: closed loop, all channels, down to the noise.

First on the opening seconds: what cannot reach the noise there is dropped. A hypothesis that comes near the noise is judged
with its own input uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, refine, start_fit_at
from hexsim.tracing.fitting.selection import (
    Search,
    Stage,
    Tick,
    cut,
    information,
    named_first,
    pruned,
    residual_at_noise_level,
)
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace
from hexsim.tracing.steps.balance_search import extend_search

Array = np.ndarray


def contenders(found: Search, after: int = 0) -> list[Fit]:
    """The hypotheses that go on: with fewer effects first, then the best and what balances cannot tell from it.

    after: only those with more effects.
    """
    k = len(found.best.candidates)
    if k <= after:
        return []
    rivals = [rival for stage in found.stages for rival in stage.rivals if len(rival.candidates) == k]
    fewer = [stage.rivals[0] for stage in found.stages[after : k - 1] if stage.rivals]
    gain = found.base.chi2 - found.best.chi2
    rivals = [rival for rival in rivals if rival.chi2 - found.best.chi2 < rules.TELLABLE * gain]
    return fewer + sorted(rivals, key=information)[: rules.FEW]


def simulated_rivals(
    found: Search,
    problem: SimulatedProblem,
    base: Fit,
    tick: Tick = lambda step: None,
    after: int = 0,
) -> list[Fit]:
    """The contenders of a search refitted by simulation, the best first; more effects only while fewer do not suffice.

    base: the declared machine as it is simulated, with its columns.
    """
    rivals: list[Fit] = []
    for rival in contenders(found, after):
        if any(residual_at_noise_level(r.misfit) for r in rivals if len(r.candidates) < len(rival.candidates)):
            break
        tick(f"simulating {' and '.join(c.label for c in rival.candidates)}")
        fitted = simulated_fit(rival, problem, base)
        rivals += [] if fitted is None else [fitted]
    return named_first(sorted(rivals, key=information))


def rivals_of_balances(found: Search, trace: Trace, tell: Tell) -> list[Fit]:
    """The same of the search in the balances, which goes on for one effect more only where fewer do not reach the noise."""
    rivals: list[Fit] = []
    after, more = 0, found
    while more is not None and len(more.best.candidates) > after:
        rivals += simulated_rivals(more, trace.fit_problem, trace.base, tell, after)
        after = len(more.best.candidates)
        more = None if any(residual_at_noise_level(r.misfit) for r in rivals) else extend_search(more, trace)
    return named_first(sorted(rivals, key=information))


def simulated_fit(rival: Fit, problem: SimulatedProblem, near: Fit) -> Fit | None:
    """A hypothesis of the balances refitted by simulation; None when it does not simulate or cannot reach the noise.

    What leaves too much of the opening seconds, fitted to them alone, leaves too much of the whole: that fit ends as soon as
    what its columns promise cannot bring it there, or as it is there. The whole is then
    fitted from there, or from the balances where that is nearer: opening seconds may hardly show an effect. A hypothesis
    that comes near is judged with the noise that the logged volts show, and by what no simulation can know about itself, not about the
    declared machine: a delay or more static friction makes the same disturbances move the machine further.
    near: a machine nearby: its columns of the declared parameters serve until they become poor.
    """
    head = problem.head(rules.OPENING_S)
    share = head.duration_s / problem.duration_s
    start = replace(start_fit_at(rival, head), columns=cut(near, problem, head).columns)
    if not np.isfinite(start.chi2):
        return None

    def worth(fit: Fit, promise: float) -> bool:
        there = residual_at_noise_level(fit.misfit, share)
        return not there and may_come_near(fit, rules.NEAR * promise, share)

    opening = refine(start, head, fresh=True, worth=worth)
    if not residual_at_noise_level(opening.misfit, share):
        if opening.reduced > rules.NEAR:
            return None
        own = head.with_known_volts().with_input_uncertainty(opening.fitted_machine())
        judged = replace(start_fit_at(opening, own), columns=own.reweighted(opening.columns, head))
        if judged.chi2 >= opening.chi2:  # its own inputs leave no more unknown
            return None
        opening = refine(judged, own, fresh=True, worth=worth)
        if not residual_at_noise_level(opening.misfit, share):
            return None
        known = problem.with_known_volts().with_input_uncertainty(opening.fitted_machine())
        whole = fitted_from((opening, rival), known, known.reweighted(near.columns, problem))
        if whole is None:
            return None
        columns = problem.reweighted(whole.columns, known)
        return replace(start_fit_at(whole, problem), covariance=whole.covariance, columns=columns)
    return fitted_from((opening, rival), problem, near.columns)


def may_come_near(fit: Fit, fall: float, share: float) -> bool:
    """May a fit of the opening seconds still reach the noise, or come near it, when chi2 can fall by so much?"""
    far = fit.reduced > rules.NEAR
    near = far and np.sqrt(fit.chi2) - np.sqrt(max(fall, 0.0)) < np.sqrt(rules.NEAR * fit.n)
    return near or residual_at_noise_level(fit.misfit, share, fall)


def fitted_from(fits: Sequence[Fit], problem: SimulatedProblem, columns: list[Array] | None) -> Fit | None:
    """The hypothesis refitted from the nearest of several fits of it; None when it does not simulate. columns: see `near`."""
    start = min((start_fit_at(fit, problem) for fit in fits), key=lambda fit: fit.chi2)
    return refine(replace(start, columns=columns), problem, stated=True) if np.isfinite(start.chi2) else None


def refit_with_own_input_uncertainty(trace: Trace) -> Trace:
    """A hypothesis near the noise judged with its own input uncertainty, if that brings it to the noise.

    A delay or more static friction makes the same disturbances move the machine further than they move the declared one.
    """
    final = trace.final
    if not final.candidates or residual_at_noise_level(final.misfit) or final.reduced > rules.NEAR:
        return trace
    own, held_out = (
        q.with_known_volts().with_input_uncertainty(final.fitted_machine())
        for q in (trace.fit_problem, trace.validate_problem)
    )
    fit = pruned(refine(start_fit_at(final, own), own, stated=True), own)
    if not residual_at_noise_level(fit.misfit):
        return trace
    base = refine(start_fit_at(trace.base, own), own, fresh=True, relative=rules.BASE_TOLERANCE)
    return replace(trace, final=fit, base=base, fit_problem=own, validate_problem=held_out)


def refit_hypotheses(trace: Trace, tell: Tell) -> Trace:
    """What the balances ask for, refitted by simulation; the best one is the hypothesis that goes on.

    Even where every channel is at the noise: an IMU that is turned by a degree stays below it in any one sample.
    """
    base, in_balances = trace.base, trace.search
    trace = replace(trace, search=Search(base=base, best=base, stages=[Stage(lines=trace.screening, rivals=[])]))
    if residual_at_noise_level(base.misfit) and not in_balances.best.candidates:
        return replace(trace, decided="not needed: the declared parameters alone reach the noise")
    rivals = rivals_of_balances(in_balances, trace, tell)
    trace.search.stages[0].rivals = rivals
    if not rivals:
        return replace(trace, decided="no effect that the balances ask for reaches the noise")
    if residual_at_noise_level(base.misfit) and base.chi2 - rivals[0].chi2 < rules.alarm(base.n):
        return replace(trace, decided="what the balances ask for takes nothing of the simulated runs")
    trace = refit_with_own_input_uncertainty(replace(trace, final=pruned(rivals[0], trace.fit_problem)))
    return replace(trace, decided=f"{hypothesis_words(trace.final)}: chi2 {trace.final.reduced:.3g} a sample")


def hypothesis_words(fit: Fit) -> str:
    """The effects of a hypothesis by their labels."""
    return " and ".join(candidate.label for candidate in fit.candidates) or "declared parameters alone"


STEP = Step(name="hypotheses", doing="refitting hypotheses by simulation", share=0.15, run=refit_hypotheses)
