"""report.html of a trace: self-contained, readable without the tool."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from hexsim.recording.quantity import plain, quantity
from hexsim.recording.report import data_url, render
from hexsim.signals.channels import kind_of
from hexsim.tracing.report import balance_figure, budget, figures, trades
from hexsim.tracing.report.signals import SCALE, channel_words
from hexsim.tracing.report.tables import (
    balance_rows,
    detectable_rows,
    effect_rows,
    error_rows,
    parameter_rows,
    place_of,
    screening_rows,
    unexplained_rows,
)
from hexsim.tracing.state import NamedEffect, Trace

CAPTIONS = {
    "budget": "How far off is each model on motion that no fit has seen? "
    "Error budget on held-out motion: what each step leaves of the signal of each kind that the refitted model gets most "
    "wrong, and in times its sensor's noise (dotted).",
    "comparison": "Where in the signals is it off? "
    "Held-out run {run}: of each kind of signal the one that the refitted model gets most wrong. Left: measured "
    "and simulated. Right: residuals of each model; a complete one stays in the blue band.",
    "balances": "Which equation do the measured signals not fulfil, and on what does it depend? "
    "The residual of each balance in the fit runs, at its worst place, over the signal that it depends on. A curve "
    "that leaves the pale band is physics that the model is missing; shapes inside it are in the model's own runs too. Every panel "
    "has its own scale; the bands are of one size before and after.",
    "portraits": "Do the loops of friction and valve agree? "
    "{leg}, the seconds of the first figure as loops. Friction is a step of pressure where the velocity "
    "changes sign, the valve's dead band a flat piece of velocity over volts. A good model covers the grey line.",
    "spectra": "At which frequencies is it off? "
    "What each model leaves on run {run}, its mean taken off. Low frequencies are slow effects, humps are resonances "
    "that the model has elsewhere; a complete model lies on the dotted line.",
    "parameters": "Did the parameters stay where they were declared? "
    "Where each declared parameter ended inside its declared uncertainty (the grey bar; its half width at the "
    "right). Orange: held back by its limit.",
    "pairs": trades.CAPTION,
}


def report_page(result: Trace) -> str:
    """The whole page."""
    report, run = result.report, result.validate_problem.logs[0].name
    leg = figures.portrait_leg(result).capitalize() if result.machine.is_hexapod else "The leg"
    answers = figures.answers_of(result)
    makers = {
        "budget": budget.waterfall,
        "comparison": partial(figures.comparison, answers=answers),
        **({"balances": balance_figure.balances} if result.violations else {}),
        "portraits": partial(figures.portraits, answers=answers),
        "spectra": partial(figures.spectra, answers=answers),
        "parameters": figures.parameters,
        **({"pairs": trades.pairs} if report["trades"] else {}),
    }
    return render(
        "trace.html.j2",
        title=f"Trace of {result.machine.name}",
        report=report,
        verdict=verdict_line(result),
        sentence=sentence(result),
        cards=cards(result),
        effects=effect_rows(report),
        rests=unexplained_rows(report),
        added=figures.added(result) if result.effects or result.learned else "",
        errors=error_rows(report),
        balances=balance_rows(result),
        screening=screening_rows(result),
        detectable=detectable_rows(report),
        beside=any("beside_rest" in d for d in report["detectable"].values()),
        parameters=parameter_rows(report),
        findings=[(name, f) for name, found in report["findings"].items() for f in found],
        experiments=report["separating_experiments"],
        runs=tuple(", ".join(log.name for log in q.logs) for q in (result.fit_problem, result.validate_problem)),
        pictures={
            name: (data_url(make(result)), CAPTIONS[name].format(run=run, leg=leg)) for name, make in makers.items()
        },
    )


def worst_error(report: Mapping[str, Any], model: str) -> tuple[float, str]:
    """Error on held-out motion in times the sensor's noise, and the signal that has it."""
    rows = [
        (row[model] / row["noise"], channel)
        for channels in report["error"].values()
        for channel, row in channels.items()
        if row[model] is not None and row["noise"]
    ]
    return max(rows, default=(math.nan, ""))


