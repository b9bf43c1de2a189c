"""What a person on the machine feels of a run: delays, perception, vibration, jerk, and the bump of each reversal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from hexsim.recording import palette
from hexsim.recording.figure_style import STACKED, legend, new_figure, styled
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit_text
from hexsim.recording.summary_table import number
from hexsim.smoothness import ReversalBump, deviation_from_command, reversal_bumps
from hexsim.smoothness.perception import felt_figures

if TYPE_CHECKING:
    from hexsim.simulation import Run

FELT_HEADS = ("delay [ms]", "time felt", "reversals felt", "weighted rms", "of it unwanted", "MTVV", "VDV", "jerk rms")


def felt_of(runs: Mapping[str, Run]) -> dict[str, dict[str, dict[str, Any]]]:
    """Name -> axis -> figures of each run that is long enough."""
    return {name: felt(Signals.of_run(run, name)) for name, run in runs.items() if run.log.height > 1000}


def felt_cells(figures: Mapping[str, float | None]) -> list[str]:
    """In the order of FELT_HEADS."""
    share = lambda value: "–" if value is None else f"{100 * value:.1f} %"  # noqa: E731
    return [
        number(figures["delay_ms"]),
        share(figures["time_felt"]),
        share(figures["reversals_felt"]),
        number(figures["weighted_rms"]),
        number(figures["weighted_rms_unwanted"]),
        number(figures["mtvv"]),
        number(figures["vdv"]),
        number(figures["jerk_rms"]),
    ]


@styled
def bump_chart(runs: Mapping[str, Signals], axis: str) -> Figure | None:
    """The bump of every reversal, a line a run; before compensation and after it stand one above the other."""
    found = {name: bumps for name, signals in runs.items() if (bumps := driven_bumps(signals, axis))}
    if not found:
        return None
    columns = min(len(found), 4)
    lines = -(-len(found) // columns)  # of the legend, between title and plot
    title = f"{AXIS_NAMES[axis].capitalize()}: bump of each reversal, 50 Hz band [{axis_unit_text(axis)}]"
    margins = replace(STACKED, top=STACKED.top + 0.2 * (lines - 1))
    figure, plots = new_figure(1, title, heights=[3.0], margins=margins)
    for k, (name, bumps) in enumerate(found.items()):
        colour = palette.RUNS[k % len(palette.RUNS)]
        plots[0].plot(
            [one.time_s for one in bumps], [one.bump_pp for one in bumps], "o-", color=colour, lw=0.8, ms=4, label=name
        )
    plots[0].margins(x=0.02)  # whole markers at both ends
    plots[0].set_ylim(0.0, None)
    plots[0].set_xlabel("time [s]")
    plots[0].set_ylabel("peak to peak")
    legend(plots[0], columns=columns)
    return figure


def driven_bumps(signals: Signals, axis: str | None = None) -> tuple[ReversalBump, ...]:
    """Bump at each reversal of a driven axis, default the first; none where the log has no command or acceleration."""
    axis = axis or signals.driven_axes[0]
    position, command = signals.commanded(axis), signals.commanded_acceleration(axis)
    acceleration = signals.acceleration(axis)
    if position is None or command is None or acceleration is None:
        return ()
    time, start = signals.time_s, signals.figures_from_s  # the delay is that of the settled motion
    delay = deviation_from_command(time, acceleration, command, start_s=start).delay_s
    return reversal_bumps(time, acceleration, np.gradient(position, time), command, delay_s=delay)


def felt(signals: Signals) -> dict[str, dict[str, Any]]:
    """Axis -> `felt_figures`, of the driven axes, from the run's figures on."""
    found = {}
    for axis in signals.driven_axes:
        acceleration, command = signals.acceleration(axis), signals.commanded_acceleration(axis)
        position, asked = signals.position(axis), signals.commanded(axis)
        if acceleration is None or command is None or position is None or asked is None:
            continue
        found[axis] = felt_figures(
            signals.time_s, axis, acceleration, command, position, asked, start_s=signals.figures_from_s
        )
    return found
