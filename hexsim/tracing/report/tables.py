"""The tables of a trace's page: rows of words and numbers with their units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from markupsafe import Markup

from hexsim.inference.stated import hydraulic, stated
from hexsim.recording.page import MOST_ROWS, Column, code, join, note, table
from hexsim.recording.quantity import plain, quantity, split_key, with_error
from hexsim.signals.channels import kind_of
from hexsim.tracing import rules
from hexsim.tracing.balances import caption_of
from hexsim.tracing.dependence import behind_low_pass
from hexsim.tracing.report import balance_figure
from hexsim.tracing.report.readings import numbers_of, term_sentence, total_sentence
from hexsim.tracing.report.signals import SIGNALS, channel_words
from hexsim.tracing.state import Trace, Violation

FORMS = {
    "plain": "a curve over the {}",
    "direction": "a curve over the {} for each direction of motion",
    "product": "the velocity times a curve over the {}",
    "memory": "a curve over the low-passed {}, opposing the motion",
    "late": "the error that a delay of the {} would make",
    "play": "the error that backlash in the measured {} would make",
    "size": "of either sign; only its size follows the {}",
}


def place_of(rest: Mapping[str, Any]) -> str:
    return f"the {rest['balance']} balance of {rest['place']}: {rest['description']}."


def effect_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for effect in report["effects"]:
        values = numbers_of(effect) if effect["name"] else []
        values += [
            (f"or, as {own['name'].replace('_', ' ')}: {words}", value)
            for own in effect.get("one_term_with", [])
            for words, value in numbers_of(own)
        ]
        title, description = effect["name"].replace("_", " "), effect["description"]
        if not title:
            over = behind_low_pass(SIGNALS[effect["curve"]["signal"]][0], effect["curve"].get("memory_s"))
            title, description = "learned curve", f"{FORMS[effect['curve']['form']].format(over)}, of unknown cause"
        tied = [name.replace("_", " ") for name in effect["tied_with"]]
        own = {"values": values, "title": title, "description": description, "ties": tied}
        known = {"term": term_sentence(effect), "total": total_sentence(effect)}
        rows.append(effect | own | known | {"checks": checks_of(effect)})
    return rows


def checks_of(effect: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(name, what to check first on the machine) of an effect, and of its term's other names."""
    rows = (effect, *effect.get("one_term_with", []))
    return [(own["name"], own["check_first"]) for own in rows if own.get("check_first")]


def chances(report: Mapping[str, Any]) -> list[str]:
    """How often such names were wrong, one sentence a kind."""
    kinds = (hydraulic(report["verdict"], e["tied_with"]) for e in report.get("effects", []) if e["name"])
    return [stated(kind) for kind in dict.fromkeys(kinds)]


def known_and_checks(effects: Iterable[Mapping[str, Any]]) -> list[Markup]:
    """What is known of effects, and what to check first on the machine."""
    rows = list(effects)
    known = [f"What is known is the {row['term']}." for row in rows if row["term"]]
    known += [f"What is known is the sum: {row['total']}." for row in rows if row["total"]]
    checks = [
        join([f"Check first on the machine, for {name.replace('_', ' ')}: {check}. ", code(f"hexsim trace --explain {name}"),
              " tells more."])
        for row in rows for name, check in row["checks"]
    ]  # fmt: skip
    return [note(text) for text in (*known, *checks)]


def parameter_table(report: Mapping[str, Any], *, judged: bool) -> Markup:
    """Declared and fitted parameters; judged: with their shifts."""
    rows = parameter_rows(report)
    heads: list[str | Column] = ["parameter", "declared", "fitted"]
    if not judged:
        return table(heads, [(p["name"], p["from"], p["to"]) for p in rows])
    heads += ["shift", "in prior standard deviations", Column("", "text")]
    return table(heads, [
        (p["name"], p["from"], p["to"], f"{plain(p['percent'], 2)} %", plain(p["shift_sigma"], 2),
         "at its limit" if p["at_bound"] else "")
        for p in rows
    ])  # fmt: skip


def step_table(report: Mapping[str, Any]) -> Markup:
    """What each step decided."""
    rows = [(s["name"], s["sentence"], f"{s['seconds']:.1f}") for s in report["steps"]]
    return table(["step", Column("decided", "wide"), "time [s]"], rows)


