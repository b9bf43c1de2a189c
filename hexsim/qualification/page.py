"""The page of a qualification: limits, figures, plots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jinja2

from hexsim.qualification.battery import Findings
from hexsim.qualification.plots import CAPTIONS, pictures
from hexsim.qualification.rows import Row
from hexsim.recording.report import data_url, render
from hexsim.recording.summary_table import number


def page(title: str, how: str, found: Findings, config: str, notes: Sequence[str] = ()) -> str:
    """report.html. config: the machine's file; notes: what restricts the figures, a sentence each."""
    judged = [row for row in found.rows if row.passed is not None]
    return render(
        "qualification.html.j2",
        jinja2.PackageLoader("hexsim.qualification", "templates"),
        title=title,
        how=how,
        sentence=_sentence(judged) if judged else "No figure of this motion has a limit.",
        notes=notes,
        passed=sum(row.passed is True for row in judged),
        judged=judged,
        cards=_cards(found.rows),
        tables=_tables(found.rows),
        pictures=[(name, data_url(data), CAPTIONS[name]) for name, data in pictures(found.curves).items()],
        config=config,
    )


def _sentence(judged: list[Row]) -> str:
    """How many limits are kept, and which are not, the furthest off first."""
    outside = sorted((r for r in judged if not r.passed), key=lambda r: -(r.value or 0.0) / (r.limit or 1.0))
    if not outside:
        return f"All {len(judged)} limits are kept."
    names = "; ".join(f"{r.test} in {r.axis} ({(r.value or 0.0) / (r.limit or 1.0):.1f} times)" for r in outside)
    return f"{len(judged) - len(outside)} of {len(judged)} limits are kept. Beyond its limit: {names}."


def _cards(rows: list[Row]) -> list[tuple[str, str, str]]:
    """The figures to see first."""

    shown = (
        ("turn-around", "largest deviation", "turn-around deviation, heave"),
        ("half-hertz noise", "peak, 50", "half-hertz peak, heave"),
        ("describing function", "phase passes", "phase passes −90°, heave"),
    )
    cards = []
    for test, figure, description in shown:
        row = next((r for r in rows if r.test == test and r.axis == "heave z" and r.figure.startswith(figure)), None)
        if row is not None:
            cards.append((number(row.value), row.unit, description))
    return cards


DESCRIPTIONS = {
    "half-hertz noise": """\
Sine of 0.05 m or 5 deg at 0.5 Hz. Ratios are rms over the fundamental's: r_n of all that is not the
fundamental, r_lf of its 2nd and 3rd harmonics, r_hf of those above. Parasitic: the largest peak in the other axes of the same
kind. Figures after AGARD-AR-144, formulas as commonly used [K]; reported, no limit of acceptance known.""",
    "describing function": """\
Where the response to a sine has fallen by 3 dB, and where it lags by a quarter period.
The tolerance is the applicant's [S, 14 CFR Part 60]; reported. A dash: not within the frequencies tested.""",
    "linearity": """\
Linearity: change of the gain at 0.5 Hz. Hysteresis: width of the loop of response over command, taken
to speed zero. Dynamic threshold: time to 63 % of a step of acceleration. Reported, no limit known.""",
}


def _tables(rows: list[Row]) -> list[dict[str, Any]]:
    """Reported figures with one row an axis: half-hertz noise, describing function, and what is done in heave alone."""
    groups = {"half-hertz noise": ("half-hertz noise",), "describing function": ("describing function",),
              "linearity": ("linearity", "hysteresis", "dynamic threshold")}  # fmt: skip
    tables = []
    for key, tests in groups.items():
        some = [row for row in rows if row.test in tests]
        columns = list(dict.fromkeys(_column(row) for row in some))
        cells = {(row.axis, _column(row)): (row.value, "" if row.unit == "1" else row.unit) for row in some}
        axes = list(dict.fromkeys(row.axis for row in some))
        body = [(axis, [cells.get((axis, column), (None, "")) for column in columns]) for axis in axes]
        title = ", ".join(tests).capitalize()
        tables.append({"title": title, "columns": columns, "rows": body, "description": DESCRIPTIONS[key]})
    return tables


def _column(row: Row) -> str:
    return "parasitic peak" if row.figure.startswith("parasitic") else row.figure
