"""Figures and page of a valve test, in the units of data sheets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w
from matplotlib.figure import Figure

from hexsim.declaration import Machine
from hexsim.files.json_files import write_json
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, plain_frequencies, png, small_multiples, styled
from hexsim.recording.page import Column, Report, Section, bold, lead, picture, table, text_block
from hexsim.recording.quantity import BAR, L_MIN
from hexsim.studies.valve_test import FREQUENCIES_Hz, ValveTest

CAPTIONS = {
    "static": "What does the valve let through? "
    "Flow over signal at constant valve drop, a full slow cycle; the same about null; a small reversal at half signal; "
    "load pressure with blocked ports; flow from the supply with blocked ports.",
    "dynamic": "How fast is the spool? "
    "Steps of the signal, and gain and phase of the first harmonic: the spool's position over the signal.",
}


@styled
def static_figure(test: ValveTest) -> Figure:
    """Flow, flow about null, a reversal, pressure gain and leakage over the signal."""
    figure, (whole, close, reversal, pressure, leakage) = small_multiples(5, "Static tests", columns=2, height=2.7)
    ways = (("falling", slice(0, 1001), palette.MARK), ("rising", slice(1000, 2001), palette.RESPONSE))
    near = _near_null(test)
    for name, way, color in ways:
        signal = 100.0 * test.signal[way]
        for plot in (whole, close):
            plot.plot(signal, L_MIN * test.flow_m3_s[way], color=color, lw=1.3, label=f"signal {name}")
        pressure.plot(signal, BAR * test.load_pressure_Pa[way], color=color, lw=1.3)
        leakage.plot(signal, L_MIN * test.leakage_m3_s[way], color=color, lw=1.3)
    reversal.plot(100.0 * test.reversal, L_MIN * test.reversed_flow_m3_s, color=palette.MARK, lw=1.3)
    shown = np.abs(100.0 * test.signal) <= near
    limit = 1.05 * max(L_MIN * float(np.max(np.abs(test.flow_m3_s[shown]))), 1e-3)
    close.set_xlim(-near, near)
    close.set_ylim(-limit, limit)
    pressure.set_xlim(-near, near)
    leakage.set_xlim(-near, near)
    leakage.set_ylim(bottom=0.0)
    for plot, title, label in (
        (whole, f"flow, valve drop {BAR * test.drop_Pa:.3g} bar", "flow [l/min]"),
        (close, "flow about null", "flow [l/min]"),
        (reversal, f"reversal: threshold {test.figures['threshold_percent']:.2g} %", "flow [l/min]"),
        (pressure, "ports blocked: load pressure", "load pressure [bar]"),
        (leakage, "ports blocked: internal leakage", "flow [l/min]"),
    ):
        plot.set_title(title, loc="left")
        plot.set_ylabel(label)
        plot.set_xlabel("signal [%]")
    legend(close, columns=2)
    return figure


def _near_null(test: ValveTest) -> float:
    """Range of the close-ups [% of signal]: four times what is dead or wide, at least 2 %."""
    figures = test.figures
    return float(np.clip(4 * (figures["dead_band_percent"] + figures["hysteresis_percent"]), 2.0, 50.0))


@styled
def dynamic_figure(test: ValveTest) -> Figure:
    """Steps, gain and phase."""
    figure, (step, gain, phase) = small_multiples(3, "Dynamic tests", columns=3, height=3.0)
    colors = dict(zip(sorted({*test.step, *test.bode}), palette.RUNS, strict=False))
    for amplitude, answer in test.step.items():
        color = colors[amplitude]
        step.plot(1e3 * test.time_s, 100.0 * answer, color=color, lw=1.3)
        step.axhline(100.0 * amplitude, color=palette.REFERENCE, lw=0.7, ls=":")
    for amplitude, (size, angle) in test.bode.items():
        color = colors[amplitude]
        gain.semilogx(FREQUENCIES_Hz, 20 * np.log10(size), color=color, lw=1.3, label=f"{100.0 * amplitude:g} %")
        phase.semilogx(FREQUENCIES_Hz, angle, color=color, lw=1.3)
    gain.axhline(-3.0, color=palette.REFERENCE, lw=0.7, ls=":")
    phase.axhline(-90.0, color=palette.REFERENCE, lw=0.7, ls=":")
    last = [np.flatnonzero(np.abs(x - a) > 0.02 * a) for a, x in test.step.items()]
    settled = max((int(k[-1]) for k in last if len(k)), default=0)
    step.set_xlim(0, 1e3 * test.time_s[min(max(int(1.3 * settled), 100), len(test.time_s) - 1)])
    gain.set_ylim(-20, 5)
    phase.set_ylim(-200, 10)
    for plot, title, label in (
        (step, "step", "spool [%]"),
        (gain, "gain", "gain [dB]"),
        (phase, "phase", "phase [deg]"),
    ):
        plot.set_title(title, loc="left")
        plot.set_ylabel(label)
    step.set_xlabel("time [ms]")
    for plot in (gain, phase):
        plot.set_xlim(2.0, 700.0)
        plain_frequencies(plot)
        plot.set_xlabel("frequency [Hz]")
    legend(gain, columns=3)
    return figure


def write_valve_report(test: ValveTest, machine: Machine, folder: Path) -> None:
    """report.html, valve.json and the figures into a folder."""
    pictures = {"static": png(static_figure(test)), "dynamic": png(dynamic_figure(test))}
    for name, png_bytes in pictures.items():
        (folder / f"{name}.png").write_bytes(png_bytes)
    curves = {
        "signal": test.signal,
        "flow_m3_s": test.flow_m3_s,
        "load_pressure_Pa": test.load_pressure_Pa,
        "leakage_m3_s": test.leakage_m3_s,
        "reversal": test.reversal,
        "reversed_flow_m3_s": test.reversed_flow_m3_s,
    }
    write_json(
        folder / "valve.json",
        {"machine": machine.name, "figures": test.figures, "curves": {k: v.tolist() for k, v in curves.items()}},
    )
    page = Report(
        f"Valve of {machine.name}",
        [
            Section(
                "Figures of a data sheet",
                [
                    table(
                        ["figure", "value", Column("unit", "text")],
                        [(name, bold(value), unit) for name, value, unit in test.table()],
                    )
                ],
            ),
            Section("Curves", [picture(png_bytes, CAPTIONS[name]) for name, png_bytes in pictures.items()]),
            Section("As declared", [text_block(tomli_w.dumps({"valve": machine.valve.model_dump(exclude_none=True)}))]),
        ],
        about=f"{machine.valve.kind.replace('_', '-')} valve as declared, tested after ISO 10770",
        top=[
            lead(
                "Hold this against the valve's data sheet: what differs is a slip in the declaration, or what the model leaves out."
            )
        ],
    ).html()
    (folder / "report.html").write_text(page, encoding="utf-8")
