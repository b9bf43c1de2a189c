"""Chapter 5 of report DCT 2005.79, drawn: how its algorithms take the reversal bump away, and where they stop.

    python examples/report_chapter5.py [folder]

One vertical leg, 40 kg, the smooth valve of Eq. 3.11, friction as in Eq. 3.9, 10 kHz, 0.05 m at 0.5 Hz: the simulation
of the report. Draws peaks.png (peak deviation, period by period: iterative with functions 1 and 2, buffered, exact),
functions.png (Eq. 5.2 and 5.3, and what was learned), oil_step.png (15 degC warmer at 14 s) and prints the figures.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "compensation"))
from leg_plant import Leg, Record, run  # the tests' leg: the report's equations and nothing else

from compensation import Compensator, create
from compensation.buffered import Buffered
from compensation.exact import Exact
from compensation.flow_curve import quadratic_curve
from compensation.iterative import Iterative
from compensation.report_functions import function_1, function_2

REPORT_LEG = dict(quadratic=True, spool_Hz=0.0, sharpness_m_s=0.0)


def drive(compensator: Compensator, duration_s: float, change: Callable[[float, Leg], None] | None = None) -> Record:
    """The report's leg under one algorithm, at 10 kHz, clean signals."""
    return run(compensator, Leg(**REPORT_LEG), duration_s=duration_s, rate_Hz=1e4, noise=False, change=change)


def algorithms() -> dict[str, Compensator]:
    """The report's algorithms as it describes them, the half width of 5.3 as printed, and the exact inverse."""
    iterative = dict(form="report", gain=2.0, velocity_bandwidth_Hz=None)
    return {
        "none": create("none"),
        "exact inverse (5.2)": Exact(curve=quadratic_curve(), slope_m_s_V=0.15),
        "iterative, function 1 (5.4.1)": Iterative(function=1, **iterative),
        "iterative, function 2 (5.4.2)": Iterative(function=2, **iterative),
        "iterative, function 2, r as printed": Iterative(function=2, offset="half width", **iterative),
        "buffered (5.5)": Buffered(form="report"),
        "buffered, corrected": Buffered(),
    }


def draw_peaks(records: dict[str, Record], folder: Path) -> None:
    """Raw peak deviation from the fundamental, period by period."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    for name, record in records.items():
        peaks = record.peaks(band_Hz=None)
        print(f"{name:38s} first {peaks[0]:.3f}  lowest {peaks.min():.3f}  last {peaks[-1]:.3f} m/s2")
        axes.plot(3 + 2 * np.arange(len(peaks)), peaks, "o-", ms=3, label=name)
    axes.set(xlabel="time [s]", ylabel="peak deviation [m/s2], no band limit", ylim=(0, 1.5))
    axes.set_title("Peak at the reversals, 40 kg, 0.05 m at 0.5 Hz")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.savefig(folder / "peaks.png", dpi=120)


def draw_functions(records: dict[str, Record], folder: Path) -> None:
    """Eq. 5.2 and 5.3 with a = q/4, the exact inverse, and the curves that were learned."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    q, u = 1.0, np.linspace(-1.2, 1.2, 1001)
    exact = np.sign(u) * np.sqrt(q * np.abs(u)) - u
    axes.plot(u, exact, "k", lw=3, alpha=0.3, label="exact, sqrt(q u) - u")
    axes.plot(u, [function_1(x, q / 4, np.pi / q, 0.0) for x in u], "--", label="function 1, Eq. 5.2")
    axes.plot(u, [function_2(x, q / 4, 1 / q, 0.0) for x in u], "--", label="function 2, Eq. 5.3")
    for name in ("buffered (5.5)", "buffered, corrected"):
        a, learned_q, r = records[name].known["curves"][0]
        axes.plot(u, [function_2(x, a, 1 / learned_q, r / learned_q) for x in u], lw=1, label=f"learned: {name}")
    axes.set(xlabel="control voltage [V]", ylabel="compensation [V]", title="Compensation functions, q = 1 V")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.savefig(folder / "functions.png", dpi=120)


def draw_oil_step(folder: Path) -> None:
    """Acceleration of the buffered algorithm before and after the oil becomes 15 degC warmer."""

    def warmer(time_s: float, leg: Leg) -> None:
        if time_s >= 14.0:
            leg.density_kg_m3, leg.friction = 850.0, 0.67  # T46, 35 to 50 degC: 10 kg/m3 lighter, a third less viscous

    record = drive(Buffered(), 28.0, warmer)
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.arange(len(record.acceleration_m_s2)) * 1e-4, record.acceleration_m_s2, lw=0.6)
    axes.axvline(14.0, color="r", lw=1, label="oil 15 degC warmer")
    axes.set(xlabel="time [s]", ylabel="acceleration [m/s2]", title="Buffered algorithm, corrected form")
    axes.legend()
    figure.savefig(folder / "oil_step.png", dpi=120)
    peaks = record.peaks(band_Hz=None)
    print(f"oil step: peak {peaks[5]:.3f} before, {peaks[6:9].max():.3f} at it, {peaks[-1]:.3f} m/s2 at the end")


def main(folder: Path, duration_s: float = 60.0) -> None:
    """All figures into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    records = {name: drive(compensator, duration_s) for name, compensator in algorithms().items()}
    draw_peaks(records, folder)
    draw_functions(records, folder)
    draw_oil_step(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "report_chapter5"))
