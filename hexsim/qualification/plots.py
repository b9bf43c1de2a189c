"""Plots of the motion tests, in the project's style: {name: PNG}."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hexsim.qualification.measures import STEP_SHARE
from hexsim.qualification.rows import NAMES, ROTATIONS
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, new_figure, png, small_multiples, styled

CAPTIONS = {
    "half-hertz": "How pure is a sine of 0.5 Hz? "
    "Acceleration over the last periods, and its deviation from the fundamental; all in the "
    "50 Hz band. Spikes at the reversals are the dead band and friction.",
    "frequency response": "How fast can each axis follow? "
    "Response over command, fundamentals, at one amplitude a frequency. Six curves on each other "
    "are six axes that answer alike. A proportional loop without feed-forward gives the first-order lag that shows here.",
    "turn-around": "Is the turn of a large heave within its limit? "
    "Heave of 150 mm peak to peak at 0.5 Hz. Above, the acceleration must stay in the grey band about its "
    "fundamental; below, the same as deviation, between the dashed lines.",
    "dynamic threshold": "How late is a step of acceleration? "
    "Steps of commanded acceleration and the answer. What counts is the time from a step to 63 % of it "
    "(dotted); the bumps between the steps are the reversals of the legs.",
    "linearity and hysteresis": "Do small motions come out as large ones do? "
    "Left: gain at 0.5 Hz over amplitude, 1 is ideal. Right: response over command at two "
    "slow, constant speeds; the lag makes the loops wide, the width at speed zero is hysteresis.",
    "leg balance": "Do the legs answer alike? "
    "Phase of each leg behind its setpoint at 0.5 Hz; legs that differ tilt the platform. All must lie "
    "within a band of the grey height.",
}


def pictures(curves: Mapping[str, Any]) -> dict[str, bytes]:
    """All plots for which there are curves."""
    made = {
        "half-hertz": (half_hertz, "half_hertz"),
        "frequency response": (frequency_response, "describing_function"),
        "turn-around": (turn_around, "turn_around"),
        "dynamic threshold": (dynamic_threshold, "dynamic_threshold"),
        "linearity and hysteresis": (linearity_and_hysteresis, "linearity", "hysteresis"),
        "leg balance": (leg_balance, "leg_balance"),
    }
    return {
        name: draw(*(curves[key] for key in keys))
        for name, (draw, *keys) in made.items()
        if all(key in curves for key in keys)
    }


@styled
def half_hertz(curves: Mapping[str, Any]) -> bytes:
    figure, plots = small_multiples(len(curves), "Half-hertz noise", min(3, len(curves)), height=2.1)
    for plot, (axis, curve) in zip(plots, curves.items(), strict=True):
        plot.plot(curve["time_s"], curve["acceleration"], color=palette.RESPONSE, lw=0.9, label="acceleration")
        plot.plot(curve["time_s"], curve["deviation"], color=palette.DEVIATION, lw=0.8, label="deviation")
        plot.set_title(f"{NAMES.get(axis, axis)} [{'rad/s²' if axis in ROTATIONS else 'm/s²'}]", loc="left")
        plot.set_xlabel("time [s]")
    figure.legend(*plots[0].get_legend_handles_labels(), loc="upper right", ncols=2, borderaxespad=0.3)
    return png(figure)


@styled
def frequency_response(curves: Mapping[str, Any]) -> bytes:
    figure, (gain, phase) = new_figure(2, "Frequency response", heights=[2.0, 2.0])
    for k, (axis, curve) in enumerate(curves.items()):
        style = {
            "color": palette.LEGS[k % 6],
            "marker": "os^Dv<"[k % 6],
            "ms": 4,
            "lw": 1.2,
            "label": NAMES.get(axis, axis),
        }
        gain.semilogx(curve["frequency_Hz"], np.maximum(curve["gain_dB"], -60.0), **style)
        phase.semilogx(curve["frequency_Hz"], np.array(curve["phase_deg"], dtype=float), **style)
    for plot, level, label in ((gain, -3.0, "−3 dB"), (phase, -90.0, "−90°")):
        plot.axhline(level, color=palette.REFERENCE, lw=0.9, ls="--")
        plot.annotate(
            label,
            (1.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=palette.REFERENCE,
        )
        ticks = [f for f in (0.1, 0.2, 0.5, 1, 2, 5, 10) if f >= 0.9 * plot.get_xlim()[0]]
        plot.set_xticks(ticks, [f"{f:g}" for f in ticks])
        plot.minorticks_off()
        plot.margins(x=0.03)
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    legend(gain, columns=6)
    return png(figure)


@styled
def turn_around(curve: Mapping[str, Any]) -> bytes:
    figure, (plot, left) = new_figure(2, "Turn-around", heights=[1.8, 1.4])
    time, limit = curve["time_s"], curve["limit"]
    plot.fill_between(time, curve["harmonic"] - limit, curve["harmonic"] + limit, color=palette.GRID, label="allowed")
    plot.plot(time, curve["harmonic"], color=palette.REFERENCE, lw=1.0, label="fundamental")
    plot.plot(time, curve["acceleration"], color=palette.RESPONSE, lw=1.0, label="response, 50 Hz band")
    plot.set_ylabel("acceleration [m/s²]")
    legend(plot)
    left.plot(time, curve["acceleration"] - curve["harmonic"], color=palette.DEVIATION, lw=0.9)
    for level in (-limit, limit):
        left.axhline(level, color=palette.REFERENCE, lw=0.9, ls="--")
    left.set_ylabel("deviation [m/s²]")
    left.set_xlabel("time [s]")
    return png(figure)


@styled
def dynamic_threshold(curve: Mapping[str, Any]) -> bytes:
    figure, (plot,) = new_figure(1, "Dynamic threshold", heights=[2.0])
    plot.plot(curve["time_s"], curve["commanded_m_s2"], color=palette.REFERENCE, lw=1.0, label="commanded")
    plot.plot(curve["time_s"], curve["acceleration_m_s2"], color=palette.RESPONSE, lw=1.0, label="response, 50 Hz band")
    step = float(np.max(curve["commanded_m_s2"]))
    for sign in (-1.0, 1.0):
        plot.axhline(sign * (2 * STEP_SHARE - 1) * step, color=palette.REFERENCE, lw=0.9, ls=":")
    plot.set_ylabel("acceleration [m/s²]")
    plot.set_xlabel("time [s]")
    legend(plot)
    return png(figure)


@styled
def linearity_and_hysteresis(linearity: Mapping[str, Any], loops: list[Mapping[str, Any]]) -> bytes:
    figure, (left, right) = small_multiples(2, "Linearity and hysteresis", 2, height=3.0)
    left.plot(1e3 * np.array(linearity["amplitude_m"]), linearity["gain"], "o-", color=palette.RESPONSE, ms=4)
    left.set_ylim(0.0, max(1.1, 1.05 * max(linearity["gain"])))
    left.axhline(1.0, color=palette.REFERENCE, lw=0.9, ls="--")
    left.margins(x=0.05)
    left.set_xlabel("amplitude [mm]")
    left.set_ylabel("gain at 0.5 Hz")
    left.set_title("linearity", loc="left")
    right.set_title("hysteresis", loc="left")
    for curve, color in zip(loops, (palette.RESPONSE, palette.DEVIATION), strict=True):
        right.plot(
            1e3 * curve["commanded_m"],
            1e3 * curve["response_m"],
            color=color,
            lw=1.0,
            label=f"{1e3 * curve['speed_m_s']:g} mm/s",
        )
    right.set_xlabel("commanded [mm]")
    right.set_ylabel("response [mm]")
    legend(right)
    return png(figure)


@styled
def leg_balance(curve: Mapping[str, Any]) -> bytes:
    figure, (plot,) = new_figure(1, "Leg balance", heights=[1.4])
    phases = np.array(curve["phase_deg"])
    numbers = np.arange(1, len(phases) + 1)
    mean = phases.mean()
    plot.axhspan(mean - 0.75, mean + 0.75, color=palette.GRID, label="allowed spread, 1.5 deg")
    plot.plot(numbers, phases, "o", color=palette.RESPONSE, ms=6, label="leg")
    plot.set_ylim(mean - 1.5, mean + 1.5)
    plot.set_xticks(numbers, [f"leg {i}" for i in numbers])
    plot.margins(x=0.08)
    plot.set_ylabel("phase [deg]")
    legend(plot)
    return png(figure)