def verdict_line(result: Trace) -> str:
    """The answer in one line."""
    if result.effects:
        beside = ", and something is left beside it" if result.verdict == "partly" else ""
        return "The model is missing: " + "; ".join(effect_words(effect) for effect in result.effects) + beside
    if result.verdict == "nothing missing":
        return "Nothing is missing from the model"
    return "Something is missing, and no effect of the library explains it"


def effect_words(effect: NamedEffect) -> str:
    """supply droop, 2.40 ×10⁹ Pa·s/m³; all names of what is one term."""
    read = []
    for own in (effect, *effect.readings):
        size = own.candidate.effect.parameters[0]
        read.append(f"{own.candidate.label.replace('_', ' ')}, {quantity(own.values[size.name], size.unit)}")
    return " or ".join(read)


def sentence(result: Trace) -> str:
    """What the verdict rests on, with numbers."""
    report = result.report
    (before, channel), (after, last) = (worst_error(report, model) for model in ("refit", "with_effect"))
    signal, later = (channel_words(name) if name else "signal" for name in (channel, last))
    if result.verdict == "nothing missing":
        kinds = dict.fromkeys(kind_of(name) for name in result.fit_problem.channels(0))
        seen = " and ".join(SCALE[kind][0].split(",")[0] for kind in kinds)
        return (
            "With its parameters inside their declared uncertainty the declared machine answers all runs down to the "
            f"sensors' noise in {seen}: at most {plain(before)} times the noise on held-out motion."
        )
    if result.verdict == "partly":
        return partly_sentence(result, f"{plain(before)} ({signal})", f"{plain(after)} ({later})")
    if result.effects:
        ties = sorted({tied.replace("_", " ") for e in result.effects for tied in e.apart})
        tied = f" These runs cannot tell it from {' or '.join(ties)}." if ties else ""
        return (
            f"Without it the {signal} stays {plain(before)} times its sensor's noise off on held-out motion, however the "
            f"declared parameters are fitted; with it every signal comes to {plain(after)} times the noise or less.{tied}"
        )
    rests = unexplained_rows(report)
    where = f" The residual is in {place_of(rests[0])}" if rests else ""
    learned = (
        f" A curve learned from the logs brings the largest to {plain(after)}, under no name." if result.learned else ""
    )
    return (
        f"However the declared parameters are fitted, the {signal} stays {plain(before)} times its sensor's noise off on "
        f"held-out motion.{where}{learned}"
    )


def partly_sentence(result: Trace, before: str, after: str) -> str:
    """The certain effects of a machine that no model fits, and the residual beside them."""
    first = result.effects[0]
    rivals = " or ".join(first.apart).replace("_", " ")
    tied = f" These runs cannot tell it from {rivals}." if rivals else ""
    rests = unexplained_rows(result.report)
    left = f" What is left is in {place_of(rests[0])}" if rests else ""
    return (
        f"It takes {first.share:.0%} of the mean square that the balances leave on the fit runs and {first.gain_cv:.0%} on the "
        f"held-out ones, with the same number in each run.{tied} The largest error on held-out motion goes from {before} "
        f"to {after} times its sensor's noise.{left}"
    )


def cards(result: Trace) -> list[tuple[str, str, str]]:
    """The figures to see first: (value, unit, what it is)."""
    report = result.report
    declared, before, after = (worst_error(report, model)[0] for model in ("declared", "refit", "with_effect"))
    found = [(plain(declared), "× noise", "largest held-out error, as declared")]
    found.append((plain(before), "× noise", "largest held-out error, parameters refitted"))
    if result.effects or result.learned:
        found.append((plain(after), "× noise", f"largest held-out error, with {figures.added(result)}"))
    violated = sum(b["violated"] for b in report["balances"])
    found.append((f"{violated} of {len(report['balances'])}", "", "balances violated"))
    return found
