"""report.html of a trace: self-contained, readable without the tool."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from markupsafe import Markup

from hexsim.recording.page import (
    EMPTY,
    Cell,
    Column,
    Report,
    Row,
    Section,
    bar,
    bold,
    cards,
    code,
    join,
    note,
    picture,
    remark,
    small,
    table,
    verdict,
)  # fmt: skip
from hexsim.recording.quantity import plain, quantity, share
from hexsim.recording.summary_table import NOTHING
from hexsim.recording.zoom import zoomable
from hexsim.signals.channels import kind_of
from hexsim.tracing.report import balance_figure, budget, figures, trades
from hexsim.tracing.report.signals import SCALE, channel_words
from hexsim.tracing.report.tables import (
    balance_rows,
    chances,
    detectable_rows,
    effect_rows,
    error_rows,
    known_and_checks,
    parameter_table,
    place_of,
    screening_rows,
    step_table,
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
SEEN = (
    "Held-out run {run} from where its start has died away: the first signal, and of each kind that which the refitted machine gets most "
    "wrong, less the model. Shaded: 95 % of the sensor's noise."
)


def report_page(result: Trace) -> str:
    """The whole page."""
    report, run = result.report, result.validate_problem.logs[0].name
    leg = figures.portrait_leg(result).capitalize() if result.machine.is_hexapod else "The leg"
    answers = figures.answers_of(result)
    makers = {
        "budget": budget.waterfall,
        **({"balances": balance_figure.balances} if result.violations else {}),
        "portraits": partial(figures.portraits, answers=answers),
        "spectra": partial(figures.spectra, answers=answers),
        "parameters": figures.parameters,
        **({"pairs": trades.pairs} if report["trades"] else {}),
    }
    shown = {name: picture(make(result), CAPTIONS[name].format(run=run, leg=leg)) for name, make in makers.items()}
    part, time = figures.shown_part(result), result.validate_problem.logs[0].time
    shown["comparison"] = zoomable(
        figures.comparison_panels(result, answers), figures.comparison(result, answers), CAPTIONS["comparison"].format(run=run),
        SEEN.format(run=run), (float(time[part.start]), float(time[part.stop - 1])),
    )  # fmt: skip
    fitted, held_out = (", ".join(log.name for log in q.logs) for q in (result.fit_problem, result.validate_problem))
    findings = [(note if f["severity"] != "notice" else remark)(f"{name}: {f['description']}.")
                for name, found in report["findings"].items() for f in found]  # fmt: skip
    named = report["verdict"] in ("explained", "partly")
    chance = [small(f"{said[0].upper()}{said[1:]}.") for said in chances(report)]
    pairs = shown.get("pairs", EMPTY)
    return Report(
        f"Trace of {result.machine.name}",
        [
            Section("Error budget", [shown["budget"]]),
            Section("What the model is missing" if named else "Learned from the logs, of unknown cause", effect_parts(report, pairs)),
            Section("Unexplained residuals", unexplained_parts(report)),
            Section("Measured against the model", [*error_parts(result), shown["comparison"]]),
            Section("Balances", [*balance_parts(result), shown.get("balances", EMPTY)]),
            Section("Phase portraits", [shown["portraits"]]),
            Section("Spectra", [shown["spectra"]]),
            Section("Screening of the library", screening_parts(result)),
            Section("Declared parameters", [shown["parameters"], parameter_table(report, judged=True), remark(SHIFTS)]),
            Section("What these runs could have shown", detectable_parts(report)),
            Section("How this was found", [step_table(report)]),
            Section("Logs and sensors", findings),
        ],
        about=f"Measured logs against the declared machine · fitted on {fitted} · judged on {held_out}, which no fit has seen",
        top=[
            verdict(report["verdict"], [verdict_line(result)], [sentence(result), *chance],
                    good=report["verdict"] not in ("unexplained", "partly")),
            *(note(f"Note: {text}.") for text in report["remarks"]),
            *(remark(f"Hidden: {line}.") for line in report["would_show"]),
            cards(figures_first(result)),
        ],
    ).html()  # fmt: skip


SHIFTS = (
    "± is one standard error of the fit. A prior standard deviation is that of a value anywhere inside the declared uncertainty; "
    "shifts beyond ±1.7 are at the limit."
)


def effect_parts(report: Mapping[str, Any], pairs: Markup) -> list[Markup]:
    """Named effects or learned curves with their numbers, and what would tell rivals apart."""
    effects, rows = effect_rows(report), []
    if not effects:
        return []
    for e in effects:
        numbers = join((join([small(name), value], "<br>") for name, value in e["values"]), "<br>") or NOTHING
        gain = e["evidence"]["dBIC"]
        title = join([bold(e["title"]), small(e["description"])], "<br>")
        rows.append(
            (
                title,
                e["where"],
                e["balance"],
                numbers,
                ", ".join(e["ties"]) or NOTHING,
                NOTHING if gain is None else plain(-gain, 2),
            )
        )
    heads = [Column("effect", "wide"), *(Column(head, "text") for head in ("where", "balance", "numbers")), Column("tied with", "wide"),
             "gain in ΔBIC"]  # fmt: skip
    meaning = "± is one standard error. ΔBIC weighs the fall of the misfit against the numbers added: above 10 is strong evidence."
    apart = [note(apart_words(x)) for x in report["separating_experiments"]]
    return [table(heads, rows), remark(meaning), *known_and_checks(effects), pairs, *apart]


def apart_words(x: Mapping[str, Any]) -> Markup:
    """Which motion separates two effects that these runs cannot tell apart."""
    one, other = (bold(name.replace("_", " ")) for name in x["effects"])
    load = " with a heavier load" if "heavier load" in x["description"] else ""
    far = f" (they differ there by {plain(x['chi2'] ** 0.5, 2)} standard deviations)" if (x["chi2"] or 0) >= 100 else ""
    return join(["These runs cannot tell ", one, " from ", other, ": either gives the same answer. ", code(f"hexsim run {x['file']}"),
                 f" is a motion{load} that tells them apart{far}."])  # fmt: skip


def unexplained_parts(report: Mapping[str, Any]) -> list[Markup]:
    """What no effect explains, by balance."""
    rows = [
        (r["balance"], r["where"], quantity(r["rms"], r["unit"]), bold(r["description"]), plain(r["r2_cv"], 2),
         small(", ".join(f"{name} {max(r2, 0):.2f}" for name, r2 in r["others"])))
        for r in unexplained_rows(report)
    ]  # fmt: skip
    heads = [
        "balance",
        Column("where", "text"),
        "residual, rms",
        Column("depends on", "wide"),
        "R²",
        Column("R² of single signals", "wide"),
    ]
    meaning = "R²: share of the residual's variance that the curve predicts in blocks that it was not fitted on; 1 is all of it."
    return [table(heads, rows), remark(meaning)] if rows else []


def error_parts(result: Trace) -> list[Markup]:
    """Held-out errors of each model, the worst of each kind before the fold."""
    report, models = result.report, [("declared", "as declared"), ("refit", "parameters refitted")]
    if result.effects or result.learned:
        models.append(("with_effect", f"with {figures.added(result)}"))
    rows = error_rows(report)

    def cells(row: Mapping[str, Any]) -> tuple[Any, ...]:
        return (
            row["log"],
            row["signal"],
            row["noise"],
            *(cell for key, _ in models for cell in (row[key][0], times(row[key][1]))),
        )

    heads = [
        "run",
        Column("signal", "text"),
        "sensor's noise",
        *(one for _, label in models for one in (label, Column("× noise", "text"))),
    ]
    meaning = (
        "rms of measured − model on held-out motion, after the first seconds; accelerations in the 50 Hz band. × is the multiple of the "
        "sensor's noise, 1 being the best that any model can do."
    )
    return [table(heads, map(cells, rows), [cells(row) for row in rows if row["shown"]]), remark(meaning)]


def times(multiple: float | None) -> Cell:
    """A multiple of the noise, good or not."""
    if multiple is None:
        return Cell("", "times")
    return Cell(f"{plain(multiple)} ×", f"times {'pass' if multiple < 1.1 else 'fail'}")


def balance_parts(result: Trace) -> list[Markup]:
    """Every balance at every place, violated ones and the worst of each name before the fold."""
    rows = balance_rows(result)

    def cells(b: Mapping[str, Any]) -> Row:
        said = Cell("violated", "text fail") if b["violated"] else Cell("holds", "text pass")
        values = (b["name"], small(b["description"]), b["where"], b["size"], plain(b["times"]), plain(b["limit"]), said)
        return Row(values, "off" if b["violated"] else "")

    heads = [
        "balance",
        Column("what must hold", "wide"),
        Column("where", "text"),
        "residual, rms",
        "times noise",
        "holds up to",
        Column("", "text"),
    ]
    meaning = (
        "Each balance is formed from measured signals alone, its own declared parameters fitted inside their uncertainty. It is violated "
        "when its residual is 1.25 times larger than in the worst of 30 simulated runs of the model with the same sensors."
    )
    return [table(heads, map(cells, rows), [cells(b) for b in rows if b["shown"]]), remark(meaning)] if rows else []


def screening_parts(result: Trace) -> list[Markup]:
    """The first round of the search."""
    rows = [
        Row((s["name"], s["balance"], share(s["share"]), bar(s["share"]), plain(s["reduced"], 4),
             s["became"] or "not refitted"),
            "best" if s["became"] in ("named", "tie") else "")
        for s in screening_rows(result)
    ]  # fmt: skip
    heads = ["effect", Column("balance", "text"), "share of the misfit it takes away", Column("", "text"), "misfit after its refit",
             Column("", "text")]  # fmt: skip
    meaning = (
        "The first round, all effects alone. The share is that of one column and only decides who is "
        "refitted by simulation; the misfit after that decides: it is the mean square of measured − model over the noise, 1 at the "
        "noise. Effects that reach the same misfit are a tie."
    )
    return [table(heads, rows), remark(meaning)] if rows else []


def detectable_parts(report: Mapping[str, Any]) -> list[Markup]:
    """The smallest size of each effect that would have been found."""
    beside = any("beside_rest" in d for d in report["detectable"].values())
    rows = [
        (
            d["name"],
            d["size"],
            *([d["beside"]] if beside else []),
            share(d["explained_by_parameters"]),
            small(d["note"]),
        )
        for d in detectable_rows(report)
    ]
    heads = [
        "effect",
        "smallest size seen",
        *(["beside the residual"] if beside else []),
        "hidden by parameters",
        Column("", "wide"),
    ]
    also = (
        " Beside the residual: below that an effect is not named, because what no model of this machine explains could be it, or any "
        "machine has as much."
    )
    meaning = (
        f"An effect below its smallest size would not have been found in these runs.{also if beside else ''} Hidden by parameters: how "
        "much of the effect's trace a shift of declared parameters can copy; near 100 % another motion is needed."
    )
    return [table(heads, rows), remark(meaning)]


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
        f"held-out ones.{tied} The largest error on held-out motion goes from {before} "
        f"to {after} times its sensor's noise.{left}"
    )


def figures_first(result: Trace) -> list[tuple[str, str, str]]:
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
