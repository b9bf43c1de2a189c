"""A learned term for a residual with a clear dependence: its curve put into the simulator, under no physical name.

A curve over one signal, one for each direction of motion, or the velocity times one; over the signal itself, or over what a
first-order low-pass has kept of it.

The residual of a balance is what the model has too much of, so the term is minus the curve. It is kept only if, with
the declared parameters refitted beside it, every held-out run gets better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hexsim.hydraulics.learned import FORMS, HALF, SIGNALS
from hexsim.hydraulics.parameters import LEARNED_KNOTS
from hexsim.machine.files import changed
from hexsim.tracing import rules
from hexsim.tracing.balances import learned_term_of
from hexsim.tracing.dependence import behind_low_pass
from hexsim.tracing.fitting.fit import Fit, evaluate, refine
from hexsim.tracing.fitting.selection import may_leave, scale_of
from hexsim.tracing.held_out import growths
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace, UnexplainedResidual
from hexsim.tracing.steps.verdict import held_out_gains

Array = np.ndarray
WORDS = {
    "plain": "a measured curve over {}",
    "direction": "a measured curve over {} for each direction of motion",
    "product": "the velocity times a measured curve over {}",
}


def words(curve: dict[str, Any]) -> str:
    """What a learned curve is over."""
    return WORDS[curve["form"]].format(behind_low_pass(curve["signal"], curve.get("memory_s")))


def curve_table(rest: UnexplainedResidual) -> dict[str, Any] | None:
    """The [effects.learned_term] table of a residual, or None when it is of no form and signal that a leg knows."""
    found = rest.dependence
    joined = learned_term_of(rest.balance)
    form, signal, back = found.form, found.signal, found.back
    if form == "memory":  # against the motion: one curve out, its opposite in
        form, signal, back = "direction", "speed_m_s", -found.curve
    able = form in FORMS and signal in SIGNALS and joined is not None
    if not able or found.r2_cv < rules.MAIN or rest.violation.where.startswith("platform"):
        return None
    curves = (found.curve / found.speed_m_s,) if back is None else (found.curve, back)
    knots = np.linspace(found.knots[0], found.knots[-1], LEARNED_KNOTS if back is None else HALF)
    values = -np.concatenate([np.interp(knots, found.knots, own) for own in curves])
    curve = {
        "balance": joined,
        "form": form,
        "signal": signal,
        "start": float(knots[0]),
        "step": float(knots[1] - knots[0]),
        "values": [float(value) for value in values],
    } | ({} if found.memory_s is None else {"memory_s": float(found.memory_s)})
    where = (
        {}
        if rest.violation.where == "leg 1" and rest.violation.machine.n_legs == 1
        else {"where": rest.violation.where}
    )
    return {"curve": curve} | where


def learned_fit(
    rest: UnexplainedResidual, base: Fit, problem: SimulatedProblem, held_out: SimulatedProblem
) -> tuple[Fit, dict[str, Any]] | None:
    """The machine with the term, refitted, and its entry in the report; None when it does not hold up."""
    table, machine = curve_table(rest), base.machine
    if table is None or "learned_term" in machine.effects:
        return None
    grown = changed(machine, {"effects": {**machine.effects, "learned_term": table}})
    start, worth = evaluate(replace(base, machine=grown), problem), may_leave(base.chi2 - rules.alarm(base.n))
    fit = refine(start, problem, fresh=True, relative=rules.BASE_TOLERANCE, worth=worth)
    gains = held_out_gains(fit, base, held_out)
    helps = base.chi2 - fit.chi2 > rules.alarm(fit.n) * scale_of(fit)
    worse = growths(held_out, base.built(), fit.built())
    if not helps or worse or not all(gain > 0 for gain in gains):
        return None
    return fit, {
        "name": "",
        "learned": True,
        "balance": rest.balance,
        "where": rest.violation.where,
        "parameters": {},
        "standard_error": {},
        "tied_with": [],
        "curve": table["curve"] | {"standard_error": [float(x) for x in rest.dependence.curve_sd]},
        "evidence": {
            "block_cv_gain": rest.dependence.r2_cv,
            "blocks": rules.FOLDS,
            "dBIC": float(fit.chi2 - base.chi2 + LEARNED_KNOTS * np.log(fit.n)),
            "held_out_gain": gains,
        },
        "description": f"{words(table['curve'])}, of unknown cause",
    }


def learn(trace: Trace, tell: Tell) -> Trace:
    """The worst unexplained residual as a learned term, if it holds up."""
    if not trace.unexplained or trace.verdict == "partly":
        return replace(trace, decided="not needed: no residual to learn")
    found = learned_fit(trace.unexplained[0], trace.base, trace.fit_problem, trace.validate_problem)
    if found is None:
        return replace(trace, decided="no curve over one signal that helps in every held-out run")
    fit, entry = found
    return replace(trace, final=fit, learned=[entry], decided=entry["description"])


STEP = Step(name="learned term", doing="learning a curve", share=0.03, run=learn)
