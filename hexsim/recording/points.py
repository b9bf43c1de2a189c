"""Figure of a run's points of interest: what is felt there, and the threshold of perception of each axis."""

from __future__ import annotations

from itertools import cycle

from matplotlib.figure import Figure

from hexsim.recording import palette
from hexsim.recording.figure_style import STACKED, legend, new_figure, styled, symmetric
from hexsim.recording.signals import Signals
from hexsim.signals.table import point_signal
from hexsim.smoothness import band_limit
from hexsim.smoothness.threshold import PERCEPTION_m_s2


@styled
def points(signals: Signals) -> Figure | None:
    """Acceleration in the band along x, y, z at every point that the machine declares and the log holds."""
    named = {point: point_signal(point).columns(6) for point in signals.machine.points}
    columns = {
        point: [values for name in names if (values := signals.column(name)) is not None]
        for point, names in named.items()
        if all(name in signals.log.columns for name in names)
    }
    if not columns:
        return None
    figure, plots = new_figure(3, "Points of interest", heights=[1, 1, 1], margins=STACKED)
    for k, (axis, plot) in enumerate(zip("xyz", plots, strict=True)):
        for point, color in zip(columns, cycle(palette.LEGS), strict=False):
            values = band_limit(signals.time_s, columns[point][k])
            plot.plot(signals.time_s, values, lw=1.0, color=color, label=point)
        for sign in (-1, 1):
            plot.axhline(sign * PERCEPTION_m_s2[axis], color=palette.REFERENCE, lw=1.0, ls="--")
        symmetric(plot)
        plot.set_ylabel(f"{axis} [m/s²]")
    plots[-1].set_xlabel("time [s]")
    legend(plots[0])
    return figure
