"""Figures of a run: motion, acceleration and its deviation, parasitic axes, flow curves, pressures, spectrum.

Each function makes one matplotlib figure, or None where the log lacks what it shows. Units as people read them: mm,
deg, m/s2, bar, V, l/min.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib import mlab
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hexsim.recording import palette
from hexsim.recording.figure_parts import (
    annotate_peaks,
    close_up,
    close_up_of_flow,
    draw_deviation,
    draw_flow,
    draw_legs,
    fit_y,
    largest_shown,
    padded,
    tracking_error,
)
from hexsim.recording.figure_style import (
    STACKED,
    TIGHT,
    TITLED,
    direction_colors,
    legend,
    new_figure,
    plain_frequencies,
    plain_powers,
    small_multiples,
    styled,
    symmetric,
)
from hexsim.recording.points import points
from hexsim.recording.quantity import BAR, DEG, L_MIN, MM
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit_text
from hexsim.recording.summary_table import number
from hexsim.signals.signal import ROTATIONS

Array = NDArray[np.float64]


def run_figures(signals: Signals) -> dict[str, Figure]:
    """All figures of a run by name, in the order of a report."""
    made = {name: maker(signals) for name, maker in makers().items()}
    return {name: figure for name, figure in made.items() if figure is not None}


def makers() -> dict[str, Callable[[Signals], Figure | None]]:
    """What draws each figure of a run, by name."""
    return {
        "motion": motion,
        "acceleration": acceleration,
        "parasitic": parasitic,
        "flow_curve": flow_curve,
        "pressures": pressures,
        "spectrum": spectrum,
        "points": points,
    }


@styled
def motion(signals: Signals) -> Figure | None:
    """Setpoint and response of the driven axes, and the legs' tracking error."""
    axes_shown = [axis for axis in signals.driven_axes if signals.position(axis) is not None]
    errors = {leg: tracking_error(signals, leg) for leg in signals.legs}
    if not axes_shown or all(error is None for error in errors.values()):
        return None
    figure, plots = new_figure(len(axes_shown) + 1, "Motion", heights=[2] * len(axes_shown) + [1.4], margins=STACKED)
    for axis, plot in zip(axes_shown, plots, strict=False):
        scale, unit = (DEG, "deg") if axis in ROTATIONS else (MM, "mm")
        commanded, position = signals.commanded(axis), signals.position(axis)
        if commanded is not None:
            plot.plot(signals.time_s, scale * commanded, color=palette.REFERENCE, lw=2.4, label="setpoint")
        if position is not None:
            plot.plot(signals.time_s, scale * position, color=palette.RESPONSE, lw=1.2, label="response")
        plot.set_ylabel(f"{AXIS_NAMES[axis]} [{unit}]")
        legend(plot)
    draw_legs([plots[-1]], signals, {leg: MM * error for leg, error in errors.items() if error is not None})
    plots[-1].set_ylabel("tracking error [mm]")
    plots[-1].set_xlabel("time [s]")
    legend(plots[-1], columns=6)
    return figure


@styled
def acceleration(signals: Signals) -> Figure | None:
    """The first driven axis: acceleration and deviation close up, and deviation over the whole run."""
    axis = signals.driven_axes[0]
    found, raw, band = signals.deviation(axis), signals.acceleration(axis), signals.acceleration_in_band(axis)
    if found is None or raw is None or band is None:
        return None
    unit = axis_unit_text(axis)
    figure, (top, middle, bottom) = new_figure(
        3, f"Acceleration, {AXIS_NAMES[axis]}", heights=[2, 1.6, 1.4], margins=STACKED
    )
    close = close_up(signals)
    t = signals.time_s
    top.plot(t, raw, color=palette.RAW, lw=0.7, label="raw")
    top.plot(found.time_s, found.reference, color=palette.REFERENCE, lw=2.0, label=found.reference_is)
    top.plot(t, band, color=palette.RESPONSE, lw=1.2, label=f"{found.bandwidth_Hz:g} Hz band")
    top.set_ylabel(f"acceleration [{unit}]")
    draw_deviation(middle, found, raw=True)
    for plot, values in ((top, raw), (middle, found.raw)):
        plot.set_xlim(*close)
        fit_y(plot, t if values is raw else found.time_s, values, close)
    annotate_peaks(middle, found, close)
    draw_deviation(bottom, found, raw=False)
    symmetric(bottom)
    for plot in (middle, bottom):
        plot.set_ylabel(f"deviation [{unit}]")
    bottom.set_xlim(found.time_s[0], found.time_s[-1])
    bottom.axvspan(*close, color=palette.GRID, alpha=0.6, zorder=0, lw=0)
    bottom.set_xlabel("time [s]")
    legend(top)
    legend(middle)
    legend(bottom)
    return figure


