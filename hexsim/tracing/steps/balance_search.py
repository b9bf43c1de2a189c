"""The search on balances, before any simulation: all balances together, effects selected where they act.

A balance costs milliseconds where a simulated run costs a tenth of a second, and it looks at measured signals, so one
missing effect does not bend all the others. What it chooses is judged afterwards by simulation. Rows are divided by
what they are in null runs; what the sampled log itself leaves in them (reversals, held volts) is taken out by the
residual of a noise-free simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.signals.weak_form import HALF_WIDTH_S, WIDE_S
from hexsim.tracing import rules
from hexsim.tracing.balances import balance_named
from hexsim.tracing.balances.continuity import FastContinuity, fast_rate, mean_capacity
from hexsim.tracing.balances.null import used, with_noise
from hexsim.tracing.fitting.fit import Fit, parameter_columns, refine, start_fit
from hexsim.tracing.fitting.selection import Search, search
from hexsim.tracing.problems.balance import BalanceProblem, BalanceRows
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace, Violation
from hexsim.tracing.steps.violations import own_machine

Array = np.ndarray


def joint_problem(problem: SimulatedProblem, lines: Sequence[Violation], machine: Machine) -> BalanceProblem:
    """All balances of all logs as one problem. machine: what the noise-free simulation runs on."""
    quiet, parts = [problem.simulated(machine, i) for i in range(len(problem.logs))], []
    for own, sigma in {balance_named(line.name, machine): line.all_sigma for line in lines}.items():
        if not own.shared_out:
            clean = tuple(np.nan_to_num(used(log, own.residual(log, machine))) for log in quiet)
            rows = tuple(range(len(own.places(problem.logs[0]))))
            parts.append(BalanceRows(balance=own, sigma=sigma, rows=rows, clean=clean))
    return BalanceProblem(logs=problem.logs, parts=tuple(parts), thin_s=HALF_WIDTH_S)


def with_fast_rows(joint: BalanceProblem, problem: SimulatedProblem, machine: Machine) -> BalanceProblem:
    """The same with the fast continuity of a bench, where the logs show it; its noise from one null run of each log.

    What reversals between two samples leave in a null run counts as noise.
    """
    bare = FastContinuity()
    if not all(bare.wants(log, machine) for log in problem.logs):
        return joint
    rng, resolution = np.random.default_rng(0), machine.sensors.position_resolution_m
    quiet = [problem.simulated(machine, i) for i in range(len(problem.logs))]
    noisy = [with_noise(log, problem.noise, resolution, rng) for log in quiet]
    left = [used(log, bare.residual(log, machine)) for log in noisy]
    rates = [used(q, fast_rate(_first(n) - _first(q), q.rate)) for q, n in zip(quiet, noisy, strict=True)]
    capacity = float(np.mean([mean_capacity(log, machine) for log in quiet]))
    whole, rate = (float(np.sqrt(np.nanmean(np.concatenate(own, axis=-1) ** 2))) for own in (left, rates))
    if not np.isfinite(whole) or whole <= 0.0:
        return joint
    fast = FastContinuity(float(np.sqrt(max(whole**2 - (capacity * rate) ** 2, 0.01 * whole**2))), rate)
    clean = tuple(np.nan_to_num(used(log, fast.residual(log, machine))) for log in quiet)
    part = BalanceRows(balance=fast, sigma=np.ones(1), rows=(0,), clean=clean, rest_time_s=WIDE_S)
    return replace(joint, parts=(*joint.parts, part))


def _first(log: Log) -> Array:
    """Pressure of the bottom chamber of the first leg (n,) [Pa]."""
    assert log.pressure is not None
    return log.pressure[0]


def search_in_balances(trace: Trace, tell: Tell) -> Trace:
    """Forward selection on all balances together, one effect at first (see `extend_search`); nothing where no balance is formed."""
    if not trace.violations:
        return replace(trace, decided="no balance to search in")
    joint = joint_problem(trace.fit_problem, trace.violations, own_machine(trace.machine, trace.violations))
    start = start_fit(trace.machine, trace.base.priors, joint)
    base = refine(start, joint, fresh=True, relative=1e-3)
    found = search(parameter_columns(base, joint), trace.candidates, joint, done=restored, most=1)
    first = found.stages[0].lines
    chosen = " and ".join(candidate.label for candidate in found.best.candidates)
    return replace(
        trace,
        base=base,
        search=found,
        balance_problem=joint,
        screening=first,
        screened=joint.samples,
        decided=f"{len(first)} columns compared; the balances ask for {chosen or 'no effect'}",
    )


def extend_search(found: Search, trace: Trace) -> Search | None:
    """The search with one effect more; None where it has come to its end."""
    n = len(found.best.candidates)
    if trace.balance_problem is None or n < len(found.stages) or n >= rules.MOST_EFFECTS or restored(found.best):
        return None
    return search(found.base, trace.candidates, trace.balance_problem, done=restored, most=n + 1, begun=found)


def restored(fit: Fit) -> bool:
    """Does every row of every balance hold again?"""
    return all(np.all(np.sqrt(np.mean(m**2, axis=1)) < rules.VIOLATED) for m in fit.misfit)


STEP = Step(
    name="search in the balances", doing="looking for effects in the balances", share=0.15, run=search_in_balances
)
