"""Plots over time that a reader can look at closely, in a page that needs nothing beside it: uPlot and the data are inside.

A figure has panels with one time axis, below each other. In print, and where no script runs, its picture stands instead.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from hexsim.recording.figure_style import MOST_POINTS, legend, new_figure, styled
from hexsim.recording.page import picture, question

Array = NDArray[np.float64]
MOST_VALUES = 50_000  # of a figure: 0.13 MB of a page
INT16 = np.iinfo(np.int16)  # the smallest says that there is no value, the others cover a curve's range
HOW = "Drag across a plot to look closer; a double click shows all again. A click on a name hides its curve."


@dataclass(frozen=True)
class Curve:
    """values (n,) in the panel's unit; NaN: none."""

    label: str
    values: ArrayLike
    color: str
    width: float = 1.2


@dataclass(frozen=True)
class Panel:
    """title: quantity and unit. time_s: (n,), rising. marks: points (time, value, text). Shaded: band, a range of values; spans, of
    time."""

    title: str
    time_s: Array
    curves: Sequence[Curve]
    marks: Sequence[tuple[float, float, str]] = ()
    band: tuple[float, float] | None = None
    spans: Sequence[tuple[float, float]] = ()


@styled
def still(panels: Sequence[Panel], title: str, view: tuple[float, float] = (-np.inf, np.inf)) -> Figure:
    """Panels as a picture, of the part that is seen first [s]; their titles end with the unit."""
    figure, plots = new_figure(len(panels), title, height=4.4)
    for plot, panel in zip(plots, panels, strict=True):
        rows = np.flatnonzero((panel.time_s >= view[0]) & (panel.time_s < view[1]))
        rows = rows[:: max(len(rows) // MOST_POINTS, 1)]
        for curve in panel.curves:
            plot.plot(panel.time_s[rows], np.asarray(curve.values)[rows], color=curve.color, label=curve.label)
        for start, stop in panel.spans:
            if start < view[1]:
                plot.axvspan(start, min(stop, view[1]), color="#f0b429", alpha=0.25, lw=0)
        plot.set_ylabel(panel.title[panel.title.rindex("[") :])
        legend(plot)
    plots[-1].set_xlabel("time [s]")
    return figure


def zoomable(
    panels: Sequence[Panel], png: bytes, caption: str, said: str = "", view: tuple[float, float] | None = None
) -> Markup:
    """A figure; the picture alone where no panel has a curve. caption: of the picture; said: of the panels, below the same
    question. view: what is shown first [s]; default all."""
    shown = [panel for panel in panels if panel.curves and len(panel.time_s) > 1]
    if not shown:
        return picture(png, caption)
    most = MOST_VALUES // sum(len(panel.curves) for panel in shown)
    content = json.dumps({"panels": [_of_panel(panel, most) for panel in shown], "view": view})
    asked, rest = question(caption)
    return Markup(
        '<figure class="zoom">{}<img src="data:image/png;base64,{}" alt="{}"><figcaption class="still">{}</figcaption>'
        '<div class="plots"></div><script type="application/json">{}</script><figcaption class="seen">{}</figcaption></figure>\n'
    ).format(
        Markup('<p class="question">{}</p>').format(asked) if asked else "",
        base64.b64encode(png).decode(),
        asked or rest,
        rest,
        Markup(content.replace("<", "\\u003c")),
        f"{said} {HOW}".strip(),
    )


def _of_panel(panel: Panel, most: int) -> dict[str, Any]:
    rows = np.array([np.asarray(curve.values, dtype=float) for curve in panel.curves])
    time, rows = thinned(np.asarray(panel.time_s, dtype=float), rows, most)
    curves = [
        {"label": curve.label, "color": curve.color, "width": curve.width, **_packed(row)}
        for curve, row in zip(panel.curves, rows, strict=True)
    ]
    where = {"title": panel.title, "start": float(time[0]), "step": float(time[-1] - time[0]) / (len(time) - 1)}
    if (
        np.max(np.abs(time - time[0] - where["step"] * np.arange(len(time)))) > 0.2 * where["step"]
    ):  # instants one by one
        where["time"] = _text((time - time[0]).astype("<f4"))
    return {**where, "series": curves, "marks": list(panel.marks), "band": panel.band, "spans": list(panel.spans)}


def thinned(time: Array, rows: Array, most: int) -> tuple[Array, Array]:
    """At most about `most` instants of (n,) and (k, n): the smallest and the largest value of each bin, in their order; of a bin where
    the curve only rises or falls its first and its middle sample."""
    n = len(time)
    if n <= most:
        return time, rows
    size = 2 * -(-n // most)  # samples of a bin
    filled = np.r_[:n, np.full(-n % size, n - 1)]  # the last bin, with the last sample
    bins = rows[:, filled].reshape(len(rows), -1, size)
    least, largest = (
        of(np.where(np.isnan(bins), none, bins), axis=2) for of, none in ((np.argmin, np.inf), (np.argmax, -np.inf))
    )
    ends = np.sort([least, largest], axis=0)
    plain = (ends[0] == 0) & (ends[1] == size - 1)  # it only rises or falls: samples where they are
    ends = np.where(plain, np.array([0, size // 2])[:, None, None], ends)
    pairs = np.stack([np.take_along_axis(bins, at[..., None], axis=2)[..., 0] for at in ends], axis=2)
    at = np.arange(0, len(filled), size // 2)
    beyond = np.maximum(at - (n - 1), 0) * (time[-1] - time[0]) / (n - 1)
    return time[np.minimum(at, n - 1)] + beyond, pairs.reshape(len(rows), -1)


def _packed(row: Array) -> dict[str, Any]:
    """16-bit numbers over the curve's range; what is not finite is missing."""
    finite = np.isfinite(row)
    low, high = (float(edge(row[finite])) if finite.any() else 0.0 for edge in (np.min, np.max))
    middle, step = (low + high) / 2, (high - low) / (2 * INT16.max) or 1.0
    numbers = np.full(len(row), INT16.min, dtype="<i2")
    numbers[finite] = np.rint((row[finite] - middle) / step)
    return {"data": _text(numbers), "middle": middle, "step": step}


def _text(numbers: NDArray[Any]) -> str:
    return base64.b64encode(numbers.tobytes()).decode("ascii")
