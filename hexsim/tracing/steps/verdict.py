"""From the search to a verdict: is the rest noise, which names hold, which are ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, refine, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate
from hexsim.tracing.fitting.selection import Search, scale_of
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray
Verdict = Literal["explained", "partly", "unexplained", "nothing missing"]


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect of the final hypothesis with what speaks for it."""

    candidate: Candidate
    values: dict[str, float]
    standard_errors: dict[str, float]
    tied_with: tuple[str, ...]
    gain_chi2: float
    gain_cv: float
    blocks: int
    d_bic: float
    held_out: tuple[float, ...] = ()  # fall of chi2 in each held-out run
    single_leg: bool = False


def residual_at_noise_level(misfit: Sequence[Array], share: float = 1.0) -> bool:
    """Nothing but noise is left: every channel and its means over 25 and 400 samples (the latter loosely).

    share: of the run that the misfit is of; then the problem is whether the whole run can still be at the noise, the
    rest of it being no better than noise.
    """
    for m in misfit:
        for width, limit in rules.FLOOR_WINDOWS:
            n = m.shape[1] // width * width
            means = m[:, :n].reshape(m.shape[0], -1, width).mean(axis=2) * np.sqrt(width)
            if not np.all(np.mean(means**2, axis=1) * share < limit**2 - (1.0 - share)):
                return False
    return True


def pruned(fit: Fit, problem: SimulatedProblem) -> Fit:
    """Without the effects that the others make superfluous."""
    for k in range(len(fit.candidates) - 1, -1, -1):
        if len(fit.candidates) < 2 or not residual_at_noise_level(fit.misfit):
            break
        candidates, values = fit.candidates[:k] + fit.candidates[k + 1 :], fit.values[:k] + fit.values[k + 1 :]
        less = start_fit_at(replace(fit, candidates=candidates, values=values), problem)
        less = refine(less, problem, fresh=True)
        if less.chi2 - fit.chi2 < rules.alarm(fit.n) * scale_of(fit):
            fit = less
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


def refit_with_own_input_uncertainty(
    final: Fit, base: Fit, problem: SimulatedProblem, held_out: SimulatedProblem
) -> tuple[Fit, Fit, SimulatedProblem, SimulatedProblem]:
    """A hypothesis near the noise judged by what no simulation can know about itself, if that brings it there.

    A delay or more static friction makes the same disturbances move the machine further than they move the declared one.
    """
    if not final.candidates or residual_at_noise_level(final.misfit) or final.reduced > rules.NEAR_FLOOR:
        return final, base, problem, held_out
    own, own_held_out = (q.with_input_uncertainty(final.fitted_machine()) for q in (problem, held_out))
    fit = pruned(refine(start_fit_at(final, own), own, fresh=True), own)
    if not residual_at_noise_level(fit.misfit):
        return final, base, problem, held_out
    return fit, refine(start_fit_at(base, own), own, fresh=True, relative=rules.BASE_TOLERANCE), own, own_held_out


def judged(base: Fit, final: Fit, problem: SimulatedProblem, held_out: SimulatedProblem) -> tuple[Verdict, Fit]:
    """Verdict on the last hypothesis: its rest is noise in the fit runs, and it helps in every held-out run."""
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


def name_effects(
    found: Search, base: Fit, final: Fit, ties: Sequence[dict[str, Fit]], held_out: SimulatedProblem
) -> list[NamedEffect]:
    """Every effect of an explained hypothesis with its evidence."""
    if not ties:
        return []
    gains = tuple(held_out_gains(final, base, held_out))
    return [_named(found, base, final, k, tuple(tied), gains) for k, tied in enumerate(ties)]


def _named(
    found: Search, base: Fit, final: Fit, k: int, tied: tuple[str, ...], gains: tuple[float, ...]
) -> NamedEffect:
    candidate = final.candidates[k]
    lines = [line for stage in found.stages for line in stage.lines if line.candidate.label == candidate.label]
    gain = base.chi2 - final.chi2
    count = sum(len(c.free()) for c in final.candidates)
    return NamedEffect(
        candidate=candidate,
        values=final.values[k],
        standard_errors=final.standard_errors()[k],
        tied_with=tied,
        gain_chi2=gain,
        gain_cv=lines[0].gain_cv if lines else float("nan"),
        blocks=lines[0].blocks if lines else 0,
        d_bic=float(-gain + count * np.log(final.n)),
        held_out=gains,
        single_leg=final.machine.n_legs == 1,
    )
