"""The search by simulation: where the balances lead to no hypothesis at the noise, or see nothing at all.

The same forward selection with simulated columns, on the opening seconds where they lack something, on the whole runs
otherwise.
"""

from __future__ import annotations

from dataclasses import replace

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import refine
from hexsim.tracing.fitting.selection import (
    Search,
    cut,
    information,
    pruned,
    residual_at_noise_level,
    search,
)
from hexsim.tracing.state import Step, Tell, Trace
from hexsim.tracing.steps.hypotheses import hypothesis_words, refit_with_own_input_uncertainty, simulated_rivals
from hexsim.tracing.steps.shapes import with_octaves


def simulated_search(trace: Trace, tell: Tell) -> Search:
    """The search, ended by refits on the whole runs."""
    base, problem, possible = trace.base, trace.fit_problem, with_octaves(trace.candidates)
    head = problem.head(rules.OPENING_S)
    if head is problem or residual_at_noise_level(cut(base, problem, head).misfit):
        return search(base, possible, problem, tell, least_gain=rules.EXPLAINS)
    opening = refine(cut(base, problem, head), head, fresh=True, relative=rules.BASE_TOLERANCE)
    found = search(opening, possible, head, tell, least_gain=rules.EXPLAINS)
    rivals = simulated_rivals(found, problem, base, tell)
    stages = [replace(stage, rivals=[]) for stage in found.stages]
    if rivals:
        stages[-1].rivals = rivals
    return replace(found, base=base, best=rivals[0] if rivals else base, stages=stages)


def search_by_simulation(trace: Trace, tell: Tell) -> Trace:
    """Needed where more than noise is left; on a bench also where nothing is, because an effect may hide in the noise."""
    final = trace.final
    if trace.verdict == "partly":
        return replace(trace, decided="not needed: an effect is sure, and no other brings this machine to the noise")
    if residual_at_noise_level(final.misfit) and (final.candidates or trace.machine.is_hexapod):
        return replace(trace, decided="not needed: nothing but noise is left")
    found = simulated_search(trace, tell)
    if found.stages:
        trace = replace(trace, screening=found.stages[0].lines, screened=trace.base.n)
    if not final.candidates or information(found.best) < information(final):
        # without an effect the verdict states the declared machine itself
        best = refine(found.best, trace.fit_problem, stated=True) if found.best.candidates else found.best
        trace = replace(trace, search=found, final=pruned(best, trace.fit_problem))
    trace = refit_with_own_input_uncertainty(trace)
    return replace(trace, decided=f"{hypothesis_words(trace.final)}: chi2 {trace.final.reduced:.3g} a sample")


STEP = Step(name="search by simulation", doing="looking for effects by simulation", share=0.2, run=search_by_simulation)
