"""Files of a free-run trace: report.json, report.html, effect.toml, the declared file with what was named and every number as fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tomli_w
from markupsafe import Markup, escape

from hexsim.files.json_files import write_json
from hexsim.inference.formula import Formula
from hexsim.inference.stated import WORDS, chance, stated
from hexsim.inference.verdict import Judgment
from hexsim.own.declaration import Declaration
from hexsim.own.folder import OwnFolder, load_simulated
from hexsim.own.forms import as_effect
from hexsim.own.model import START, model_of
from hexsim.own.run import ABOUT, pictures, report_of, sections, simulated
from hexsim.own.state_file import StateFile
from hexsim.own.trace import OwnTrace, kind_of, trace_own
from hexsim.recording.page import Column, Report, Row, Section, code, join, remark, small, table, verdict

EFFECT = "effect.toml"
Progress = Callable[[str, float], None]


def trace_simulated(
    folder: Path,
    fit: Sequence[str] = (),
    validate: Sequence[str] = (),
    out: Path | None = None,
    progress: Progress = lambda step, share: None,
    state: StateFile | None = None,
    keep: Callable[[dict[str, Any]], None] = lambda report: None,
) -> tuple[OwnTrace, dict[str, Any]]:
    """The trace of a folder that is simulated, and its report. Files go to `out` if given; a formula goes into effect.toml, whose
    lines join the folder's model.toml.

    state: what was fitted until now, and where it is kept. keep: called with the report of what is known, after each round.
    """
    loaded = load_simulated(folder, fit, validate)
    notes = None
    if state is not None:
        notes = state.notebook([Path(loaded.where), folder / "mapping.toml"], [*loaded.fit, *loaded.validate])
    found = trace_own(loaded, progress, notes, lambda known: keep(content(loaded, known)[0]))
    report, made = content(loaded, found)
    if out is not None:
        progress("writing the report", 0.95)
        write_report(report, out, pictures(found.declaration, made))
        (out / "model.toml").write_text(tomli_w.dumps(as_file(found, folder)), encoding="utf-8")
        if found.formula is not None and found.formula.proven:
            fitted = found.formula.best.fitted
            effect = as_effect(found.formula.form, dict(zip(fitted.names, fitted.theta, strict=True)))
            (out / EFFECT).write_text(tomli_w.dumps(effect), encoding="utf-8")
        if (folder / "mapping.toml").is_file():
            (out / "mapping.toml").write_bytes((folder / "mapping.toml").read_bytes())
    progress("done", 1.0)
    return found, report


def content(loaded: OwnFolder, found: OwnTrace) -> tuple[dict[str, Any], dict[str, Any]]:
    """(report.json, run -> (its free run, rms of each output))."""
    with_effects = OwnFolder(
        name=loaded.name,
        where=loaded.where,
        declaration=found.declaration,
        model=model_of(found.declaration, loaded.where),
        fit=loaded.fit,
        validate=loaded.validate,
    )
    made = {log.name: simulated(found.final, log, loaded.where) for log in (*loaded.fit, *loaded.validate)}
    report = report_of(with_effects, found.final, {name: rms for name, (_, rms) in made.items()})
    return report | {
        "verdict": found.verdict,
        "named": [step.title for step in found.steps],
        "held_out_runs": found.errors,
        "remarks": found.remarks,
        "candidates": [
            *(entry(one) | chance(kind_of(one)) for one in found.steps),
            *map(entry, found.found.refused),
            *formula_entry(found.formula),
        ],
    }, made


def write_report(report: dict[str, Any], out: Path, shown: Sequence[Markup] = ()) -> None:
    """report.json and report.html."""
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "report.json", report)
    first, *more = report["verdict"].split("; ")
    tag, _, names = first.partition(": ")
    ended = "incomplete" in report
    names = names[:1].upper() + names[1:] if ended else names
    lines = [*map(plainly, more), *([GO_ON] if ended else [])]
    answer = verdict(tag, [plainly(names or first)], lines, good=bool(report["named"]) and not ended)
    title = f"Trace of {report['machine']}{', incomplete' if ended else ''}"
    page = Report(title, [candidates(report), *sections(report, shown)], about=ABOUT, top=[answer])
    (out / "report.html").write_text(page.html(), encoding="utf-8")


GO_ON = join(["Nothing on this page is final. ", code("hexsim trace --resume"), " with this folder goes on there."])


def plainly(said: str) -> Markup:
    """A part of the verdict, with stated chances in small letters."""
    made = escape(said)
    for kind in WORDS:
        chance = f"({stated(kind)})"
        made = Markup(made.replace(chance, small(chance)))
    return made


def candidates(report: dict[str, Any]) -> Section:
    """The effects that were fitted, an output a row."""
    heads = [
        "effect",
        Column("judgment", "text"),
        "wrong, at most [%]",
        "gain [nats]",
        Column("output", "text"),
        "held out before",
        "with it",
        Column("why", "wide"),
    ]
    rows = [
        Row(
            (
                one["effect"],
                one["verdict"],
                f"{100 * one['wrong']['at_most']:.0f}" if "wrong" in one else "",
                f"{one['nats']:.1f}",
                output,
                f"{e['before']:.3g}",
                f"{e['after']:.3g}",
                one["why"] + (f"; tied with {', '.join(one['tied'])}" if one["tied"] else ""),
            ),
            "best" if one["verdict"] == "named" else "",
        )
        for one in report["candidates"]
        for output, e in one["held_out"].items()
    ]
    explained = (
        "Held out: rms of the simulated residual on parts of the motion that the numbers have not seen. Gain: of their log "
        "predictive density. Wrong: of such verdicts on made-up machines, upper bound at 95 %."
    )
    return Section(
        "Candidates that were fitted", [table(heads, rows), *map(remark, report.get("remarks", ())), remark(explained)]
    )


def write_incomplete(known: dict[str, Any], out: Path, why: str) -> None:
    """The report of a trace that did not come to its end."""
    so_far = f"; so far named: {' + '.join(known['named'])}" if known["named"] else ""
    ended = f"incomplete: the trace did not come to its end: {why}{so_far}"
    write_report(known | {"verdict": ended, "incomplete": {"why": why}}, out)


def entry(one: Judgment) -> dict[str, Any]:
    """Numbers of an effect carry their errors; held-out errors of every output, before and with it."""
    named = {name: one.fitted for name in one.candidate.numbers if name in one.fitted.names}
    return {
        "effect": one.title,
        "verdict": one.verdict,
        "why": one.why,
        "nats": one.nats,
        "by_chance": one.chance,
        "nats_of_parts": one.gains.tolist(),
        "tied": one.tied,
        "held_out": {
            name: {"before": before, "after": after, "t": t} for name, (before, after, t) in one.errors.items()
        },
        "numbers": {
            name: {"value": fitted.value(name), "standard_error": fitted.error(name)} for name, fitted in named.items()
        },
    }


def formula_entry(formula: Formula | None) -> list[dict[str, Any]]:
    if formula is None:
        return []
    said = {"verdict": "formula" if formula.proven else "no form", "why": formula.why or formula.best.why}
    return [entry(formula.best) | said | {"tied": formula.rivals} | (chance("formula") if formula.proven else {})]


def as_file(found: OwnTrace, folder: Path) -> dict[str, Any]:
    """The declaration with the effects of the final model in it, and the fitted numbers as starts."""
    asked: Declaration = found.declaration
    known = dict(zip(found.final.names, found.final.theta, strict=True))
    parameters = {
        name: table.model_copy(update={"start": float(known[name])}) if name in known else table
        for name, table in asked.parameters.items()
    }
    states = {
        name: state.model_copy(update={"guess": float(known[START + name])}) if START + name in known else state
        for name, state in asked.states.items()
    }
    runs = asked.runs.model_copy(update={"folder": str((folder / asked.runs.folder).resolve())})
    return asked.model_copy(update={"parameters": parameters, "states": states, "runs": runs}).model_dump(
        by_alias=True, exclude_none=True, exclude_defaults=True
    )
