"""report.html of a trace: self-contained, readable without the tool."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hexsim.recording.report import data_url, render
from hexsim.tracing import report_figures as figures

if TYPE_CHECKING:
    from hexsim.tracing.trace import TraceResult

SENTENCES = {
    "explained": "One model answers all runs: what is left is the sensors' noise, in the fit runs and in the held-out runs.",
    "nothing missing": "The declared machine, with parameters inside their uncertainty, answers all runs down to the sensors' noise.",
    "partly": "The effects named here account for part of the misfit; what is left is described below under no name.",
    "unexplained": "No effect of the library brings the model to the sensors' noise, so none is named.",
}


def number(x: float | None, digits: int = 3) -> str:
    """A number for people."""
    if x is None or not math.isfinite(x):
        return "–"
    return f"{x:.{digits}g}"


def report_page(result: TraceResult) -> str:
    """The whole page."""
    report = result.report
    drawings = [
        (
            "comparison",
            figures.comparison(result),
            "Held-out run: measured and simulated left, their difference right.",
        ),
        (
            "balances",
            figures.balances(result),
            "Residual of each balance at the measured point, with its mean curve; band: sensor noise.",
        ),
        (
            "spectra",
            figures.spectra(result),
            "Spectrum of what is left; a model without a gap lies on the dotted line.",
        ),
        ("portraits", figures.portraits(result), "Phase portraits of the held-out run."),
        ("parameters", figures.parameters(result), "Declared parameters after the refit."),
    ]
    pictures = [(name, data_url(picture), caption) for name, picture, caption in drawings]
    return render(
        "trace.html.j2",
        title=f"Trace of {result.machine.name}",
        report=report,
        sentence=SENTENCES[result.verdict],
        effects=effect_rows(report),
        rests=rest_rows(report),
        errors=error_rows(report),
        balances=report["balances"],
        screening=screening_rows(result),
        detectable=report["detectable"],
        parameters=report["parameters"],
        findings=[(name, f) for name, found in report["findings"].items() for f in found],
        experiments=report["separating_experiments"],
        runs=(
            ", ".join(log.name for log in result.fit_question.logs),
            ", ".join(log.name for log in result.validate_question.logs),
        ),
        pictures=pictures,
        show=number,
    )


def effect_rows(report: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for effect in report["effects"]:
        errors = effect.get("standard_error", {})
        values = [
            f"{key} = {number(value, 4)} ± {number(errors.get(key), 2)}" for key, value in effect["parameters"].items()
        ]
        rows.append(effect | {"values": values, "title": effect["name"].replace("_", " ") or "learned term"})
    return rows


def rest_rows(report: dict[str, Any]) -> list[dict[str, Any]]:
    forms = {
        "plain": "a curve over {}", "direction": "a curve over {} for each direction of motion",
        "product": "velocity times a curve over {}", "tone": "an outside line",
    }  # fmt: skip
    rows = []
    for rest in report["unexplained"]:
        says = forms[rest["form"]].format(rest["depends_on"])
        if rest["frequency_Hz"]:
            says = f"a line at {rest['frequency_Hz']:.2f} Hz that no input has"
        rows.append(rest | {"says": says})
    return rows


def error_rows(report: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for log, channels in report["error"].items():
        for name, row in channels.items():
            after = row["with_effect"]
            over = after / row["noise"] if after is not None and row["noise"] else None
            rows.append({"log": log, "signal": name, **row, "over": over})
    return rows


def screening_rows(result: TraceResult, most: int = 14) -> list[dict[str, Any]]:
    """The first round: each effect's best shape, with the outcome of its refit by simulation where there was one."""
    if not result.search.stages:
        return []
    stage = result.search.stages[0]
    refitted = {rival.candidates[-1].label: rival.reduced for rival in stage.rivals if len(rival.candidates) == 1}
    seen, rows = set(), []
    for line in stage.lines:
        if line.candidate.label in seen:
            continue
        seen.add(line.candidate.label)
        rows.append(
            {
                "name": line.candidate.label,
                "balance": line.candidate.effect.balance,
                "gain": line.gain_chi2 / max(result.base.chi2, 1e-300),
                "cv": line.gain_cv,
                "se": line.gain_se,
                "reduced": refitted.get(line.candidate.label),
            }
        )
    return rows[:most]
