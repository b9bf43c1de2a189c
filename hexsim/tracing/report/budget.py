"""The error budget: the residual on held-out motion after each step, from the declared machine down to the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from hexsim.recording import palette
from hexsim.recording.figure_style import PAPER, Margins, panels, png, room_for, styled
from hexsim.recording.quantity import plain
from hexsim.signals.channels import kind_of
from hexsim.tracing.report.signals import SCALE, channel_words
from hexsim.tracing.state import Trace

STEP_COLOURS = (palette.DEVIATION, palette.MARK, palette.RESPONSE)  # declared, refitted, with effects


def shows(row: Mapping[str, Any]) -> bool:
    """Whether a row has an error to draw."""
    return bool(np.isfinite(row["rms"]) and row["rms"] > 0.0 and row["multiple_of_noise"] > 0.0)


def worst_of_kinds(budget: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """(run, channel) of each kind of signal that the refitted machine gets most wrong."""
    seen = {(row["run"], row["channel"]) for row in budget if shows(row)}
    refitted = [
        row for row in budget
        if row["step"] == "parameters refitted" and np.isfinite(row["rms"]) and (row["run"], row["channel"]) in seen
    ]  # fmt: skip
    best: dict[str, tuple[float, str, str]] = {}
    for row in refitted:
        own = (row["multiple_of_noise"], row["run"], row["channel"])
        kind = kind_of(row["channel"])
        best[kind] = max(best.get(kind, own), own)
    return [(run, channel) for _, run, channel in best.values()]


@styled
def waterfall(result: Trace) -> bytes:
    """One panel a kind of signal: rms after each step in its unit, logarithmic, the sensor's noise dotted."""
    shown = worst_of_kinds(result.budget)
    steps = list(dict.fromkeys(row["step"] for row in result.budget))
    rows = (len(shown) + 1) // 2
    room = Margins(left=room_for(steps), top=0.3, bottom=0.45, across=0.3, between=0.72)
    figure, axes = panels(rows, 2, rows * (1.1 + 0.27 * len(steps)), room)
    for plot, (run, channel) in zip(axes.ravel(), shown, strict=False):
        scale, unit = SCALE[kind_of(channel)][3:]
        own = [row for row in result.budget if (row["run"], row["channel"]) == (run, channel)]
        rms = np.array([row["rms"] for row in own])
        off = next(row for row in own if shows(row))  # rms 0: a constant reading that is the declared one exactly
        noise = off["rms"] / off["multiple_of_noise"]
        colours = [STEP_COLOURS[min(k, 2)] for k in range(len(own))]
        finite = rms[np.isfinite(rms) & (rms > 0.0)]
        low, high = scale * min(noise, finite.min()) / 2.0, scale * finite.max()
        drawn = np.where(np.isfinite(rms), np.maximum(scale * rms, low), high)
        plot.barh(range(len(own)), drawn - low, left=low, color=colours, height=0.62)
        plot.axvline(scale * noise, color=palette.INK, lw=1.0, ls=":")
        plot.set_xscale("log")
        plot.set_xlim(low, high * (high / low) ** 0.5)  # room beyond the longest bar, for its figure
        for k, (value, row) in enumerate(zip(drawn, own, strict=True)):
            shown_rms = scale * row["rms"] if np.isfinite(row["rms"]) else value
            text = f"{plain(shown_rms)} {unit}, {plain(row['multiple_of_noise'])} ×"
            plot.annotate(
                text, (value, k), (4, 0), textcoords="offset points", va="center", fontsize="small"
            )  # fmt: skip
        plot.set_yticks(range(len(own)), steps if plot in axes[:, 0] else [""] * len(own))
        plot.invert_yaxis()
        few = np.log10(high / low) > PAPER.wide
        plot.xaxis.set_major_locator(LogLocator(subs=(1.0,) if few else (1.0, 2.0, 5.0), numticks=8))
        plot.xaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        plot.xaxis.set_minor_formatter(NullFormatter())
        plot.tick_params(axis="x", which="major", labelsize="small")
        plot.set_xlabel(unit, fontsize="small")
        plot.grid(visible=False)
        plot.set_title(f"{channel_words(channel)}, run {run}", loc="left")
    for plot in axes.ravel()[len(shown) :]:
        plot.set_visible(False)
    return png(figure)
