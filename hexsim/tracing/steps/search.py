"""The search on balances, before any simulation: all balances together, effects selected where they act.

A balance costs milliseconds where a simulated run costs a tenth of a second, and it looks at measured signals, so one
missing effect does not bend all the others. What it chooses is judged afterwards by simulation. Rows are divided by
what they are in null runs; what the sampled log itself leaves in them (reversals, held volts) is taken out by the
residual of a noise-free simulation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexsim.declaration import Machine
from hexsim.tracing import rules
from hexsim.tracing.balances.null import used
from hexsim.tracing.fitting.fit import Fit, parameter_columns, refine, start_fit, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, Prior
from hexsim.tracing.fitting.selection import Search, Tick, information, named_first, search
from hexsim.tracing.problems.balance import BalanceProblem, BalanceRows
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps.verdict import residual_at_noise_level
from hexsim.tracing.steps.violations import Violation, balance_named

INDEPENDENT_S = 0.02  # [s] half the balances' window: samples so far apart are about independent


def joint_problem(problem: SimulatedProblem, lines: Sequence[Violation], machine: Machine) -> BalanceProblem:
    """All balances of all logs as one problem. machine: what the noise-free simulation runs on."""
    log = problem.logs[0]
    names = list(dict.fromkeys(line.name for line in lines))
    names = [name for name in names if not (name == "force" and log.n_legs > 1)]  # the platform has the same, once
    quiet = [problem.simulated(machine, i) for i in range(len(problem.logs))]
    parts = []
    for name in names:
        balance = balance_named(name, log)
        sigma = next(line.all_sigma for line in lines if line.name == name)
        clean = tuple(np.nan_to_num(used(own, balance.residual(own, machine))) for own in quiet)
        rows = tuple(range(len(balance.places(log))))
        parts.append(BalanceRows(balance=balance, sigma=sigma, rows=rows, clean=clean))
    return BalanceProblem(logs=problem.logs, parts=tuple(parts), thin_s=INDEPENDENT_S)


def balance_search(
    machine: Machine, priors: tuple[Prior, ...], candidates: list[Candidate], problem: BalanceProblem
) -> Search:
    """Forward selection on the balances."""
    base = refine(start_fit(machine, priors, problem), problem, fresh=True, relative=1e-3)
    return search(parameter_columns(base, problem), candidates, problem, done=restored)


def restored(fit: Fit) -> bool:
    """Does every row of every balance hold again?"""
    return all(np.all(np.sqrt(np.mean(m**2, axis=1)) < rules.RESTORED) for m in fit.misfit)


def contenders(found: Search) -> list[Fit]:
    """The hypotheses that go on: with fewer effects first, then the best and what balances cannot tell from it."""
    if not found.best.candidates:
        return []
    k = len(found.best.candidates)
    rivals = [rival for stage in found.stages for rival in stage.rivals if len(rival.candidates) == k]
    fewer = [stage.rivals[0] for stage in found.stages[: k - 1] if stage.rivals]
    gain = found.base.chi2 - found.best.chi2
    near = max(rules.NEAR_CHI2, rules.NEAR_SHARE * gain)
    rivals = [rival for rival in rivals if rival.chi2 - found.best.chi2 < near]
    return fewer + sorted(rivals, key=information)[: rules.CONTENDERS]


def simulated_rivals(found: Search, problem: SimulatedProblem, tick: Tick = lambda step: None) -> list[Fit]:
    """The contenders of a search refitted by simulation, the best first; more effects only while fewer do not suffice."""
    rivals: list[Fit] = []
    for rival in contenders(found):
        if any(residual_at_noise_level(r.misfit) for r in rivals if len(r.candidates) < len(rival.candidates)):
            break
        tick(f"simulating {' and '.join(c.label for c in rival.candidates)}")
        fitted = simulated_fit(rival, problem)
        rivals += [] if fitted is None else [fitted]
    return named_first(sorted(rivals, key=information))


def simulated_fit(rival: Fit, problem: SimulatedProblem) -> Fit | None:
    """A hypothesis of the balances refitted by simulation; None when it does not simulate or cannot reach the noise.

    What leaves too much of the opening seconds, fitted to them alone, leaves too much of the whole. The whole is then
    fitted from there, or from the balances where that is nearer: opening seconds may hardly show an effect. A hypothesis
    that comes near is judged by what no simulation can know about itself, not about the declared machine: a delay or more
    static friction makes the same disturbances move the machine further.
    """
    head = problem.head(rules.TRIAGE_S)
    share = head.duration_s / problem.duration_s
    start = start_fit_at(rival, head)
    if not np.isfinite(start.chi2):
        return None
    opening = refine(start, head, fresh=True)
    if not residual_at_noise_level(opening.misfit, share):
        if opening.reduced > rules.NEAR_FLOOR:
            return None
        own = head.with_input_uncertainty(opening.fitted_machine())
        opening = refine(start_fit_at(opening, own), own, fresh=True)
        if not residual_at_noise_level(opening.misfit, share):
            return None
        whole = fitted_from((opening, rival), problem.with_input_uncertainty(opening.fitted_machine()))
        return None if whole is None else start_fit_at(whole, problem)
    return fitted_from((opening, rival), problem)


def fitted_from(fits: Sequence[Fit], problem: SimulatedProblem) -> Fit | None:
    """The hypothesis refitted from the nearest of several fits of it; None when it does not simulate."""
    start = min((start_fit_at(fit, problem) for fit in fits), key=lambda fit: fit.chi2)
    return refine(start, problem, fresh=True) if np.isfinite(start.chi2) else None
