"""The verdict: is the residual noise, is each effect needed, does it help on runs that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, refine, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.fitting.rest_evidence import values_in_leg
from hexsim.tracing.fitting.rest_priors import effects_of
from hexsim.tracing.fitting.selection import cut, may_leave, residual_at_noise_level, scale_of
from hexsim.tracing.held_out import refused
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import NamedEffect, Step, Tell, Trace, Verdict


def refit_without_effects(fit: Fit, base: Fit, problem: SimulatedProblem) -> Fit:
    """The declared machine refitted again from the parameters of a hypothesis: is its effect needed at all?

    A refit may stand still on its way; then an effect that does nothing looks as if it had helped. It ends where it cannot
    leave as little as the hypothesis: no run leaves less than its opening seconds.
    """
    if not fit.candidates:
        return base
    worth = may_leave(fit.chi2 + rules.alarm(fit.n) * scale_of(fit))
    bare, again = replace(fit, candidates=(), values=()), base
    for part in dict.fromkeys((problem.head(rules.OPENING_S), problem)):
        start = replace(start_fit_at(bare, part), columns=cut(fit, problem, part).columns)
        again = refine(start, part, fresh=True, relative=rules.BASE_TOLERANCE, worth=worth)
        if not worth(again, 0.0):
            return base
    return again if again.chi2 < base.chi2 else base


def held_out_gains(fit: Fit, base: Fit, problem: SimulatedProblem) -> list[float]:
    """Fall of chi2 by the effects in each held-out run."""
    after = held_out_chi2(fit, problem)
    return [b - a for a, b in zip(after, held_out_chi2(base, problem), strict=True)]


def held_out_chi2(fit: Fit, problem: SimulatedProblem) -> list[float]:
    """chi2 of each held-out run."""
    return [float(np.sum(m[0] ** 2)) for m in problem.misfit([fit.fitted_machine()])]


def named_effect(
    trace: Trace, final: Fit, candidate: Candidate, tied: tuple[str, ...], gains: Sequence[float], share: float = math.nan,
    unseen: float | None = None,
) -> NamedEffect:  # fmt: skip
    """An effect of a hypothesis with its evidence. share, unseen: of the rest that it takes in the fit and the held-out runs;
    without, the hypothesis' share of the held-out chi2."""
    gain, before = trace.base.chi2 - final.chi2, sum(held_out_chi2(trace.base, trace.validate_problem))
    count = sum(len(own.free()) for own in effects_of(final))
    return NamedEffect(
        candidate=candidate,
        values=values_in_leg(final, candidate),
        standard_errors=final.standard_errors()[final.candidates.index(candidate)],
        tied_with=tied,
        gain_cv=sum(gains) / before if unseen is None else unseen,
        blocks=round(trace.validate_problem.duration_s / rules.REST_BLOCK_S),
        d_bic=float(-gain + count * np.log(final.n)),
        held_out=tuple(gains),
        single_leg=final.machine.n_legs == 1,
        share=share,
    )


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
    """The declared machine refitted beside the hypothesis, then the verdict."""
    problem, final = trace.fit_problem, trace.final
    if trace.verdict == "partly":
        return replace(trace, decided="partly: what is left beside the sure effects is more than noise")
    base = refit_without_effects(final, trace.base, problem)
    verdict, named = judged(base, final, problem, trace.validate_problem)
    if verdict == "explained" and (no := refused(final, base, trace.validate_problem)) is not None:
        verdict = "nothing missing" if residual_at_noise_level(base.misfit) else "unexplained"
        return replace(trace, base=base, final=base, verdict=verdict, refused=(*trace.refused, no[1]), decided=no[1])
    return replace(trace, base=base, final=named, verdict=verdict, decided=verdict)


STEP = Step(name="verdict", doing="judging on held-out runs", share=0.1, run=judge)
