"""Self-contained HTML reports: one file with its figures inside, opens without a network and prints."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

import jinja2
import tomli_w

from hexsim import __version__
from hexsim.files.runs_index import PLACE
from hexsim.motion_computer.margins import stability_sentence, worst_figures
from hexsim.recording.config import config_tables
from hexsim.recording.felt import FELT_HEADS, felt_cells, felt_of
from hexsim.recording.quantity import plain, quantity, share, spelled
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit, axis_unit_text
from hexsim.recording.summary_table import axis_header, axis_label, axis_rows, comparison_rows, facts, number

if TYPE_CHECKING:
    from hexsim.simulation import Run

CAPTIONS = {
    "motion": "Does the platform follow? "
    "Setpoint and response of the driven axes. Below: tracking error of each leg, setpoint less position.",
    "acceleration": "What do people feel when the motion reverses? "
    "Top: acceleration over the last periods, raw and in the 50 Hz band, with its reference. Middle: "
    "deviation from the reference, with the largest value at each reversal (upper or lower end of the stroke). Bottom: the "
    "same in the band over the whole run; the shaded part is shown above.",
    "parasitic": "Do the other axes rest? "
    "Accelerations of the axes that have no setpoint motion; zero is ideal. Translations share one scale, "
    "rotations another.",
    "flow_curve": "How wide is the dead band of each valve? "
    "Flow into the chamber over valve voltage, after the fade-in. The close-up shows the dead band of the "
    "overlap. Opening and closing differ by the lag of the spool.",
    "pressures": "What do friction and supply do to the pressures? "
    "Top: chamber and supply pressures of the whole run. Bottom: chamber pressures over the last periods. The "
    "step at each reversal is friction changing sign; the oscillation after it is the hydraulic resonance.",
    "spectrum": "At which frequencies is the deviation? "
    "Amplitude density of the acceleration and of its deviation from the fundamental. Equally spaced lines are "
    "harmonics of the motion, a broad peak is a resonance. The figures of the report count up to the dotted line.",
}


@cache
def environment() -> jinja2.Environment:
    """Templates of this package; everything that is put in is escaped."""
    loader = jinja2.PackageLoader("hexsim.recording", "templates")
    made = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.filters |= {"number": number, "plain": plain, "quantity": quantity, "share": share, "spelled": spelled}
    made.filters["question"] = question
    return made


def question(caption: str) -> tuple[str, str]:
    """The question that a figure answers, which its caption begins with, and the rest of the caption."""
    asked, mark, rest = caption.partition("? ")
    return (f"{asked}?", rest) if mark else ("", caption)


def data_url(picture: bytes) -> str:
    """A PNG as text inside the page."""
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")


def render(template: str, loader: jinja2.BaseLoader | None = None, **values: Any) -> str:
    """A page with what every page shows. loader: of templates beside those of this package."""
    common = {"version": __version__, "written": f"{datetime.now():%Y-%m-%d %H:%M}"}
    made = environment()
    if loader is not None:
        made = made.overlay(loader=jinja2.ChoiceLoader([loader, made.loader or loader]))
    return with_contents(made.get_template(template).render(**common, **values))


def with_contents(page: str) -> str:
    """The page with a table of its headings, and a place for a link to the page of all runs."""
    titles: list[str] = []

    def anchored(found: re.Match[str]) -> str:
        titles.append(found[1])
        return f'<h2 id="part-{len(titles)}">{found[1]}</h2>'

    page = re.sub(r"<h2>(.*?)</h2>", anchored, page, flags=re.DOTALL)
    links = " · ".join(f'<a href="#part-{k}">{title}</a>' for k, title in enumerate(titles, 1))
    return page.replace("<!-- contents -->", f'<nav class="contents">{links} {PLACE}</nav>', 1)


def run_report(run: Run, pictures: Mapping[str, bytes]) -> str:
    """The page of one run; pictures: name -> PNG."""

    driven = Signals.of_run(run).driven_axes
    return render(
        "run.html.j2",
        title=f"{run.scenario.name} on {run.machine.name}",
        summary=run.summary,
        run=run,
        sentence=run_sentence(run.summary, driven),
        cards=cards(run.summary, driven),
        loop=worst_figures(run.machine),
        loop_sentence=stability_sentence,
        header=axis_header(run.summary),
        rows=axis_rows(run.summary, driven),
        facts=facts(run.summary, run),
        pictures=[(name, data_url(data), CAPTIONS.get(name, "")) for name, data in pictures.items()],
        config=tomli_w.dumps(config_tables(run)),
    )


def run_sentence(summary: Mapping[str, Any], driven: tuple[str, ...]) -> str:
    """The result in one sentence: the worst deviation, beside the motion itself and the axes at rest."""
    axis = next((name for name in driven if name in summary["axes"]), None)
    peak = summary["axes"][axis].get(f"peak_band_{axis_unit(axis)}") if axis else None
    if axis is None or peak is None:
        return ""
    unit, harmonic = axis_unit(axis), summary["axes"][axis].get(f"fundamental_{axis_unit(axis)}")
    where = "of the leg" if axis == "leg" else f"in {AXIS_NAMES[axis]}"
    description = f"The acceleration {where} deviates by up to {number(peak)} {unit.replace('_s2', '/s²')}"
    if harmonic:
        description += f" from its fundamental, {number(peak / harmonic, 2)} times that harmonic's amplitude"
    rest: dict[str, float] = {}
    for other, figures in summary["axes"].items():
        own = axis_unit(other)
        if other not in driven and figures.get(f"peak_band_{own}") is not None:
            rest[own] = max(rest.get(own, 0.0), figures[f"peak_band_{own}"])
    moved = " and ".join(f"{number(value)} {own.replace('_s2', '/s²')}" for own, value in rest.items())
    return f"{description}. Axes that should rest stay within {moved}." if moved else f"{description}."


def comparison_sentence(tables: list[dict[str, Any]]) -> str:
    """Which compensator is smoothest, and by how much; the axes of each where there are several."""
    best: dict[str, list[str]] = {}
    description = ""
    for table in tables:
        rows = [row for row in table["rows"] if row["peak_band"] is not None and not row["note"]]
        if len(rows) < 2:
            return ""
        first, smoothest = table["rows"][0], min(rows, key=lambda row: row["peak_band"])
        best.setdefault(smoothest["name"], []).append(table["axis"])
        description = f"its largest deviation is {number(smoothest['peak_band'])} {table['unit']}"
        if smoothest is not first and smoothest["ratio"]:
            description += f", {share(smoothest['ratio'])} of the {number(first['peak_band'])} with {first['name']}"
    if len(tables) == 1:
        return f"Smoothest is {next(iter(best))}: {description}."
    return "Smoothest: " + "; ".join(f"{name} in {', '.join(axes)}" for name, axes in best.items()) + "."


def cards(summary: Mapping[str, Any], driven: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """The figures to see first, of the first driven axis: (value, unit, what it is)."""
    axis = next((name for name in driven if name in summary["axes"]), None)
    if axis is None:
        return []
    unit = axis_unit(axis)
    shown, figures = axis_unit_text(axis), summary["axes"][axis]
    band = f"{summary['bandwidth_Hz']:g}"
    return [
        (number(figures.get(f"peak_band_{unit}")), shown, f"peak in the {band} Hz band, {AXIS_NAMES[axis]}"),
        (number(figures.get(f"peak_raw_{unit}")), shown, "peak without band limit"),
        (number(figures.get(f"bump_pp_{unit}")), shown, "largest reversal bump, peak to peak"),
        (number(figures.get(f"fundamental_{unit}")), shown, "fundamental"),
    ]


def _axis_pictures(pictures: Mapping[str, bytes], prefix: str) -> list[tuple[str, str]]:
    """(axis, data URL) of the pictures whose names begin so."""
    return [
        (axis_label(name.removeprefix(prefix)), data_url(data))
        for name, data in pictures.items()
        if name.startswith(prefix)
    ]


def comparison_report(runs: Mapping[str, Run], pictures: Mapping[str, bytes]) -> str:
    """The page of runs side by side; pictures: name -> PNG."""

    first = next(iter(runs.values()))
    driven = [axis for axis in Signals.of_run(first).driven_axes if axis in first.summary["axes"]]
    tables = []
    for axis in driven:
        rows = comparison_rows(runs, axis)
        peaks = [row["peak_band"] for row in rows if row["peak_band"] is not None and not row["note"]]
        tables.append(
            {
                "axis": AXIS_NAMES[axis],
                "unit": axis_unit_text(axis),
                "rows": rows,
                "best": min(peaks, default=None),
                "largest": max(peaks, default=None),
            }
        )
    return render(
        "comparison.html.j2",
        title=f"{first.scenario.name} on {first.machine.name}: compensators side by side",
        scenario=first.scenario,
        sentence=comparison_sentence(tables),
        tables=tables,
        band=f"{first.summary['bandwidth_Hz']:g}",
        facts=[fact for fact in facts(first.summary, first) if fact[0] in ("duration", "model", "seed")],
        warnings=sorted({text for run in runs.values() for text in run.warnings if text != run.reason}),
        messages=[(name, *message) for name, run in runs.items() for message in run.messages],
        pictures=_axis_pictures(pictures, "comparison_"),
        bumps=_axis_pictures(pictures, "bumps_"),
        people={
            axis: [(name, felt_cells(axes[axis])) for name, axes in felt_of(runs).items() if axis in axes]
            for axis in driven
        },
        felt_heads=FELT_HEADS,
        config=tomli_w.dumps(config_tables(first)),
    )
