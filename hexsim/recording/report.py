"""Self-contained HTML reports: one file with its figures inside, opens without a network and prints."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

import jinja2
import tomli_w

from hexsim import __version__
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit
from hexsim.recording.summary_table import axis_header, axis_rows, facts, number

if TYPE_CHECKING:
    from hexsim.simulation import Run

CAPTIONS = {
    "motion": "What was asked and what the machine did; below, how far each leg lags its setpoint.",
    "acceleration": "Top: the last periods as recorded, in the 50 Hz band, and what was wanted. Middle: what is left, "
    "with the largest deviation at each reversal. Bottom: the whole run; the shaded part is the close-up.",
    "parasitic": "Axes that were not asked to move. Translations share one scale, rotations another.",
    "flow_curve": "Flow of each valve over its voltage, from the end of the fade-in. The close-up shows the dead band.",
    "pressures": "Bottom pressures. A step at each reversal is friction changing sign; ringing is the oil's resonance.",
    "spectrum": "Even spacing is harmonics of the motion; a hump is a resonance. What lies right of the dotted line is "
    "outside the band of the figures.",
}


@cache
def environment() -> jinja2.Environment:
    """Templates of this package; everything that is put in is escaped."""
    loader = jinja2.PackageLoader("hexsim.recording", "templates")
    made = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.filters["number"] = number
    return made


def data_url(picture: bytes) -> str:
    """A PNG as text inside the page."""
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")


def render(template: str, **values: Any) -> str:
    """A page of this package's templates, with what every page shows."""
    common = {"version": __version__, "written": f"{datetime.now():%Y-%m-%d %H:%M}"}
    return environment().get_template(template).render(**common, **values)


def run_report(run: Run, pictures: Mapping[str, bytes]) -> str:
    """The page of one run; pictures: name -> PNG."""
    from hexsim.recording.run_files import config_tables  # writes the same tables to config.toml

    driven = Signals.of_run(run).driven_axes
    return render(
        "run.html.j2",
        title=f"{run.scenario.name} on {run.machine.name}",
        summary=run.summary,
        run=run,
        cards=cards(run.summary, driven),
        header=axis_header(run.summary),
        rows=axis_rows(run.summary, driven),
        facts=facts(run.summary, run),
        pictures=[(name, data_url(data), CAPTIONS.get(name, "")) for name, data in pictures.items()],
        config=tomli_w.dumps(config_tables(run)),
    )


def cards(summary: Mapping[str, Any], driven: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """The figures to see first, of the first driven axis: (value, unit, what it is)."""
    axis = next((name for name in driven if name in summary["axes"]), None)
    if axis is None:
        return []
    unit = axis_unit(axis)
    shown, figures = unit.replace("_s2", "/s²"), summary["axes"][axis]
    band = f"{summary['bandwidth_Hz']:g}"
    return [
        (number(figures.get(f"peak_band_{unit}")), shown, f"peak in the {band} Hz band, {AXIS_NAMES[axis]}"),
        (number(figures.get(f"peak_raw_{unit}")), shown, "peak without band limit"),
        (number(figures.get(f"bump_pp_{unit}")), shown, "largest reversal bump, peak to peak"),
        (number(figures.get(f"fundamental_{unit}")), shown, "basic harmonic"),
    ]


def comparison_report(runs: Mapping[str, Run], pictures: Mapping[str, bytes]) -> str:
    """The page of runs side by side; pictures: name -> PNG."""
    from hexsim.compare import comparison_rows
    from hexsim.recording.run_files import config_tables

    first = next(iter(runs.values()))
    driven = [axis for axis in Signals.of_run(first).driven_axes if axis in first.summary["axes"]]
    tables = []
    for axis in driven:
        rows = comparison_rows(runs, axis)
        peaks = [row["peak_band"] for row in rows if row["peak_band"] is not None and not row["note"]]
        tables.append(
            {
                "axis": AXIS_NAMES[axis],
                "unit": axis_unit(axis).replace("_s2", "/s²"),
                "rows": rows,
                "best": min(peaks, default=None),
                "largest": max(peaks, default=None),
            }
        )
    return render(
        "comparison.html.j2",
        title=f"{first.scenario.name} on {first.machine.name}: compensators side by side",
        scenario=first.scenario,
        tables=tables,
        band=f"{first.summary['bandwidth_Hz']:g}",
        facts=[fact for fact in facts(first.summary, first) if fact[0] in ("duration", "model", "seed")],
        warnings=sorted({text for run in runs.values() for text in run.warnings if text != run.reason}),
        messages=[(name, *message) for name, run in runs.items() for message in run.messages],
        pictures=[(name, data_url(data)) for name, data in pictures.items()],
        config=tomli_w.dumps(config_tables(first)),
    )
