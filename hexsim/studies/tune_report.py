"""What a tuning leaves: tables, a Bode figure, tuning.json and the machine file."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hexsim.files.json_files import write_json
from hexsim.machine.files import save_machine
from hexsim.motion_computer.loop_model import loops
from hexsim.motion_computer.margins import DELAY_AT_Hz, LoopFigures
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, plain_frequencies, png, small_multiples, styled
from hexsim.recording.signals import AXIS_NAMES
from hexsim.recording.summary_table import number
from hexsim.studies.tune_loop import JUDGED, AxisFigures, Tuning

WAYS = ("before", "after")
Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


def tables(tuning: Tuning) -> list[Table]:
    """(title, header, rows) of the loop's margins and of the measured axes."""
    margins = [(way, *margin_cells(figures)) for way, figures in zip(WAYS, tuning.margins, strict=True)]
    measured = [
        (f"{AXIS_NAMES.get(one.axis, one.axis)}, {way}", *_axis_cells(one))
        for pair in zip(*tuning.axes, strict=True)
        for way, one in zip(WAYS, pair, strict=True)
    ]
    header = ("-3 dB [Hz]", "-90 deg [Hz]", "peak [dB]", f"delay at {DELAY_AT_Hz:g} Hz [ms]")
    return [
        ("Linear model, worst loop", ("loop", *MARGIN_HEADER), margins),
        ("Simulated, multisine in each axis", ("axis", *header), measured),
    ]


MARGIN_HEADER = (
    "stable",
    "gain margin [dB]",
    "phase margin [deg]",
    "crossover [Hz]",
    "-3 dB [Hz]",
    "-90 deg [Hz]",
    "peak [dB]",
)


def margin_cells(figures: LoopFigures) -> tuple[str, ...]:
    """Cells under MARGIN_HEADER."""
    return (
        "yes" if figures.is_stable else "no",
        number(figures.gain_margin_dB),
        number(figures.phase_margin_deg),
        number(figures.crossover_Hz),
        number(figures.bandwidth_Hz),
        number(figures.quarter_Hz),
        number(figures.peak_dB),
    )


def _axis_cells(one: AxisFigures) -> tuple[str, ...]:
    return _within(one.bandwidth_Hz), _within(one.quarter_Hz), number(one.peak_dB), number(1e3 * one.delay_s)


def _within(crossing_Hz: float | None) -> str:
    """A frequency, or on which side of those that were measured it lies."""
    if crossing_Hz is None:
        return f"> {JUDGED.frequencies_Hz[-1]:g}"
    return f"< {JUDGED.frequencies_Hz[0]:g}" if crossing_Hz <= JUDGED.frequencies_Hz[0] else number(crossing_Hz)


@styled
def bode_figure(tuning: Tuning) -> Figure:
    """Piston over setpoint of the linear loops (lines), platform over command in the simulator (points)."""
    figure, (gain, phase) = small_multiples(
        2, f"Loop of {tuning.machines[0].name}, before and after", columns=2, height=3.2
    )
    shown_Hz = (0.2, 30.0)  # beyond what is measured by a factor of 1.5 to 2.5
    f = np.geomspace(*shown_Hz, 150)
    f = f[f < 0.5 * tuning.machines[0].controller.rate_Hz]
    for way, machine, axes, color in zip(
        WAYS, tuning.machines, tuning.axes, (palette.MARK, palette.RESPONSE), strict=True
    ):
        for k, loop in enumerate(loops(machine)):
            answer = loop.closed_response(f)
            gain.semilogx(
                f, 20 * np.log10(np.abs(answer)), color=color, lw=0.7, label=f"{way}: model" if k == 0 else None
            )
            phase.semilogx(f, np.degrees(np.unwrap(np.angle(answer))), color=color, lw=0.7)
        for k, one in enumerate(axes):
            at = np.degrees(np.unwrap(np.angle(one.response)))
            points = {"color": color, "ls": "", "marker": "o", "ms": 3.0}
            label = f"{way}: simulated, {len(axes)} axes" if k == 0 else None
            gain.semilogx(JUDGED.frequencies_Hz, 20 * np.log10(np.abs(one.response)), label=label, **points)
            phase.semilogx(JUDGED.frequencies_Hz, at - 360.0 * np.ceil((at[0] - 90.0) / 360.0), **points)
    gain.axhline(-3.0, color=palette.REFERENCE, lw=0.7, ls=":")
    phase.axhline(-90.0, color=palette.REFERENCE, lw=0.7, ls=":")
    gain.set_ylim(-30, 12)
    phase.set_ylim(-360, 20)
    for plot, title, label in ((gain, "gain", "gain [dB]"), (phase, "phase", "phase [deg]")):
        plot.set_title(title, loc="left")
        plot.set_ylabel(label)
        plot.set_xlabel("frequency [Hz]")
        plot.set_xlim(*shown_Hz)
        plain_frequencies(plot)
    legend(gain, columns=2)
    return figure


def figures_json(tuning: Tuning) -> dict[str, Any]:
    """All figures as plain numbers."""

    def axis(one: AxisFigures) -> dict[str, Any]:
        gain, phase = 20 * np.log10(np.abs(one.response)), np.degrees(np.unwrap(np.angle(one.response)))
        return {k: v for k, v in vars(one).items() if k != "response"} | {
            "gain_dB": gain.tolist(),
            "phase_deg": phase.tolist(),
        }

    return {
        "machine": tuning.machines[0].name,
        "frequencies_Hz": list(JUDGED.frequencies_Hz),
        **{
            way: {
                "controller": machine.controller.model_dump(exclude_none=True),
                "margins": dataclasses.asdict(margins),
                "axes": [axis(one) for one in axes],
            }
            for way, machine, margins, axes in zip(WAYS, tuning.machines, tuning.margins, tuning.axes, strict=True)
        },
    }


def write_tuning(tuning: Tuning, folder: Path, declared: str | Path | None = None) -> None:
    """machine.toml with the new controller, tuning.json and bode.png into a folder. declared: whose comments it keeps."""
    save_machine(tuning.machines[1], folder / "machine.toml", declared)
    write_json(folder / "tuning.json", figures_json(tuning))
    (folder / "bode.png").write_bytes(png(bode_figure(tuning)))
