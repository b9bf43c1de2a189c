"""Qualification: the motion tests of the field on a machine, one report and one file of numbers.

    qualify(machine, "out")     out/report.html, out/qualify.json

Half-hertz noise, describing function, linearity, hysteresis, dynamic threshold, leg balance, turn-around and
repeatability.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import jinja2
import tomli_w

from compensation import Compensator
from hexsim import __version__
from hexsim.declaration import Machine
from hexsim.files.atomic import write_text
from hexsim.machine.files import machine_tables
from hexsim.qualify.battery import QUICK, Battery, Findings, Plan, Row
from hexsim.qualify.plots import CAPTIONS, pictures
from hexsim.qualify.rig import MachineRig, Motion, Rig
from hexsim.recording.report import data_url, environment
from hexsim.recording.summary_table import number

__all__ = ["QUICK", "Battery", "Findings", "MachineRig", "Motion", "Plan", "Rig", "Row", "qualify"]


def qualify(
    machine: Machine,
    out: str | Path,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
    compensator: str | Compensator = "none",
) -> dict[str, Any]:
    """Run all motion tests and write report.html and qualify.json into the folder `out`; returns what the JSON holds.

    quick: fewer, shorter motions (under a minute). progress(fraction).
    Raises HexsimError where the machine cannot do a motion or `out` cannot be written.
    """
    folder = Path(out)
    report = progress or (lambda fraction: None)
    rig = MachineRig(machine, compensator)
    found = Battery(rig, QUICK if quick else Plan(), lambda fraction, what: report(0.95 * fraction)).run()
    name = compensator if isinstance(compensator, str) else compensator.name
    result = {
        "machine": machine.name,
        "compensator": name,
        "quick": quick,
        "model": rig.model,
        "scheme": "rk4",
        "bandwidth_Hz": 50.0,
        "passed": all(row.passed is not False for row in found.rows),
        "rows": [asdict(row) | {"passed": row.passed} for row in found.rows],
        "describing_function": found.curves["describing_function"],
    }
    write_text(folder / "qualify.json", json.dumps(result, indent=1))
    write_text(folder / "report.html", _page(machine, found, result))
    report(1.0)
    return result


def _page(machine: Machine, found: Findings, result: dict[str, Any]) -> str:

    loader = jinja2.ChoiceLoader(
        [jinja2.PackageLoader("hexsim.qualify", "templates"), jinja2.PackageLoader("hexsim.recording", "templates")]
    )
    judged = [row for row in found.rows if row.passed is not None]
    return environment().overlay(loader=loader).get_template("qualification.html.j2").render(
        title=f"Qualification of {machine.name}",
        how=_how(result),
        sentence=_sentence(judged),
        passed=sum(row.passed is True for row in judged),
        judged=judged,
        cards=_cards(found.rows),
        tables=_tables(found.rows),
        pictures=[(name, data_url(data), CAPTIONS[name]) for name, data in pictures(found.curves).items()],
        config=tomli_w.dumps(machine_tables(machine)),
        version=__version__,
        written=f"{datetime.now():%Y-%m-%d %H:%M}",
    )  # fmt: skip


def _how(result: dict[str, Any]) -> str:
    control = "proportional control" if result["compensator"] == "none" else f"compensator {result['compensator']}"
    scheme = "RK4, step chosen" + (", few frequencies" if result["quick"] else "")
    return f"{control} · {scheme} · accelerations in the {result['bandwidth_Hz']:g} Hz band"


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
Sine of 0.05 m or 5 deg at 0.5 Hz. Ratios are rms over the basic harmonic's: r_n of all that is not the
basic harmonic, r_lf of its 2nd and 3rd harmonics, r_hf of those above. Parasitic: the largest peak in the other axes of the same
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
