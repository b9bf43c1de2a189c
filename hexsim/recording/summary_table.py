"""The figures of a run's summary as rows of text: the terminal, the report and the recording show the same ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hexsim.recording.signals import AXIS_NAMES, axis_unit, axis_unit_text
from hexsim.smoothness.threshold import times_threshold

if TYPE_CHECKING:
    from hexsim.simulation import Run

NOTHING = "–"
COLUMNS = {
    "fundamental": "fundamental",
    "peak_raw": "peak raw",
    "peak_band": "peak {band:g} Hz",
    "bump_pp": "bump p-p",
    "noise_rms": "noise rms",
}


def number(value: float | None, digits: int = 3) -> str:
    """A figure to `digits` significant places; 0.000123 stays readable, a missing one is a dash."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    rounded = abs(float(f"{value:.{digits - 1}e}"))  # 0.99996 is 1.00
    decimals = max(0, digits - 1 - math.floor(math.log10(rounded)))
    return f"{value:.{decimals}f}" if decimals <= 6 and rounded < 1e6 else f"{value:.{digits - 1}e}"


def acceleration(
    value: float | None,
    *,
    least_acceleration: float = 1e-4,  # [m/s2, rad/s2] far below the noise of an accelerometer
) -> str:
    """An acceleration in m/s2 or rad/s2; one that no sensor sees and nobody feels is about zero."""
    return "≈0" if value is not None and 0.0 < value < least_acceleration else number(value)


def axis_label(axis: str) -> str:
    """heave z, roll, leg."""
    name = AXIS_NAMES.get(axis, axis)
    return name if name == axis else f"{name} {axis}"


def axis_header(summary: Mapping[str, Any]) -> list[str]:
    """Column heads of `axis_rows`."""
    return ["axis", *(head.format(band=summary.get("bandwidth_Hz", 50.0)) for head in COLUMNS.values()), "unit"]


def axis_rows(summary: Mapping[str, Any], driven: tuple[str, ...] = ()) -> list[tuple[bool, list[str]]]:
    """(driven?, cells) for each axis, the driven ones first."""
    rows = []
    for axis, figures in summary["axes"].items():
        unit = axis_unit(axis)
        cells = [acceleration(figures.get(f"{key}_{unit}")) for key in COLUMNS]
        is_driven = axis in driven or axis == "leg"
        rows.append((is_driven, [axis_label(axis), *cells, axis_unit_text(axis)]))
    return sorted(rows, key=lambda row: not row[0])


def facts(summary: Mapping[str, Any], run: Any = None) -> list[tuple[str, str]]:
    """What was run and how, as (name, value)."""
    tracking = summary.get("tracking_rms_m") or []
    lines = [
        ("scenario", str(summary["scenario"])),
        ("machine", str(summary["machine"])),
        ("compensator", str(summary["compensator"])),
        ("duration", f"{number(summary['duration_s'], 4)} s"),
        ("tracking rms", tracking_text(tracking)),
    ]
    lines += [("compensation", text) for text in compensation_texts(summary.get("compensation", []))]
    for point, axes in summary.get("points", {}).items():
        peaks = ", ".join(
            f"{axis} {number(figures['peak_band_m_s2'])} m/s² ({number(figures['peak_over_threshold'], 2)} x perception)"
            for axis, figures in axes.items()
        )
        lines.append(("point", f"{point}: peak {peaks}"))
    if run is not None:
        lines.append(("model", f"{MODELS.get(run.model, run.model)}, {scheme_text(run.timestep, summary)}"))
        lines.append(("seed", str(run.seed)))
    lines.append(("real-time factor", number(summary.get("realtime_factor"))))
    return lines


def compensation_texts(legs: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the compensator did, in a line for the legs that it engaged on, and one for each reason why it did not."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for leg in legs:
        groups.setdefault(leg["reason"], []).append(leg)
    return [_engagement_text(reason, group, len(legs)) for reason, group in groups.items()]


def _engagement_text(reason: str, group: Sequence[Mapping[str, Any]], n_legs: int) -> str:
    who = "every leg" if len(group) == n_legs > 1 else ", ".join(str(leg["leg"]) for leg in group)
    who = who if len(group) == n_legs > 1 else f"leg{'s' if len(group) > 1 else ''} {who}"
    times = sorted(leg["engaged_at_s"] for leg in group if leg["engaged_at_s"] is not None)
    since = (
        f"{number(times[0])}" + (f" to {number(times[-1])}" if times and times[-1] > times[0] else "") + " s"
        if times
        else ""
    )
    if not reason:
        return f"{who}: engaged from {since} on"
    return f"{who}: {f'engaged first at {since}, not at the end' if times else 'not engaged'}: {reason}"


def tracking_text(tracking: Sequence[float]) -> str:
    """12.1 mm, or each leg's where they differ."""
    shown = [number(1e3 * value) for value in tracking]
    if not shown:
        return NOTHING
    if len(set(shown)) == 1:
        return f"{shown[0]} mm" + (" in every leg" if len(shown) > 1 else "")
    return f"{', '.join(shown)} mm (legs 1 to {len(shown)})"


MODELS = {"full": "full legs", "tendon": "tendon model"}


def scheme_text(timestep_s: float | None, summary: Mapping[str, Any]) -> str:
    """RK4 at 100 µs; or RK4, step chosen: 167 to ..., as far as the summary has it."""
    if timestep_s is not None:
        return f"RK4 at {number(1e6 * timestep_s)} µs"
    mean, least = summary.get("timestep_mean_s"), summary.get("timestep_shortest_s")
    return (
        f"RK4, step chosen: mean {number(1e6 * mean)} µs, shortest {number(1e6 * least)} µs"
        if mean and least
        else "RK4"
    )


def markdown(summary: Mapping[str, Any], driven: tuple[str, ...] = (), run: Any = None) -> str:
    """The same as Markdown, for the text panel of a recording."""
    head = axis_header(summary)
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    lines += [f"| {' | '.join(cells)} |" for _, cells in axis_rows(summary, driven)]
    lines += ["", *(f"- {name}: {value}" for name, value in facts(summary, run))]
    lines += [f"- **warning**: {text}" for text in summary.get("warnings", [])]
    return "\n".join(lines)


def comparison_rows(runs: Mapping[str, Run], axis: str) -> list[dict[str, Any]]:
    """One row a run for tables: figures of `axis`, the ratio of its peak to the first run's, and what went wrong."""

    unit, rows, reference = axis_unit(axis), [], None
    for name, run in runs.items():
        figures = run.summary["axes"].get(axis, {})
        peak = figures.get(f"peak_band_{unit}")
        reference = peak if reference is None else reference
        tracking = run.summary.get("tracking_rms_m") or [float("nan")]
        rows.append(
            {
                "name": name,
                "fundamental": figures.get(f"fundamental_{unit}"),
                "peak_raw": figures.get(f"peak_raw_{unit}"),
                "peak_band": peak,
                "times_threshold": times_threshold(axis, peak),
                "ratio": peak / reference if peak is not None and reference else None,
                "bump_pp": figures.get(f"bump_pp_{unit}"),
                "noise_rms": figures.get(f"noise_rms_{unit}"),
                "tracking_mm": 1e3 * max(tracking),
                "note": "" if run.complete else run.reason,
            }
        )
    return rows
