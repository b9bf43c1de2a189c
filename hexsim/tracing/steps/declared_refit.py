"""The declared parameters refitted by simulation, inside their uncertainty: the base that every effect must beat.

A log of minutes is first fitted over its first one: most steps are then short. The last ones, with the uncertainty of the
inputs at the machine that this gave, see all of it. What comes near the noise is fitted with the noise that the logged volts show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hexsim.errors import HexsimError
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import refine, start_fit_at
from hexsim.tracing.fitting.selection import residual_at_noise_level
from hexsim.tracing.state import Step, Tell, Trace


def refit_declared(trace: Trace, tell: Tell) -> Trace:
    """The declared machine refitted, and both problems with the uncertainty of their inputs at that machine."""
    start, problem, held_out = trace.base, trace.fit_problem, trace.validate_problem
    if asked := [candidate.label for candidate in trace.search.best.candidates]:
        tell(f"refitting declared parameters; the balances ask for {' and '.join(asked)}")
    if not np.isfinite(start_fit_at(start, problem).chi2):
        names = " and ".join(log.name for log in problem.logs)
        raise HexsimError(
            f"the declared machine cannot be simulated along {names}: its answer diverges. valve_V must be the command of "
            "a valve, not of a pump; check signs and units of the columns, or declare own balances (balances.toml)"
        )
    first = problem.head(rules.LONG_S).with_input_uncertainty(start.fitted_machine())
    base = refine(start_fit_at(start, first), first, fresh=True, relative=rules.BASE_TOLERANCE)
    whole = problem.duration_s <= first.duration_s
    problem, held_out = (q.with_input_uncertainty(base.fitted_machine()) for q in (problem, held_out))
    start = replace(start_fit_at(base, problem), columns=problem.reweighted(base.columns, first) if whole else None)
    base = refine(start, problem, fresh=True, relative=rules.BASE_TOLERANCE, made_here=True)
    if problem.shown and base.reduced < rules.NEAR and not residual_at_noise_level(base.misfit):
        known, then = (q.with_known_volts().with_input_uncertainty(base.fitted_machine()) for q in (problem, held_out))
        near = refine(start_fit_at(base, known), known, fresh=True, relative=rules.BASE_TOLERANCE)
        if near.reduced < rules.NEAR:
            base, problem, held_out = near, known, then
    end = "at the noise in every channel" if residual_at_noise_level(base.misfit) else "more than noise is left"
    return replace(
        trace,
        base=base,
        final=base,
        fit_problem=problem,
        validate_problem=held_out,
        decided=f"chi2 {base.reduced:.3g} a sample: {end}",
    )


STEP = Step(name="declared parameters", doing="refitting declared parameters", share=0.15, run=refit_declared)
