"""Chapter 3 of the report: one leg with 40 kg, 0.05 m at 0.5 Hz, drawn as Fig. 3.4 to 3.10, with its numbers.

    python examples/report_chapter3.py [--out runs/report_chapter3] [--duration 12]

overlap    flow area of Eq. 3.3, sharp edges        Fig. 3.4 to 3.6: transient at the eigenfrequency
quadratic  flow area of Eq. 3.11, smooth            Fig. 3.8 to 3.10: two peaks a reversal, no transient
zero lap   Eq. 3.3 without overlap: what friction and compressibility alone leave
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import hexsim as hx
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, png, small_multiples, styled
from hexsim.recording.signals import Signals

FROM_S = 6.0  # figures count from here; the setpoint fades in for 2 s
VALVES = {"overlap": {}, "quadratic": {"valve.flow_area": "quadratic"}, "zero lap": {"valve.overlap_m": 0.0}}
# peaks of an independent calculation, converged in step size: deviation from the fundamental, no band limit [m/s2]
INDEPENDENT = {"overlap": 0.731, "quadratic": 0.438, "zero lap": 0.052}
EIGENFREQUENCY_Hz = np.sqrt(2 * 1.5e9 * np.pi / 4 * 0.04**2 / (40.0 * 0.2)) / (2 * np.pi)  # sqrt(2 E A1/(M Ls)): 109 Hz


def run_all(duration_s: float) -> dict[str, hx.Run]:
    """The three valves on the same bench under the same motion."""
    bench, scenario = hx.load_machine("bench"), hx.load_scenario("report", duration_s=duration_s)
    scenario = dataclasses.replace(scenario, figures_from_s=FROM_S)
    return {name: hx.run(scenario, bench.with_(changes)) for name, changes in VALVES.items()}


@styled
def simulation_results(run: hx.Run, title: str) -> Figure:
    """Fig. 3.4 and 3.8: position, tracking error, flow and bottom pressure."""
    figure, (position, error, flow, pressure) = small_multiples(4, title, columns=2)
    log = run.log
    t = log["time_s"]
    position.plot(t, 1e3 * log["setpoint_m"], color=palette.REFERENCE, lw=2.2, label="setpoint")
    position.plot(t, 1e3 * log["true_position_m"], color=palette.RESPONSE, label="position")
    error.plot(t, 1e3 * (log["setpoint_m"] - log["true_position_m"]), color=palette.RESPONSE)
    flow.plot(t, 6e4 * log["flow_m3_s"], color=palette.RESPONSE)
    pressure.plot(t, 1e-5 * log["true_pressure_bottom_Pa"], color=palette.RESPONSE, lw=0.9)
    names = ("position [mm]", "tracking error [mm]", "flow [l/min]", "bottom pressure [bar]")
    for plot, name in zip((position, error, flow, pressure), names, strict=True):
        plot.set_title(name, loc="left")
        plot.set_xlabel("time [s]")
    legend(position)
    return figure


@styled
def acceleration_profile(run: hx.Run, title: str) -> Figure:
    """Fig. 3.5, 3.6 and 3.9, 3.10: acceleration, one reversal close up, its spectrum, and the flow curve."""
    figure, (profile, transient, spectrum, curve) = small_multiples(4, title, columns=2)
    signals = Signals.of_run(run)
    t, acceleration = signals.time_s, run.log["true_acceleration_m_s2"].to_numpy()
    found = signals.deviation("leg")
    assert found is not None
    profile.plot(t, acceleration, color=palette.RESPONSE, lw=0.8)
    profile.plot(found.time_s, found.reference, color=palette.REFERENCE, lw=1.6)
    profile.set_xlim(t[-1] - 4.0, t[-1])
    largest = max((peak for peak in found.peaks if peak.time_s > FROM_S), key=lambda peak: abs(peak.value))
    near = np.abs(t - largest.time_s) < 0.12
    transient.plot(t[near], acceleration[near], color=palette.RESPONSE, lw=1.0)
    late = t >= FROM_S
    amplitude = np.abs(np.fft.rfft(acceleration[late] * np.hanning(late.sum()))) * 4 / late.sum()
    spectrum.semilogy(np.fft.rfftfreq(late.sum(), t[1] - t[0]), amplitude, color=palette.RESPONSE, lw=0.9)
    spectrum.axvline(EIGENFREQUENCY_Hz, color=palette.DEVIATION, ls=":", lw=1.2)
    spectrum.set(xlim=(0, 200), ylim=(1e-6, 1.0))
    spectrum.text(EIGENFREQUENCY_Hz + 2, 0.3, f"{EIGENFREQUENCY_Hz:.0f} Hz", color=palette.DEVIATION)
    curve.plot(run.log["valve_V"].to_numpy()[late], 6e4 * run.log["flow_m3_s"].to_numpy()[late], color=palette.RESPONSE)
    names = ("acceleration [m/s²]", "one reversal [m/s²]", "amplitude [m/s²]", "flow [l/min]")
    below = ("time [s]", "time [s]", "frequency [Hz]", "valve [V]")
    for plot, name, label in zip((profile, transient, spectrum, curve), names, below, strict=True):
        plot.set_title(name, loc="left")
        plot.set_xlabel(label)
    return figure


def dead_band_mV(run: hx.Run) -> tuple[float, float]:
    """Largest voltages of either sign at which the valve passes nothing (under 0.01 l/min)."""
    late = run.log.filter((run.log["time_s"] >= FROM_S) & (run.log["flow_m3_s"].abs() < 0.01 / 6e4))
    return 1e3 * float(late["valve_V"].min() or 0.0), 1e3 * float(late["valve_V"].max() or 0.0)


def rows(runs: dict[str, hx.Run]) -> list[tuple[str, str, float, float | None, str]]:
    """(valve, quantity, value, independent value if there is one, unit)."""
    table: list[tuple[str, str, float, float | None, str]] = []
    for name, run in runs.items():
        figures = run.figures["leg"]
        pressure = run.log.filter(run.log["time_s"] >= FROM_S)["true_pressure_bottom_Pa"] * 1e-5
        table.append((name, "peak deviation, no band limit", figures["peak_raw_m_s2"], INDEPENDENT[name], "m/s2"))
        table.append((name, "peak deviation, 50 Hz", figures["peak_band_m_s2"], None, "m/s2"))
        table.append((name, "fundamental", figures["fundamental_m_s2"], None, "m/s2"))
        table += [
            (name, f"bottom pressure, {key}", float(getattr(pressure, key)()), None, "bar") for key in ("min", "max")
        ]
        low, high = dead_band_mV(run)
        table += [(name, "dead band, from", low, None, "mV"), (name, "dead band, to", high, None, "mV")]
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description="Chapter 3 of the report, drawn.")
    parser.add_argument("--out", type=Path, default=Path("runs/report_chapter3"))
    parser.add_argument("--duration", type=float, default=12.0, help="simulated time [s], at least 9")
    options = parser.parse_args()
    runs = run_all(options.duration)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, run in runs.items():
        stem = name.replace(" ", "_")
        (options.out / f"{stem}_results.png").write_bytes(png(simulation_results(run, f"Simulation results, {name}")))
        picture = png(acceleration_profile(run, f"Acceleration and flow curve, {name}"))
        (options.out / f"{stem}_acceleration.png").write_bytes(picture)
    print(f"{'valve':<10} {'quantity':<30} {'value':>9} {'independent':>12}  unit")
    for name, quantity, value, independent, unit in rows(runs):
        print(f"{name:<10} {quantity:<30} {value:>9.3f} {independent if independent else '':>12}  {unit}")
    print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
