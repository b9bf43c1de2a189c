"""Where the model is violated: each balance against the noise of its sensors, its own parameters refitted first.

    violation q = rms(r)/sigma,  sigma = rms of the residual that sensor noise alone makes through the same operators.

A balance's own declared parameters are fitted to it inside their uncertainty, so that a parameter error is no violation
and one balance's trouble does not reach another through a shared fit. The null is the same figure of simulations of the
refitted machine with the same setpoint and noise: its largest value over the seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.signals.table import table
from hexsim.tracing import rules
from hexsim.tracing.attempt import attempted
from hexsim.tracing.balances import Balance, library
from hexsim.tracing.balances.null import null_squares, used, window_weights
from hexsim.tracing.checks.finding import Finding, loss
from hexsim.tracing.fitting.fit import Fit, refine, start_fit
from hexsim.tracing.fitting.parameters import Prior, priors, with_settings
from hexsim.tracing.problems.balance import BalanceProblem, BalanceRows
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace, Violation

Array = np.ndarray


def own_priors(balance: Balance, priors: tuple[Prior, ...], machine: Machine, logs: Sequence[Log]) -> tuple[Prior, ...]:
    """The declared parameters that a balance depends on at all."""
    log = logs[0]
    base = balance.residual(log, machine)
    scale = np.sqrt(np.mean(base**2)) + 1e-300
    found = []
    for prior in priors:
        ends = (with_end(balance, log, machine, prior, side) for side in (1.0, -1.0))
        moved = next((end for end in ends if end is not None), base)
        if np.sqrt(np.mean((moved - base) ** 2)) > 0.01 * scale:
            found.append(prior)
    return tuple(found)


def with_end(balance: Balance, log: Log, machine: Machine, prior: Prior, side: float) -> Array | None:
    """The residual with a declared parameter at an end of its uncertainty; None where such a machine cannot be built."""
    return attempted(lambda: balance.residual(log, with_settings(machine, {prior: side * prior.half_width}, [])))


def violations(declared: Machine, simulated: Machine, problem: SimulatedProblem) -> list[Violation]:
    """Every balance at every place. simulated: the machine that the null runs come from."""
    lines = []
    balances = [balance for balance in library() if all(balance.wants(log, declared) for log in problem.logs)]
    for balance, (sigma, null) in zip(balances, null_sizes(balances, simulated, problem), strict=True):
        machine = own_fit(balance, declared, problem.logs, sigma).fitted_machine()
        rms, null = rms_of(balance, machine, problem.logs), null + sampling_of(balance, machine, problem.logs)
        for place, where in enumerate(balance.places(problem.logs[0])):
            lines.append(
                Violation(
                    name=balance.name,
                    where=where,
                    place=place,
                    unit=balance.unit,
                    rms=float(rms[place]),
                    sigma=float(sigma[place]),
                    null=float(null[place] / sigma[place]),
                    machine=machine,
                    all_sigma=sigma,
                )
            )
    return lines


def null_sizes(balances: Sequence[Balance], machine: Machine, problem: SimulatedProblem) -> list[tuple[Array, Array]]:
    """(sigma, largest rms of the null runs) of every balance, (n_places,) each; one null run a job."""
    quiet = [problem.simulated(machine, i) for i in range(len(problem.logs))]
    if machine.is_hexapod:
        quiet = [log.head(rules.OPENING_S) for log in quiet]
    clean = [[used(log, balance.residual(log, machine)) for log in quiet] for balance in balances]
    runs = in_parallel(
        lambda seed: null_squares(balances, quiet, clean, machine, problem.noise, seed), range(rules.NULL_SEEDS)
    )
    found = []
    for k in range(len(balances)):
        whole, apart = (np.stack([run[k][which] for run in runs]) for which in (0, 1))
        found.append((np.sqrt(apart.mean(axis=0)), np.sqrt(whole.max(axis=0))))
    return found


def rms_of(balance: Balance, machine: Machine, logs: Sequence[Log]) -> Array:
    """rms of the residual over all logs, a row (n_places,)."""
    rest = [used(log, balance.residual(log, machine)) * window_weights(log) for log in logs]
    return np.sqrt(sum(np.sum(r**2, axis=-1) for r in rest) / sum(r.shape[-1] for r in rest))


def sampling_of(balance: Balance, machine: Machine, logs: Sequence[Log]) -> float:
    """rms of what of a residual rests on the instants of its samples: a tick between them leaves up to that much."""
    rows = [own for log in logs if (own := balance.sampling(log, machine)) is not None]
    return float(np.sqrt(np.mean(np.concatenate([row.ravel() for row in rows]) ** 2))) if rows else 0.0


def own_fit(balance: Balance, machine: Machine, logs: Sequence[Log], sigma: Array) -> Fit:
    """The balance's own declared parameters, alike in all legs, fitted to it; rows that stand out are left out."""
    rows = tuple(range(len(balance.places(logs[0]))))
    own = own_priors(balance, priors(machine), machine, logs)
    problem = BalanceProblem(logs=tuple(logs), parts=(BalanceRows(balance=balance, rows=rows, sigma=sigma),))
    fit = refine(start_fit(machine, own, problem), problem, fresh=True, relative=1e-3)
    if len(rows) > 1:
        size = np.sqrt(sum(np.mean(m**2, axis=1) for m in fit.misfit) / len(fit.misfit))
        plain = tuple(int(k) for k in np.flatnonzero(size <= 1.3 * np.median(size)))
        if len(plain) < len(rows):
            problem = BalanceProblem(logs=tuple(logs), parts=(BalanceRows(balance=balance, rows=plain, sigma=sigma),))
            fit = refine(start_fit(machine, own, problem), problem, fresh=True, relative=1e-3)
    return fit


def own_machine(machine: Machine, lines: Sequence[Violation]) -> Machine:
    """The machine with parameters that the force balance prefers: where shapes are read off."""
    return next((line.machine for line in lines if line.name == "force"), machine)


def lost_balances(logs: Sequence[Log], machine: Machine) -> list[Finding]:
    """What cannot be said: the balances of the machine that these logs do not allow, and the channels that they lack."""
    lost = [b for b in library() if b.needs(machine) and not all(b.measurable(log, machine) for log in logs)]
    asked = dict.fromkeys(stem for balance in lost for stem in balance.needs(machine)[0])
    missing = [table()[stem].kind for stem in asked if any(log.signal(stem) is None for log in logs)]
    if not lost:
        return []
    description = (
        f"without {' and '.join(missing)} the balances {', '.join(sorted({b.name for b in lost}))} cannot be formed: "
        "what is missing there shows only by what it does to the other signals"
    )
    return [loss(channel=missing[0], description=description)]


def hold_balances(trace: Trace, tell: Tell) -> Trace:
    """Every balance that the logs allow, at every place."""
    lines = violations(trace.machine, trace.machine, trace.fit_problem)
    off = [f"{line.name} of {line.where}" for line in lines if line.violated]
    decided = f"violated: {', '.join(off)}" if off else f"all {len(lines)} hold"
    lost = lost_balances(trace.fit_problem.logs, trace.machine)
    findings = trace.findings | {"all logs": [*trace.findings.get("all logs", []), *lost]}
    return replace(
        trace, violations=lines, findings=findings, decided=decided if lines else "the logs allow no balance"
    )


STEP = Step(name="balances", doing="balances against runs of the model", share=0.1, run=hold_balances)
