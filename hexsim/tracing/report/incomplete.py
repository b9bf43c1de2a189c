"""The report of a trace that ended before its end: what is known, and that nothing is judged yet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hexsim.files.atomic import write_text
from hexsim.files.json_files import write_json
from hexsim.hydraulics.effects.effect import EffectParameter
from hexsim.recording.page import Cell, Column, Report, Section, code, join, table, verdict
from hexsim.recording.quantity import plain, quantity, split_key
from hexsim.tracing.report.content import balance_entry, finite, parameter_entries, report_of
from hexsim.tracing.report.tables import parameter_table, step_table
from hexsim.tracing.state import Trace
from hexsim.tracing.steps import STEPS


def incomplete_report(state: Trace, why: str) -> dict[str, Any]:
    """The content of report.json so far. verdict: "incomplete"; effects are what the last step names, and not judged.

    Without what only a whole trace has: budget, errors, experiments.
    """
    done = len(state.steps) - 1
    left = [step.name for step in STEPS[done:]]
    known = {
        "machine": state.machine.name,
        "balances": [balance_entry(line) for line in state.violations],
        "parameters": parameter_entries(state),
        "steps": [{"name": s.name, "seconds": round(s.seconds, 2), "sentence": s.sentence} for s in state.steps],
    }
    whole = report_of(state) if done else {}
    hypothesis = [
        {"name": own.effect.name, "where": own.where, "parameters": {key: finite(x) for key, x in values.items()}}
        for own, values in zip(state.final.candidates, state.final.values, strict=True)
    ]
    return {
        **whole,
        **known,
        "verdict": "incomplete",
        "effects": [],
        "hypothesis": hypothesis,
        "incomplete": {"why": why, "last_step": state.steps[-1].name, "steps_left": left},
    }


def in_words(one: EffectParameter, values: Mapping[str, float]) -> str:
    """A number of an effect with its unit."""
    return f"{split_key(one.name)[0]} {quantity(values[one.name], one.unit)}" if one.name in values else ""


def write_incomplete(state: Trace, folder: Path, why: str) -> None:
    """report.json and report.html, without pictures: quick, and without a simulation."""
    report = incomplete_report(state, why)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "report.json", report)
    fit, held_out = (", ".join(log.name for log in q.logs) for q in (state.fit_problem, state.validate_problem))
    left = ", ".join(report["incomplete"]["steps_left"]) or "the report"
    said = f"Nothing on this page is judged. The last step that ended is “{report['incomplete']['last_step']}”; missing: {left}. "
    hypothesis = [
        (own.effect.name.replace("_", " "), own.where, join((in_words(one, values) for one in own.effect.parameters), "<br>"))
        for own, values in zip(state.final.candidates, state.final.values, strict=True)
    ]  # fmt: skip
    balances = [
        (b["name"], b["where"], plain(b["violation"]), Cell("violated", "text fail") if b["violated"] else Cell("holds", "text pass"))
        for b in report["balances"]
    ]  # fmt: skip
    text = [Column("where", "text"), Column("numbers", "wide"), Column("", "text")]
    page = Report(
        f"Trace of {state.machine.name}, incomplete",
        [
            Section("Hypothesis so far, not judged", [table(["effect", *text[:2]], hypothesis)]),
            Section("What was done", [step_table(report)]),
            Section("Balances", [table(["balance", text[0], "times noise", text[2]], balances)]),
            Section("Declared parameters so far", [parameter_table(report, judged=False)]),
        ],
        about=f"Measured logs against the declared machine · fitted on {fit} · held out: {held_out}",
        top=[verdict("incomplete", [f"This trace did not come to its end: {why}"],
                     [join([said, code("hexsim trace --resume"), " with this folder goes on there."])], good=False)],
    )  # fmt: skip
    write_text(folder / "report.html", page.html())
