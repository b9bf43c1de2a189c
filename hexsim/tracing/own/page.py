"""report.html of a machine with balances of its own: self-contained, the error budget first."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from hexsim.recording import palette
from hexsim.recording.figure_style import MOST_POINTS, PAPER, legend, new_figure, png, styled
from hexsim.recording.page import (
    EMPTY,
    Column,
    Report,
    Row,
    Section,
    code,
    folded,
    join,
    lead,
    note,
    picture,
    remark,
    table,
    verdict,
)
from hexsim.recording.quantity import plain, quantity
from hexsim.recording.zoom import Curve, Panel, still, zoomable
from hexsim.tracing.own.analysis import OwnTrace
from hexsim.tracing.own.folder import OwnMachine

SHOWN_S = 30.0  # of a run
NOTHING_MISSING = "nothing missing"
VERDICTS = ("explained in part", "unexplained", NOTHING_MISSING)  # how a balance's verdict begins
STEPS = (("declared", "as declared"), ("refit", "refitted"), ("with_terms", "with the terms"))
SHADES = {"declared": "0.75", "refit": "0.5", "with_terms": "#1f5fa8"}


def own_page(machine: OwnMachine, traces: Sequence[OwnTrace], report: Mapping[str, Any]) -> str:
    """The whole page."""
    findings = [(run if k == 0 else "", one) for run, said in report["findings"].items() for k, one in enumerate(said)]
    balances = [balance_section(trace, balance) for trace, balance in zip(traces, report["balances"], strict=True)]
    logs = Section("Logs", [table(["run", Column("what was read, repaired and moved", "wide")], findings)])
    runs = ", ".join(point.log.name for point in machine.fit)
    about = f"Balances of this machine's own, each number chosen without the run that it is scored on · runs: {runs}"
    answers = (
        f"{b['name'].capitalize()} balance: {b['verdict'].partition(':')[0].partition(';')[0]}."
        for b in report["balances"]
    )
    return Report(f"Trace of {machine.name}", [*balances, logs], about=about, top=[*map(lead, answers)]).html()


def incomplete_page(report: Mapping[str, Any], why: str) -> str:
    """The page of a trace that ended early: the verdicts of the balances that it came to, without figures."""
    rows = [(name.capitalize(), said.replace(" -> ", " → ")) for name, said in report["verdict"].items()]
    go_on = join(
        [
            "Balances that are not below were not traced. ",
            code("hexsim trace --resume"),
            " with this folder goes on there.",
        ]
    )
    return Report(
        f"Trace of {report['machine']}, incomplete",
        [Section("Balances so far", [table(["balance", Column("verdict", "wide")], rows)])],
        about="Balances of this machine's own",
        top=[verdict("incomplete", [f"This trace did not come to its end: {why}"], [go_on], good=False)],
    ).html()


def balance_section(trace: OwnTrace, b: Mapping[str, Any]) -> Section:
    """Verdict, budget and coefficients of one balance with its figures."""
    said, unit = b["verdict"], b["unit"]
    tag = next((one for one in VERDICTS if said.startswith(one)), "")
    first, *rest = re.sub(r"^( by |[:;] )", "", said.removeprefix(tag)).replace(" -> ", " → ").split("; ")
    more = [*b["remarks"], *(f"run {run}: {text}" for run, text in b["pulses"].items()), f"Next: {b['next']}"]
    most = max(row["refit"] for row in b["budget"])
    budgets = [
        (row["run"], "held out in turn" if row["held_out"] == "fold" else "never seen",
         *(quantity(row[key], unit, beside=most) for key, _ in STEPS),
         (" + ".join(row["chosen"]) or "none") if "chosen" in row else "")
        for row in b["budget"]
    ]  # fmt: skip
    heads = ["run", Column("", "text"), *(label for _, label in STEPS), Column("chosen without it", "wide")]
    declared = any(c["declared"] is not None for c in b["coefficients"].values())
    numbers = [
        "number",
        "value",
        "± over runs",
        *(["declared"] if declared else []),
        *(["place"] if b["places"] else []),
    ]
    coefficients = [
        Row((name, quantity(c["value"], c["unit"], 5), quantity(c["standard_error"], c["unit"], 2),
             *([quantity(c["declared"], c["unit"], 5)] if declared else []),
             *([plain(b["places"][name]["place"], 5) if name in b["places"] else ""] if b["places"] else [])),
            "best" if name in b["named"] else "")
        for name, c in b["coefficients"].items()
    ]  # fmt: skip
    seen = [(name, quantity(d["theta_min"], d["unit"])) for name, d in b["detectable"].items()]
    return Section(f"{b['name'].capitalize()} balance", [
        verdict(tag, [capital(first)], [*map(capital, rest), *more], good=tag == NOTHING_MISSING),
        picture(png(budget(trace)), BUDGET),
        table(heads, budgets), remark("rms of the residual."),
        table(numbers, coefficients),
        time_figure(trace), picture(png(rest_over(trace)), OVER if b["depends_on"]["signal"] != "none" else OVER_TIME),
        *map(note, b["extremes"]),
        folded("What these runs would have shown", [table(["candidate", "smallest size seen"], seen)]) if seen else EMPTY,
        *(note(f"Candidate left out: {text}.") for text in b["refused"]),
    ])  # fmt: skip


def capital(words: str) -> str:
    return words[:1].upper() + words[1:]


BUDGET = (
    "How much does each run leave, step by step? "
    "Error budget: rms of what the balance leaves on each run that was held out, as declared, with the declared numbers "
    "refitted, and with the terms that were chosen without that run. A good step makes every run's bar shorter."
)
TIME = (
    "When is it off? "
    "The balance in time, on one run: what must be explained, and what is left. Pale bands are pulses found in the residual."
)
OVER_TIME = "On which signal does the residual depend? On no single one; here it is over time, the line is the mean of narrow bins."
SEEN = "What must be explained, and what is left, on one run. Shaded: pulses found in the residual."
OVER = (
    "On which signal does the residual depend? "
    "What is left over the signal that it depends on most; the line is the mean of narrow bins."
)


@styled
def budget(trace: OwnTrace) -> Figure:
    """Bars a run: declared, refitted, with the terms."""
    rows = [
        (f.held_out, {"declared": f.declared, "refit": f.refit, "with_terms": f.with_terms})
        for f in trace.verdict.folds
    ]
    rows += [(f"{run} (held out)", dict(row)) for run, row in trace.held_out.items()]
    figure, (plot,) = new_figure(1, f"Error budget of the {trace.balance.name} balance", height=1.4 + 0.42 * len(rows))
    for k, (key, label) in enumerate(STEPS):
        at = np.arange(len(rows)) + 0.26 * (k - 1)
        plot.barh(at, [row[key] for _, row in rows], height=0.24, color=SHADES[key], label=label)
    plot.set_yticks(np.arange(len(rows)), [name[:40] for name, _ in rows])
    plot.invert_yaxis()
    sizes = [size for _, row in rows for size in row.values() if size > 0.0]
    wide = bool(sizes) and max(sizes) > 10.0**PAPER.wide * min(sizes)
    if wide:
        plot.set_xscale("log")
        plot.set_xlim(left=0.5 * min(sizes))
        plot.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    plot.set_xlabel(f"rms of the residual [{trace.balance.unit}]" + (", logarithmic" if wide else ""))
    legend(plot)
    return figure


def time_figure(trace: OwnTrace) -> Markup:
    """Target and residuals over a whole run, with events if one has some, to be looked at closely, with their picture."""
    name = next((run for run, found in trace.events.items() if found), next(iter(trace.rests)))
    time, target, before, after = trace.rests[name]
    title, unit = f"{trace.balance.name} balance on {name}", trace.balance.unit
    upper = [Curve("target", target, palette.REFERENCE, 2.0), Curve("terms", target - after, palette.RESPONSE)]
    lower = [
        Curve("residual, refitted", before, palette.RAW),
        Curve("residual, with the terms", after, palette.RESPONSE),
    ]
    spans = [(event.start_s, event.stop_s) for event in trace.events[name]]
    panels = [Panel(f"{title} [{unit}]", time, upper), Panel(f"residual [{unit}]", time, lower, spans=spans)]
    first = max(spans[0][0] - 2.0, 0.0) if spans else 0.0
    view = (first, first + SHOWN_S)
    return zoomable(panels, png(still(panels, title, view)), TIME, SEEN, view)


@styled
def rest_over(trace: OwnTrace) -> Figure:
    """The rest over the signal of its strongest dependence."""
    signal = trace.verdict.depends_on[0]
    signal = "time_s" if signal == "none" else signal
    x, y = trace.spread[signal]
    figure, (plot,) = new_figure(1, f"Residual of the {trace.balance.name} balance over {signal}", height=3.4)
    thin = slice(None, None, max(len(x) // MOST_POINTS, 1))
    plot.plot(x[thin], y[thin], ".", ms=2.0, color="0.7", label="samples of all runs")
    edges = np.unique(np.quantile(x, np.linspace(0, 1, 41)))
    edges = edges if len(edges) > 1 else np.append(edges, edges[0] + 1.0)
    place = np.clip(np.searchsorted(edges, x) - 1, 0, len(edges) - 2)
    count = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)
    middle, mean = (np.bincount(place, v, minlength=len(edges) - 1) / count for v in (x, y))
    plot.plot(middle, mean, color="#b3261e", label="mean of bins")
    plot.set_xlabel(signal)
    plot.set_ylabel(f"residual [{trace.balance.unit}]")
    legend(plot)
    return figure
