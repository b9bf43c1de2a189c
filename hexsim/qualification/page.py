"""The page of a qualification: limits, figures, plots."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from hexsim.qualification.battery import Findings
from hexsim.qualification.plots import CAPTIONS, pictures
from hexsim.qualification.rows import Row
from hexsim.recording.page import (
    Cell,
    Column,
    Report,
    Section,
    bold,
    cards,
    folded,
    join,
    lead,
    picture,
    remark,
    small,
    table,
    text_block,
)
from hexsim.recording.summary_table import NOTHING, number


def page(title: str, how: str, found: Findings, config: str, notes: Sequence[str] = ()) -> str:
    """report.html. config: the machine's file; notes: what restricts the figures, a sentence each."""
    judged = [row for row in found.rows if row.passed is not None]
    verdict = [("yes", "text pass") if row.passed else ("no", "text fail") for row in judged]
    against = [
        (
            row.test,
            row.axis,
            row.figure,
            bold(number(row.value)),
            number(row.limit),
            row.unit,
            Cell(*said),
            small(row.source.replace("+-", "±")),
        )
        for row, said in zip(judged, verdict, strict=True)
    ]
    heads = [
        "test",
        Column("axis", "text"),
        Column("figure", "wide"),
        "value",
        "limit",
        Column("unit", "text"),
        Column("within", "text"),
        Column("source of the limit", "wide"),
    ]
    kept = (f"{sum(row.passed is True for row in judged)} of {len(judged)}", "", "limits kept")
    source = remark("[S] read in a source. [K] commonly used in the field, not confirmed from a source.")
    return Report(
        title,
        [
            Section("Against a limit", [table(heads, against, against), source]),
            *_tables(found.rows),
            Section("Figures", [picture(png, CAPTIONS[name]) for name, png in pictures(found.curves).items()]),
            Section("The machine", [folded("Declaration", [text_block(config)])]),
        ],
        about=how,
        top=[
            lead(_sentence(judged) if judged else "No figure of this motion has a limit."),
            *map(remark, notes),
            cards([kept, *_cards(found.rows)]),
        ],
    ).html()


def _sentence(judged: list[Row]) -> str:
    """How many limits are kept, and which are not, the furthest off first."""
    outside = sorted((r for r in judged if not r.passed), key=lambda r: -(r.value or 0.0) / (r.limit or 1.0))
    if not outside:
        return f"All {len(judged)} limits are kept."
    names = "; ".join(f"{r.test} in {r.axis} ({(r.value or 0.0) / (r.limit or 1.0):.1f} times)" for r in outside)
    return f"{len(outside)} of {len(judged)} limits exceeded: {names}."


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


def _tables(rows: list[Row]) -> list[Section]:
    """Reported figures with one row an axis: half-hertz noise, describing function, and what is done in heave alone."""
    groups = {
        "half-hertz noise": ("half-hertz noise",),
        "describing function": ("describing function",),
        "linearity": ("linearity", "hysteresis", "dynamic threshold"),
    }
    found = []
    for key, tests in groups.items():
        some = [row for row in rows if row.test in tests]
        columns = list(dict.fromkeys(_column(row) for row in some))
        cells = {(row.axis, _column(row)): _with_unit(row) for row in some}
        axes = list(dict.fromkeys(row.axis for row in some))
        body = [(axis, *(cells.get((axis, column), NOTHING) for column in columns)) for axis in axes]
        heads = ["axis", *(column.replace(" -", " −") for column in columns)]
        found.append(Section(", ".join(tests).capitalize(), [table(heads, body), remark(DESCRIPTIONS[key])]))
    return found


def _with_unit(row: Row) -> Markup:
    """The value, its unit in small letters."""
    return join([number(row.value), small(row.unit)] if row.unit != "1" else [number(row.value)], " ")


def _column(row: Row) -> str:
    return "parasitic peak" if row.figure.startswith("parasitic") else row.figure