@styled
def parasitic(signals: Signals) -> Figure | None:
    """Axes without a command, all translations to one scale and all rotations to one scale."""
    at_rest = [axis for axis in signals.axes if axis not in signals.driven_axes]
    found = {axis: deviation for axis in at_rest if (deviation := signals.deviation(axis)) is not None}
    if not found:
        return None
    figure, plots = small_multiples(len(found), "Parasitic acceleration, 50 Hz band", columns=3, margins=TITLED)
    largest = {
        kind: max((np.max(np.abs(d.band)) for a, d in found.items() if (a in ROTATIONS) == kind), default=1.0)
        for kind in (False, True)
    }
    for plot, (axis, deviation) in zip(plots, found.items(), strict=True):
        plot.plot(deviation.time_s, deviation.band, color=palette.DEVIATION, lw=0.7)
        limit = 1.15 * largest[axis in ROTATIONS] or 1.0
        plot.set_ylim(-limit, limit)
        plot.set_title(f"{AXIS_NAMES[axis]} [{axis_unit_text(axis)}]", loc="left")
        plot.set_xlabel("time [s]")
    return figure


@styled
def flow_curve(signals: Signals) -> Figure | None:
    """Flow over valve voltage, whole and close to the dead band; coming (u rising) and going have their own colour."""
    late = signals.time_s >= signals.fade_s
    curves = {}
    for leg in signals.legs:
        volts, flow = signals.leg(leg, "valve"), signals.leg(leg, "flow")
        if volts is not None and flow is not None:
            curves[leg] = (volts[late], L_MIN * flow[late])
    if not curves:
        return None
    single = len(curves) == 1
    figure, plots = small_multiples(
        2 if single else len(curves), "Flow curve", columns=2 if single else 3, margins=TITLED
    )
    for plot, (leg, (volts, flow)) in zip(plots, curves.items(), strict=False):
        draw_flow(plot, volts, flow, size=2.0)
        plot.set_title("whole" if single else f"leg {leg}", loc="left")
        if single:
            close_up_of_flow(plots[1], volts, flow)
            plots[1].set_title("dead band", loc="left")
        else:
            inset = plot.inset_axes((0.6, 0.1, 0.38, 0.38))
            close_up_of_flow(inset, volts, flow)
            inset.tick_params(labelsize=6)
    for plot in plots:
        plot.set_xlabel("valve [V]")
        plot.set_ylabel("flow [l/min]")
    for color, label in zip(direction_colors(), ("valve opening", "valve closing"), strict=True):
        plots[-1].plot([], [], ls="", marker="o", ms=4, color=color, label=label)
    figure.legend(*plots[-1].get_legend_handles_labels(), loc="upper right", ncols=2, borderaxespad=0.3)
    return figure


