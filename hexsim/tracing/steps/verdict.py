"""The verdict: is the residual noise, is each effect needed, does it help on runs that no fit has seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, refine, start_fit_at
from hexsim.tracing.fitting.selection import residual_at_noise_level, scale_of
from hexsim.tracing.held_out import refused
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace, Verdict

POLISHES = 3


def polished(fit: Fit, problem: SimulatedProblem) -> Fit:
    """The last refit, with differences a tenth as wide: near a resonance the answer is nonlinear within the usual ones."""
    for _ in range(POLISHES):
        finer = refine(start_fit_at(fit, problem), problem, fresh=True, share=0.1)
        gain, fit = fit.chi2 - finer.chi2, finer
        if gain < rules.ALARM_CHI2:
            break
    return fit


def refit_without_effects(fit: Fit, base: Fit, problem: SimulatedProblem) -> Fit:
    """The declared machine refitted again from the parameters of a hypothesis: is its effect needed at all?

    A refit may stand still on its way; then an effect that does nothing looks as if it had helped.
    """
    if not fit.candidates:
        return base
    bare = start_fit_at(replace(fit, candidates=(), values=()), problem)
    again = refine(bare, problem, fresh=True, relative=rules.BASE_TOLERANCE)
    return again if again.chi2 < base.chi2 else base


def held_out_gains(fit: Fit, base: Fit, problem: SimulatedProblem) -> list[float]:
    """Fall of chi2 by the effects in each held-out run."""
    before = problem.misfit([base.fitted_machine()])
    after = problem.misfit([fit.fitted_machine()])
    return [float(np.sum(b[0] ** 2) - np.sum(a[0] ** 2)) for a, b in zip(after, before, strict=True)]


def judged(base: Fit, final: Fit, problem: SimulatedProblem, held_out: SimulatedProblem) -> tuple[Verdict, Fit]:
    """Verdict on the last hypothesis: its residual is noise in the fit runs, and it helps in every held-out run."""
    if not final.candidates:
        return ("nothing missing", base) if residual_at_noise_level(base.misfit) else ("unexplained", base)
    if residual_at_noise_level(base.misfit) and base.chi2 - final.chi2 < rules.alarm(final.n) * scale_of(final):
        return "nothing missing", base
    helps = base.chi2 - final.chi2 > rules.alarm(final.n) * scale_of(final)
    if (
        helps
        and residual_at_noise_level(final.misfit)
        and all(gain > 0 for gain in held_out_gains(final, base, held_out))
    ):
        return "explained", final
    return ("nothing missing" if residual_at_noise_level(base.misfit) else "unexplained"), base


def judge(trace: Trace, tell: Tell) -> Trace:
    """A last refit with finer differences, the declared machine refitted beside it, then the verdict."""
    problem, final = trace.fit_problem, trace.final
    if trace.verdict == "partly":
        return replace(trace, decided="partly: what is left beside the sure effects is more than noise")
    if final.candidates and residual_at_noise_level(final.misfit):
        tell("last refit")
        final = polished(final, problem)
    base = refit_without_effects(final, trace.base, problem)
    verdict, named = judged(base, final, problem, trace.validate_problem)
    if verdict == "explained" and (no := refused(final, base, trace.validate_problem)) is not None:
        verdict = "nothing missing" if residual_at_noise_level(base.misfit) else "unexplained"
        return replace(trace, base=base, final=base, verdict=verdict, refused=(*trace.refused, no[1]), decided=no[1])
    return replace(trace, base=base, final=named, verdict=verdict, decided=verdict)


STEP = Step(name="verdict", doing="judging on held-out runs", share=0.1, run=judge)
