"""A leg whose oil warms from 15 to 60 degC while it works: the bump of each reversal, and what a temperature step does.

    python examples/warm_up.py [--out runs/warm_up]

Writes warm_up.png, laminar_edge.png and warm_up.json. Two minutes; the compensator takes most of them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import hexsim as hx
from hexsim.declaration.oil_grades import kinematic_viscosity
from hexsim.hydraulics import ports
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, png, small_multiples, styled
from hexsim.smoothness import BANDWIDTH_Hz, reversal_bumps

SLOT = 15.0  # Re_cr of a sharp slot, `hydraulics.valve`
EDGES = {"turbulent edges": 0.0, "laminar edges": SLOT}
COMPENSATORS = ("none", "adaptive")
REPORT_STEP_K = 15.0  # of the report's chapter 5.5
REPORT_degC = 35.0


def bumps(run: hx.Run) -> tuple[np.ndarray, np.ndarray]:
    """Oil temperature [degC] and peak-to-peak bump [m/s2] in the 50 Hz band of each reversal after the fade-in."""
    log = {name: run.log[name].to_numpy() for name in run.log.columns}
    found = reversal_bumps(
        log["time_s"],
        log["true_acceleration_m_s2"],
        log["commanded_velocity_m_s"],
        log["commanded_acceleration_m_s2"],
        start_s=run.scenario.fade_s,
    )
    at = np.array([bump.time_s for bump in found])
    return np.interp(at, log["time_s"], log["oil_temperature_degC"]), np.array([bump.bump_pp for bump in found])


def ride() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The scenario `warm_up` with either kind of edges, without and with compensation: name -> temperature, bump."""
    found = {}
    for edges, reynolds in EDGES.items():
        for name in COMPENSATORS:
            found[f"{edges}, {name}"] = bumps(hx.run("warm_up", "bench", name, {"valve.laminar_reynolds": reynolds}))
    return found


def steps() -> dict[str, dict[str, float]]:
    """Peak in the 50 Hz band [m/s2] at the report's 35 degC and 15 K to either side, all of the oil's numbers following."""
    rows: dict[str, dict[str, float]] = {}
    for degC in (REPORT_degC - REPORT_STEP_K, REPORT_degC, REPORT_degC + REPORT_STEP_K):
        rows[f"{degC:g} degC"] = row = {}
        for edges, reynolds in EDGES.items():
            keys = {"valve.laminar_reynolds": reynolds, "power_unit.oil_temperature_degC": degC}
            for name in COMPENSATORS:
                run = hx.run("heave", "bench", name, keys)
                row[f"{edges}, {name}"] = run.figures["leg"]["peak_band_m_s2"]
    return rows


@styled
def ride_figure(found: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Bump of each reversal over the oil's temperature, a plot for each kind of edges."""
    figure, plots = small_multiples(len(EDGES), "One leg, 0.05 m at 0.5 Hz, while its oil warms", len(EDGES), 3.0, True)
    for plot, edges in zip(plots, EDGES, strict=True):
        for name, color, size in zip(COMPENSATORS, (palette.DEVIATION, palette.RESPONSE), (5, 3), strict=True):
            plot.plot(*found[f"{edges}, {name}"], "o", color=color, markersize=size, markeredgewidth=0, label=name)
        plot.set_title(edges if edges == "turbulent edges" else f"{edges}, Re_cr = {SLOT:g}")
        plot.set_xlabel("oil [°C]")
        plot.set_ylim(0.0, 1.1 * max(np.max(bump) for _, bump in found.values()))
    plots[0].set_ylabel(f"bump, peak to peak\nin {BANDWIDTH_Hz:g} Hz [m/s²]")
    legend(plots[0])
    return figure


@styled
def edge_figure() -> Figure:
    """The law: discharge coefficient over Reynolds number beside its asymptotes, and flow over opening by temperature."""
    figure, (law, flow) = small_multiples(2, "A metering edge with a laminar range", 2, 3.0, False)
    ratio = np.logspace(-2, 4, 400)  # dp/p_cr
    share = (ratio**2 / (1.0 + ratio**2)) ** 0.25
    reynolds = SLOT * share * np.sqrt(ratio)
    law.loglog(reynolds, 0.611 * share, color=palette.RESPONSE, label="hexsim")
    law.loglog(reynolds, 0.157 * np.sqrt(reynolds), color=palette.REFERENCE, ls="--", label="0.157 √Re (Merritt, slot)")
    law.axhline(0.611, color=palette.REFERENCE, ls=":", label="0.611")
    law.set(xlim=(0.5, 1e3), ylim=(0.1, 1.0), yticks=[0.1, 0.2, 0.4, 0.6, 1.0])
    for axis in (law.xaxis, law.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    law.set_xlabel("Re of mean velocity and twice the opening")
    law.set_ylabel("discharge coefficient")
    legend(law, 1)
    opening = np.linspace(0.0, 30e-6, 200)
    for degC, color in zip((15.0, 35.0, 60.0), palette.RUNS, strict=False):
        bench = hx.load_machine("bench").with_({"valve.laminar_reynolds": SLOT, "oil.temperature_degC": degC})
        row = resolve(bench).rows[0]
        through = [ports.supply_edge_flow(row, row[P.OVERLAP_SUPPLY] + o, 35e5, 70e5) for o in opening]
        viscosity = 1e6 * kinematic_viscosity(degC)
        flow.plot(1e6 * opening, 6e4 * np.array(through), color=color, label=f"{degC:g} °C, {viscosity:.0f} mm²/s")
    row[P.LAMINAR] = 0.0
    through = [ports.supply_edge_flow(row, row[P.OVERLAP_SUPPLY] + o, 35e5, 70e5) for o in opening]
    flow.plot(1e6 * opening, 6e4 * np.array(through), color=palette.REFERENCE, ls="--", label="turbulent")
    flow.set_xlabel("opening [µm]")
    flow.set_ylabel("flow at 35 bar [l/min]")
    legend(flow, 1)
    return figure


def main(out: Path) -> None:
    """Write both pictures and the table."""
    out.mkdir(parents=True, exist_ok=True)
    found = ride()
    (out / "warm_up.png").write_bytes(png(ride_figure(found)))
    (out / "laminar_edge.png").write_bytes(png(edge_figure()))
    ends = {
        name: {
            f"{degC:g} degC": round(float(np.interp(degC, heat, np.convolve(bump, np.ones(4) / 4, "same"))), 3)
            for degC in (16.0, 25.0, 35.0, 45.0, 55.0)
        }
        for name, (heat, bump) in found.items()
    }
    table = {"bump_pp_m_s2": ends, "peak_band_m_s2": steps()}
    (out / "warm_up.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(table, indent=1))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="The bump while the oil warms.")
    parser.add_argument("--out", type=Path, default=Path("runs/warm_up"), help="folder to write")
    main(parser.parse_args().out)