@styled
def pressures(signals: Signals) -> Figure | None:
    """Bottom pressures of the legs and the supply, over the last periods."""
    bottom = {leg: signals.leg(leg, "true_pressure_bottom", "pressure_bottom") for leg in signals.legs}
    if all(pressure is None for pressure in bottom.values()):
        return None
    tops = {leg: signals.leg(leg, "true_pressure_top", "pressure_top") for leg in signals.legs}
    supply = signals.supply
    figure, (whole, close) = new_figure(2, "Pressures", heights=[1, 1.3], margins=STACKED)
    limits = close_up(signals)
    t = signals.time_s
    if supply is not None:
        whole.plot(t, BAR * supply, color=palette.SUPPLY, lw=1.2, label="supply")
    draw_legs([whole, close], signals, {leg: BAR * values for leg, values in bottom.items() if values is not None})
    for top in tops.values():
        if top is not None and not signals.kinematics.has_platform:
            whole.plot(t, BAR * top, color=palette.REFERENCE, lw=0.9, ls="--", label="rod side")
    present = np.concatenate([pressure for pressure in bottom.values() if pressure is not None])
    shown = np.tile((t >= limits[0]) & (t <= limits[1]), len(present) // len(t))
    close.set_xlim(*limits)
    close.set_ylim(*padded(BAR * present[shown]))
    whole.set_ylabel("pressure [bar]")
    close.set_ylabel("chamber pressure [bar]")
    close.set_xlabel("time [s]")
    whole.set_xlim(t[0], t[-1])
    legend(whole, columns=7)
    return figure


@styled
def spectrum(signals: Signals) -> Figure | None:
    """Amplitude density of the driven axis' acceleration: harmonics of the motion, and the oil's resonance."""
    axis = signals.driven_axes[0]
    found, raw = signals.deviation(axis), signals.acceleration(axis)
    if found is None or raw is None:
        return None
    unit = axis_unit_text(axis)
    figure, (plot,) = new_figure(1, f"Spectrum of the acceleration, {AXIS_NAMES[axis]}", height=3.6, margins=STACKED)
    rate = (len(signals.time_s) - 1) / np.ptp(signals.time_s)
    late = raw[len(signals.time_s) - len(found.time_s) :]
    for values, color, label in ((late, palette.RAW, "acceleration"), (found.raw, palette.DEVIATION, "deviation")):
        length = min(len(values), round(4.0 * rate))  # 4 s: resolution 0.25 Hz
        window = np.hanning(length + 1)[:-1]
        spectrum_of = mlab.psd(values, length, rate, mlab.detrend_mean, window, noverlap=length // 2)
        density, frequency = map(np.asarray, spectrum_of)
        inside = (frequency > 0) & (frequency <= 400.0)
        plot.loglog(frequency[inside], np.sqrt(density[inside]), color=color, lw=1.2, label=label)
    plot.axvline(found.bandwidth_Hz, color=palette.REFERENCE, lw=1.0, ls=":", label=f"band {found.bandwidth_Hz:g} Hz")
    plain_frequencies(plot)
    plain_powers(plot)
    plot.set_xlabel("frequency [Hz]")
    plot.set_ylabel(f"amplitude density [({unit})/√Hz]")
    legend(plot)
    return figure


@styled
def comparison(
    runs: Mapping[str, Signals], axis: str | None = None, peaks: Mapping[str, float] | None = None
) -> Figure | None:
    """Accelerations and deviations of the driven axis, a row a run and to one scale, close up and whole.

    peaks: label -> largest deviation as the table has it; without it, that of the close-up.
    """
    first = next(iter(runs.values()))
    axis = axis or first.driven_axes[0]
    found = {label: d for label, signals in runs.items() if (d := signals.deviation(axis)) is not None}
    if not found:
        return None
    unit = axis_unit_text(axis)
    title = f"{AXIS_NAMES[axis].capitalize()} side by side, 50 Hz band [{unit}]"
    figure, plots = small_multiples(3 * len(found), title, columns=3, height=1.55, share_columns=True, margins=TIGHT)
    close = min((close_up(runs[label]) for label in found), key=lambda limits: limits[1])  # the run that ended first
    limit = 1.1 * max(largest_shown(d, close) for d in found.values())
    everywhere = 1.1 * max(np.max(np.abs(d.band)) for d in found.values())
    reference = next(iter(found.values())).reference_is
    for row, (label, deviation) in enumerate(found.items()):
        color = palette.RUNS[row % len(palette.RUNS)]
        left, middle, right = plots[3 * row : 3 * row + 3]
        left.plot(deviation.time_s, deviation.reference, color=palette.REFERENCE, lw=1.6)
        left.plot(deviation.time_s, deviation.reference + deviation.band, color=color, lw=0.9)
        middle.plot(deviation.time_s, deviation.band, color=color, lw=0.9)
        right.plot(deviation.time_s, deviation.band, color=color, lw=0.6)
        left.set_xlim(*close)
        middle.set_xlim(*close)
        middle.set_ylim(-limit, limit)
        right.set_ylim(-everywhere, everywhere)
        left.set_ylabel(label, color=color, fontweight="bold")
        peak = (peaks or {}).get(label, largest_shown(deviation, close))
        middle.text(1.0, 1.03, f"peak {number(peak)}", transform=middle.transAxes, ha="right", va="bottom")
    for left in plots[3::3]:
        left.sharey(plots[0])
    plots[0].autoscale(axis="y")
    for plot, name in zip(plots, (f"acceleration and {reference}", "deviation", "deviation, whole run"), strict=False):
        plot.set_title(name, loc="left")
    for plot in plots[-3:]:
        plot.set_xlabel("time [s]")
    return figure
