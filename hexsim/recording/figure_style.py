"""One look for all figures: light, thin grid, no frame, readable at the width of a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from io import BytesIO
from typing import Any, NamedTuple, ParamSpec, TypeVar

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, NullLocator
from PIL import Image

from hexsim.recording import palette

Array = np.ndarray
Parameters = ParamSpec("Parameters")
Drawn = TypeVar("Drawn")


class Paper(NamedTuple):
    """Size of every figure."""

    width_in: float = 9.6  # of a page
    dpi: int = 150  # sharp on a screen of two pixels a point
    wide: float = 2.0  # decades of an axis, from which it is logarithmic, or has one tick a decade


PAPER = Paper()

MOST_POINTS = 2 * round(PAPER.width_in * PAPER.dpi)  # of a line: two a pixel of the page
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.parse_math": False,  # names of machines, scenarios and logs may hold any sign
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # where a title stands without ticks above the plot: not to be found out at every drawing
    "axes.labelcolor": palette.INK,
    "text.color": palette.INK,
    "axes.edgecolor": "#9AA5B1",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=list(palette.RUNS)),
    "grid.color": palette.GRID,
    "grid.linewidth": 0.7,
    "xtick.color": "#52606D",
    "ytick.color": "#52606D",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "axes.xmargin": 0.0,
}


def styled(draw: Callable[Parameters, Drawn]) -> Callable[Parameters, Drawn]:
    """Draw in the project's style, and leave matplotlib's settings as they were."""

    @wraps(draw)
    def drawn(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Drawn:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Room around plots [in], of figures whose labels are known: to find it out takes longer than to draw.

    top: with the figure's title. across, between: from a plot to the next one beside and below it.
    """

    left: float = 0.72
    right: float = 0.15
    top: float = 0.6
    bottom: float = 0.48
    across: float = 0.78
    between: float = 0.55

    def grid(self, rows: int, columns: int, width: float, height: float) -> dict[str, float]:
        """The same as settings of matplotlib's grid, in shares of the figure and of a mean plot."""
        wide = (width - self.left - self.right - (columns - 1) * self.across) / columns
        high = (height - self.top - self.bottom - (rows - 1) * self.between) / rows
        return {
            "left": self.left / width,
            "right": 1.0 - self.right / width,
            "bottom": self.bottom / height,
            "top": 1.0 - self.top / height,
            "wspace": self.across / wide,
            "hspace": self.between / high,
        }


STACKED = Margins()
TITLED = Margins(across=0.72, between=0.82)  # plots with a title of their own and a label below each
TIGHT = Margins(across=0.55, between=0.32)  # one time axis a column, labelled at the bottom


def _figure(width: float, height: float, title: str, is_constrained: bool) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained" if is_constrained else None)
    FigureCanvasAgg(figure)
    place = (
        {} if is_constrained else {"y": 1.0 - 0.08 / height}
    )  # the layout keeps room for a title that it places itself
    figure.suptitle(title, x=0.01, ha="left", va="top", fontsize=12, fontweight="bold", **place)
    return figure


def new_figure(
    rows: int,
    title: str,
    heights: Sequence[float] | None = None,
    height: float | None = None,
    margins: Margins | None = None,
) -> tuple[Figure, list[Axes]]:
    """Plots under each other. `heights`: share of each. margins: None finds out what the labels need."""
    shares = list(heights or [1.5] * rows)
    height = height or 1.0 + 1.25 * sum(shares)
    figure = _figure(PAPER.width_in, height, title, margins is None)
    grid: dict[str, Any] = margins.grid(rows, 1, PAPER.width_in, height) if margins else {}
    plots = figure.subplots(rows, 1, squeeze=False, gridspec_kw={"height_ratios": shares, **grid})
    return figure, list(plots[:, 0])


def small_multiples(
    count: int,
    title: str,
    columns: int,
    height: float = 2.5,
    share_columns: bool = False,
    margins: Margins | None = None,
) -> tuple[Figure, list[Axes]]:
    """A grid of like plots; places left over stay empty. share_columns: one time axis a column. margins: as `new_figure`."""
    rows = -(-count // columns)
    whole = 0.7 + height * rows
    figure = _figure(PAPER.width_in, whole, title, margins is None)
    grid: dict[str, Any] = margins.grid(rows, columns, PAPER.width_in, whole) if margins else {}
    shared = "col" if share_columns else False
    plots = figure.subplots(rows, columns, squeeze=False, sharex=shared, gridspec_kw=grid)
    every = list(plots.flat)
    for plot in every[count:]:
        plot.set_visible(False)
    for plot in every:
        plot.locator_params(nbins=6)
    return figure, every[:count]


def panels(rows: int, columns: int, height: float, margins: Margins, **settings: Any) -> tuple[Figure, Array]:
    """A grid of plots (rows, columns) without a title, with these margins. settings: of matplotlib's `subplots`."""
    figure = Figure(figsize=(PAPER.width_in, height))
    grid = margins.grid(rows, columns, PAPER.width_in, height)
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid, **settings)


def room_for(
    labels: Iterable[str],
    *,
    letter_in: float = 0.066,  # in: width of a letter of 8 points
) -> float:
    """Room left of a plot for the labels of its rows [in]."""
    return 0.15 + letter_in * max(map(len, labels), default=0)


def legend(plot: Axes, columns: int = 4) -> None:
    """Above the plot, at the right, out of the way of the curves."""
    plot.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.99),
        ncols=columns,
        borderaxespad=0.0,
        handlelength=1.4,
        frameon=False,
        fontsize=8.0,
        columnspacing=1.2,
    )


def legend_above(figure: Figure, *handles: Artist) -> None:
    """One legend for all plots of a figure, above them."""
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=len(handles),
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.3,
    )


def plain_frequencies(plot: Axes) -> None:
    """Ticks of a logarithmic frequency axis as 1, 2, 5, 10 Hz in place of powers."""
    low, high = plot.get_xlim()
    ticks = [digit * 10.0**power for power in range(-2, 4) for digit in (1, 2, 5) if low <= digit * 10.0**power <= high]
    plot.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    plot.xaxis.set_minor_locator(NullLocator())


def plain_powers(plot: Axes) -> None:
    """Labels of a logarithmic y axis: 1, 2, 5 as plain numbers where it spans little, whole powers elsewhere."""
    low, high = plot.get_ylim()
    if high < 50.0 * low:
        ticks = [d * 10.0**power for power in range(-12, 9) for d in (1, 2, 5) if low <= d * 10.0**power <= high]
        plot.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    else:
        plot.yaxis.set_major_formatter(lambda value, place: f"{value:g}")  # mathematics is not parsed here, see STYLE
    plot.yaxis.set_minor_formatter(NullFormatter())


def symmetric(plot: Axes) -> None:
    """The same room above and below zero."""
    limit = 1.05 * max(abs(value) for value in plot.get_ylim())
    plot.set_ylim(-limit, limit)


def direction_colors() -> tuple[str, str]:
    """|u| growing, |u| falling."""
    return palette.RESPONSE, palette.MARK


def png(figure: Figure, dpi: int = PAPER.dpi) -> bytes:
    """The figure as the bytes of a PNG file, drawn once: `savefig` lays out, then draws twice.

    Without the alpha channel, for figures are opaque: a tenth fewer bytes. Level 2 of compression: 10 % more bytes than
    level 6 in two thirds of the time.
    """
    buffer = BytesIO()
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    with matplotlib.rc_context(STYLE):
        canvas.draw()
    rgb = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
    Image.fromarray(rgb).save(buffer, "png", compress_level=2, dpi=(dpi, dpi))
    return buffer.getvalue()