def unexplained_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for rest in report["unexplained"]:
        signal = SIGNALS.get(rest["depends_on"], (rest["depends_on"],))[0]
        memory_s = None if rest["form"] == "memory" else rest["memory_s"]
        description = FORMS.get(rest["form"], "").format(behind_low_pass(signal, memory_s))
        if rest["frequency_Hz"]:
            description = f"a tone at {rest['frequency_Hz']:.2f} Hz that no input contains"
        others = sorted(
            (
                (SIGNALS[name][0], r2)
                for name, r2 in rest["r2_of_signals"].items()
                if name in SIGNALS and r2 is not None
            ),
            key=lambda entry: -entry[1],
        )
        place = rest["where"] if rest["where"].startswith(("leg ", "all legs")) else f"the {rest['where']}"
        rows.append(rest | {"description": description, "place": place, "others": others[:4]})
    return rows


def error_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Held-out errors, each with its multiple of the noise. shown: the worst of its kind, where there are many."""
    rows, worst = [], {}
    for log, channels in report["error"].items():
        for name, row in channels.items():
            unit, noise = split_key(name)[1], row["noise"]
            cells = {
                model: (quantity(row[model], unit), row[model] / noise if row[model] and noise else None)
                for model in ("declared", "refit", "with_effect")
            }
            rows.append({"log": log, "signal": channel_words(name), "noise": quantity(noise, unit), **cells})
            kind = (log, kind_of(name))
            if kind not in worst or (cells["refit"][1] or 0) > (worst[kind]["refit"][1] or 0):
                worst[kind] = rows[-1]
    chosen = {id(row) for row in worst.values()}
    return [row | {"shown": len(rows) <= MOST_ROWS or id(row) in chosen} for row in rows]


def balance_rows(result: Trace) -> list[dict[str, Any]]:
    """Every balance at every place. shown: violated, or the worst of its name, where there are many."""
    worst: dict[str, Violation] = {}
    for line in sorted(result.violations, key=lambda v: -v.above_null):
        worst.setdefault(line.name, line)
    few = len(result.violations) <= MOST_ROWS
    return [
        {
            "name": line.name,
            "description": caption_of(line.name),
            "where": balance_figure.place_words(line),
            "size": quantity(line.rms, balance_figure.unit_of(line)),
            "times": line.violation,
            "limit": rules.VIOLATED * max(line.null, 1.0),
            "violated": line.violated,
            "shown": few or line.violated or line is worst[line.name],
        }
        for line in result.violations
    ]


def detectable_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        d | {"name": name.replace("_", " "), "size": quantity(d["theta_min"], d["unit"]),
             "beside": quantity(d["beside_rest"], d["unit"]) if d.get("beside_rest") else "",
             "note": d.get("description") or (f"shown by {d['shown_by']}" if d.get("shown_by") else "")}
        for name, d in report["detectable"].items()
    ]  # fmt: skip


def parameter_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for key, p in report["parameters"].items():
        name, unit = split_key(key)
        shift = p["fitted"] / p["declared"] - 1 if p["declared"] else math.nan
        fitted = with_error(p["fitted"], p["standard_error"], unit)
        rows.append(p | {"name": name, "from": quantity(p["declared"], unit, 4), "to": fitted, "percent": 100 * shift})
    return rows


def screening_rows(result: Trace, most: int = 14) -> list[dict[str, Any]]:
    """The first round: each effect's best shape, and what became of it."""
    if not result.search.stages:
        return []
    stage = result.search.stages[0]
    refitted = {rival.candidates[-1].label: rival.reduced for rival in stage.rivals if len(rival.candidates) == 1}
    named = {effect.candidate.label: result.final.reduced for effect in result.effects}
    tied = {label: rival.reduced for rivals in result.ties for label, rival in rivals.items()}
    refitted |= tied | named
    rows: dict[str, dict[str, Any]] = {}
    for line in stage.lines:
        label = line.candidate.label
        if label in rows:
            continue
        became = "named" if label in named else "tie" if label in tied else "refitted" if label in refitted else ""
        rows[label] = {
            "name": label.replace("_", " "),
            "balance": line.candidate.effect.balance,
            "share": line.share,
            "reduced": refitted.get(label),
            "became": became,
        }
    shown = list(rows.values())
    return shown[:most] + [row for row in shown[most:] if row["became"]]
