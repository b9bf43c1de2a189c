"""The pages of a run and of runs side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import tomli_w
from markupsafe import Markup

from hexsim.motion_computer.margins import LoopFigures, stability_sentence, worst_figures
from hexsim.recording.config import config_tables
from hexsim.recording.felt import FELT_HEADS, felt_cells, felt_of
from hexsim.recording.figure_parts import close_up
from hexsim.recording.page import (
    EMPTY,
    Column,
    Report,
    Row,
    Section,
    bar,
    bold,
    cards,
    folded,
    join,
    lead,
    messages,
    note,
    picture,
    remark,
    small,
    table,
    text_block,
)
from hexsim.recording.page import facts as facts_panel
from hexsim.recording.quantity import share
from hexsim.recording.run_curves import comparison_panels, first_seen, run_panels
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit, axis_unit_text
from hexsim.recording.summary_table import axis_header, axis_label, axis_rows, comparison_rows, facts, number
from hexsim.recording.zoom import zoomable
from hexsim.smoothness.threshold import SOURCE, times_threshold

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
SEEN = {  # below the plots that can be looked at closely
    "motion": "Setpoint and response of the driven axes; position, tracking error (setpoint less position) and valve of each leg.",
    "acceleration": "The last periods of each driven axis: acceleration, raw and in the 50 Hz band, with its reference; deviation from "
    "it, with the largest value at each reversal (upper or lower end of the stroke).",
}


def run_report(run: Run, pictures: Mapping[str, bytes], signals: Signals | None = None) -> str:
    """The page of one run; pictures: name -> PNG. signals: of the run, with what was computed from them."""
    signals = signals or Signals.of_run(run)
    driven, summary, panels = signals.driven_axes, run.summary, run_panels(signals)
    shown = [
        zoomable(panels.get(name, ()), data, CAPTIONS.get(name, ""), SEEN.get(name, ""), first_seen(signals, name))
        for name, data in pictures.items()
    ]
    loop = worst_figures(run.machine)
    stability = stability_sentence(loop)
    rows = [Row(cells, "driven" if is_driven else "") for is_driven, cells in axis_rows(summary, driven)]
    about = join([f"{run.scenario.description or run.scenario.name} · compensator ", bold(summary["compensator"])])
    heads = {"time [s]": "", "leg": "", "message": "text"}
    said = [(f"{time_s:.3f}", leg, text) for time_s, leg, text in run.messages]
    return Report(
        f"{run.scenario.name} on {run.machine.name}",
        [
            Section(
                "Figures of each axis",
                [table(axis_header(summary), rows), remark(_figures_words(run)) if rows else EMPTY],
            ),
            Section("Figures", shown),
            Section("Declared loop", [facts_panel(_loop_facts(loop)), remark(_loop_words(loop))]),
            Section(
                "How it was run",
                [
                    facts_panel(
                        facts(summary, run),
                        [
                            messages(said, heads, unfolded=len(said) < 8),
                            folded(
                                "Configuration, everything resolved", [text_block(tomli_w.dumps(config_tables(run)))]
                            ),
                        ],
                    )
                ],
            ),
        ],
        about=about,
        top=[
            lead(run_sentence(summary, driven)),
            note(join([bold("Partial run."), run.reason], " ")) if not run.complete else EMPTY,
            *(note(text) for text in summary["warnings"] if text != run.reason),
            note(f"{stability}." if stability else ""),
            cards(figures_first(summary, driven)),
        ],
    ).html()


def _figures_words(run: Run) -> str:
    """What the table of axes means."""
    start = number(run.summary.get("figures_from_s", run.scenario.figures_start_s))
    command = "" if run.scenario.frequency_Hz else " (here: from the command)"
    return (
        f"Fundamental: amplitude at the frequency of the motion. Peak and noise are of the deviation from it{command}, from "
        f"{start} s on. Bump p-p: largest peak to peak about a reversal. Driven axes in bold; the others should be at rest."
    )


def _loop_facts(loop: LoopFigures) -> list[tuple[str, str]]:
    phase = f"{number(loop.phase_margin_deg)} deg" if loop.is_stable else "none: unstable"
    closed = (
        f"−3 dB at {number(loop.bandwidth_Hz)} Hz, −90° at {number(loop.quarter_Hz)} Hz, peak {round(loop.peak_dB, 1) + 0.0:.1f} dB, "
        f"delay {number(1000 * loop.delay_s)} ms at 1 Hz"
    )
    return [
        ("phase margin", f"{phase}, crossover at {number(loop.crossover_Hz)} Hz"),
        ("gain margin", f"{number(loop.gain_margin_dB)} dB"),
        ("closed loop", closed),
    ]


def _loop_words(loop: LoopFigures) -> str:
    way = "extending" if loop.extends else "retracting"
    return (
        "Linear about neutral, broken at the valve's command, valve open by 1 % beyond its lap; the worst of all legs, modes of the "
        f"load and directions (phase margin: leg {loop.leg}, {way}, moving {number(loop.mass_kg)} kg). Compensators are not in it."
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
    times = times_threshold(axis, peak)
    if times is not None:
        description += f"{' and' if harmonic else ','} {number(times, 2)} times the threshold of perception"
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
    for own in tables:
        rows = [row for row in own["rows"] if row["peak_band"] is not None and not row["note"]]
        if len(rows) < 2:
            return ""
        first, smoothest = own["rows"][0], min(rows, key=lambda row: row["peak_band"])
        best.setdefault(smoothest["name"], []).append(own["axis"])
        description = f"its largest deviation is {number(smoothest['peak_band'])} {own['unit']}"
        if smoothest is not first and smoothest["ratio"]:
            description += f", {share(smoothest['ratio'])} of the {number(first['peak_band'])} with {first['name']}"
    if len(tables) == 1:
        return f"Smoothest is {next(iter(best))}: {description}."
    return "Smoothest: " + "; ".join(f"{name} in {', '.join(axes)}" for name, axes in best.items()) + "."


def figures_first(summary: Mapping[str, Any], driven: tuple[str, ...]) -> list[tuple[str, str, str]]:
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


def comparison_report(runs: Mapping[str, Run], pictures: Mapping[str, bytes], signals: Mapping[str, Signals]) -> str:
    """The page of runs side by side; pictures: name -> PNG. signals: of the runs that are drawn."""
    first = next(iter(runs.values()))
    scenario, band = first.scenario, f"{first.summary['bandwidth_Hz']:g}"
    driven = [axis for axis in Signals.of_run(first).driven_axes if axis in first.summary["axes"]]
    rows = {axis: comparison_rows(runs, axis) for axis in driven}
    start = number(scenario.figures_start_s)
    meaning = (
        f"Peak: largest deviation from the {'fundamental' if scenario.frequency_Hz else 'command'} from {start} s on, in the {band} Hz "
        f"band and raw; the lowest is shaded. × perception: peak over its threshold ({SOURCE}). Bump p-p: largest peak to peak about a "
        "reversal. Tracking: largest rms of a leg behind its setpoint."
    )
    people = [
        (axis_label(axis), bold(name), *felt_cells(axes[axis]))
        for axis in driven
        for name, axes in felt_of(runs).items()
        if axis in axes
    ]
    bumps = [
        picture(png, BUMPS.format(axis_label(name.removeprefix("bumps_")).capitalize()))
        for name, png in pictures.items()
        if name.startswith("bumps_")
    ]
    late = min(
        map(close_up, signals.values()), key=lambda limits: limits[1], default=None
    )  # of the run that ended first
    beside = [
        zoomable(
            comparison_panels(signals, axis),
            pictures[f"comparison_{axis}"],
            BESIDE.format(axis_label(axis), start),
            SEEN_BESIDE,
            late,
        )
        for axis in driven
        if f"comparison_{axis}" in pictures
    ]
    said = [(name, f"{time_s:.3f}", leg, text) for name, run in runs.items() for time_s, leg, text in run.messages]
    tables = [{"axis": AXIS_NAMES[axis], "unit": axis_unit_text(axis), "rows": rows[axis]} for axis in driven]
    warnings = sorted({text for run in runs.values() for text in run.warnings if text != run.reason})
    how = [fact for fact in facts(first.summary, first) if fact[0] in ("duration", "model", "seed")]
    sections = [
        Section(
            f"{own['axis'].capitalize()} [{own['unit']}]",
            [_comparison_table(own["rows"], band), remark(meaning if own is tables[-1] else "")],
        )
        for own in tables
    ]
    heads = ["axis", Column("compensator", "text"), *FELT_HEADS]
    return Report(
        f"{scenario.name} on {first.machine.name}: compensators side by side",
        [
            *sections,
            Section("What a person feels", [table(heads, people), remark(FELT), *bumps]),
            Section("Accelerations and deviations", beside),
            Section(
                "How it was run",
                [
                    facts_panel(
                        how,
                        [
                            messages(said, {"compensator": "", "time [s]": "", "leg": "", "message": "text"}),
                            folded(
                                "Configuration of the first run, everything resolved",
                                [text_block(tomli_w.dumps(config_tables(first)))],
                            ),
                        ],
                    )
                ],
            ),
        ],
        about=f"{scenario.description or scenario.name} · same machine, same motion, same sensor noise",
        top=[lead(comparison_sentence(tables)), *map(note, warnings)],
    ).html()


def _comparison_table(rows: Sequence[Mapping[str, Any]], band: str) -> Markup:
    """One axis, a row a compensator, the lowest peak shaded."""
    peaks = [row["peak_band"] for row in rows if row["peak_band"] is not None and not row["note"]]
    felt = ["× perception"] if any(row["times_threshold"] is not None for row in rows) else []
    best, largest = min(peaks, default=None), max(peaks, default=None)
    made = []
    for row in rows:
        counts = row["peak_band"] is not None and not row["note"]
        name = join([bold(row["name"]), small(row["note"])], " ") if row["note"] else bold(row["name"])
        cells = (
            name,
            bold(number(row["peak_band"])),
            bar(row["peak_band"] / largest if counts and largest else None),
            share(row["ratio"]),
            *([number(row["times_threshold"], 2)] if felt else []),
            *(number(row[key]) for key in ("peak_raw", "bump_pp", "noise_rms", "fundamental", "tracking_mm")),
        )
        made.append(Row(cells, "best" if counts and row["peak_band"] == best else ""))
    heads = [
        "compensator",
        f"peak {band} Hz",
        Column("", "text"),
        f"relative to {rows[0]['name']}",
        *felt,
        "peak raw",
        "bump p-p",
        "noise rms",
        "fundamental",
        "tracking [mm]",
    ]
    return table(heads, made, made)


BUMPS = "What does learning take away? {}: the bump of every reversal, from the first on."
BESIDE = (
    "How smooth is {} with each compensator? One row a compensator, all to one scale. Left and middle: the last periods; right: the "
    "whole run, where learning shows. Grey: the reference. Peak: as in the table, from {} s on."
)
SEEN_BESIDE = "The last periods. Below: tracking error and valve of a leg."
FELT = (
    "Delay: of the acceleration behind the command, which the following leave out. Felt: share of time, and of reversals, with a "
    f"deviation above the threshold of perception (acceleration, {SOURCE}; rotations by their rate, Benson 1989). Weighted rms: "
    "ISO 2631-1, of the whole acceleration and of the deviation [m/s², rad/s²]. MTVV: the largest of it over one second. VDV: fourth "
    "root of its integrated fourth power [m/s^1.75]. Jerk [m/s³]."
)
