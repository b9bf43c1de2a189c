"""Parts of the figures of a run: curves of the legs, deviations with their peaks, flow curves, limits of axes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hexsim.recording import palette
from hexsim.recording.deviation import Deviation
from hexsim.recording.figure_style import direction_colors
from hexsim.recording.signals import Signals
from hexsim.recording.summary_table import number

Array = NDArray[np.float64]


def draw_legs(plots: list[Axes], signals: Signals, curves: dict[int, Array]) -> None:
    """A curve a leg; legs that move alike (spread below 3 % of their range, rms) as one curve and the range that they cover."""
    t, values = signals.time_s, np.array(list(curves.values()))
    low, high = values.min(axis=0), values.max(axis=0)
    alike = len(values) > 1 and np.sqrt(np.mean((high - low) ** 2)) < 0.03 * np.ptp(values)
    for plot in plots:
        if alike:
            plot.fill_between(t, low, high, color=palette.MARK, lw=0.8, label="range of the legs")
            plot.plot(t, values.mean(axis=0), color=palette.RESPONSE, lw=1.2, label=f"mean of {len(values)} legs")
            continue
        for leg, own in curves.items():
            color, label = (palette.LEGS[leg - 1], f"leg {leg}") if len(curves) > 1 else (palette.RESPONSE, "leg")
            plot.plot(t, own, color=color, lw=1.2, label=label)


def tracking_error(signals: Signals, leg: int) -> Array | None:
    setpoint, position = signals.leg(leg, "setpoint"), signals.leg(leg, "true_position", "position")
    return None if setpoint is None or position is None else setpoint - position


def close_up(signals: Signals) -> tuple[float, float]:
    """The last two periods, or 6 s of a motion that has none."""
    end = float(signals.time_s[-1])
    span = 2.0 / signals.frequency_Hz if signals.frequency_Hz else 6.0
    return max(float(signals.time_s[0]), end - span), end


def largest_shown(deviation: Deviation, limits: tuple[float, float]) -> float:
    shown = (deviation.time_s >= limits[0]) & (deviation.time_s <= limits[1])
    return float(np.max(np.abs(deviation.band[shown]), initial=0.0))


def padded(values: Array) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    pad = 0.08 * (high - low) or 1.0
    return low - pad, high + pad


def fit_y(plot: Axes, t: Array, values: Array | None, limits: tuple[float, float]) -> None:
    if values is not None:
        plot.set_ylim(*padded(values[(t >= limits[0]) & (t <= limits[1])]))


def draw_deviation(plot: Axes, found: Deviation, raw: bool) -> None:
    if raw:
        plot.plot(found.time_s, found.raw, color=palette.RAW, lw=0.7, label="raw")
    plot.plot(found.time_s, found.band, color=palette.DEVIATION, lw=1.1, label=f"{found.bandwidth_Hz:g} Hz band")
    if found.peaks:
        times, peaks = [peak.time_s for peak in found.peaks], [peak.value for peak in found.peaks]
        plot.plot(times, peaks, ls="", marker="o", ms=4, color=palette.INK, mfc="white", label="peak at reversal")
    plot.axhline(0.0, color=palette.REFERENCE, lw=0.6, zorder=0)


def annotate_peaks(plot: Axes, found: Deviation, limits: tuple[float, float]) -> None:
    for peak in found.peaks:
        if limits[0] <= peak.time_s <= limits[1]:
            plot.annotate(
                f"{number(abs(peak.value))} {peak.end}",
                (peak.time_s, peak.value),
                xytext=(6, 0),
                textcoords="offset points",
                fontsize=8,
                va="center",
                color=palette.INK,
            )


def draw_flow(plot: Axes, volts: Array, flow: Array, size: float) -> None:
    """Points coloured by whether |u| grows or falls."""
    growing = np.gradient(np.abs(volts)) >= 0.0
    for part, color in zip((growing, ~growing), direction_colors(), strict=True):
        plot.plot(volts[part], flow[part], ls="", marker=".", ms=size, mew=0, color=color, rasterized=True)
    plot.axhline(0.0, color=palette.GRID, lw=0.8, zorder=0)
    plot.axvline(0.0, color=palette.GRID, lw=0.8, zorder=0)


def close_up_of_flow(
    plot: Axes,
    volts: Array,
    flow: Array,
    *,
    half_width_V: float = 0.15,  # half width of the close-up of a flow curve
) -> None:
    near = np.abs(volts) <= half_width_V
    if near.any():
        draw_flow(plot, volts[near], flow[near], size=3.0)
    plot.set_xlim(-half_width_V, half_width_V)
