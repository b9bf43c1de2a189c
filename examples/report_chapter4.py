"""Chapter 4 of the report: simulation and reality. Each difference it names, switched on alone, with figure and number.

    python examples/report_chapter4.py [--out runs/report_chapter4] [--duration 10]

simulation    one vertical leg with 40 kg, constant supply, sharp valve                      (chapter 3)
+ supply      a hydraulic power unit instead of constant pressure                            (4.3, Fig. 2.8 and 4.2)
+ inclination the leg stands as in the machine, and the machine itself with one leg driven   (4.2)
+ valve       hysteresis, and edges that are not sharp                                       (4.4, Fig. 4.3)
all           all of them, with the noise of the sensors                                     (4.2, Fig. 4.1)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import polars as pl

import hexsim as hx
from hexsim.machine.geometry import machine_kinematics
from hexsim.recording.figure_style import legend, new_figure, png, small_multiples, styled
from hexsim.scenarios import scenario_from_dict
from hexsim.smoothness import band_limit, harmonic_deviation, peaks_at_reversals, reversals_of_velocity

FREQUENCY_Hz = 0.5
AMPLITUDE_m = 0.05
POWER_UNIT = {"power_unit": {}}
ROUNDED = {"valve.edge_rounding_m": 2.0e-6}  # [m] as the measured benches of this project declare it
HYSTERESIS = {"effects.valve_hysteresis": {"half_width_V": 0.04}}  # 0.4 % of the stroke to either side
FILTER_Hz = 5.0  # low-pass of the report's filtfilt before differentiation; its order and corner are not stated
PEAKS = (("peak at the top", "m/s2"), ("peak at the bottom", "m/s2"))  # deviation from the fundamental, 50 Hz

Table = list[tuple[str, str, float, float, str]]  # (difference, quantity, simulation, with it, unit)


def leg_inclination() -> float:
    """Angle of a leg to the vertical at neutral [rad]."""
    machine = hx.load_machine("micro_motion_system")
    kinematics = machine_kinematics(machine)
    return float(np.arccos(kinematics.neutral_height_m / float(kinematics.leg_lengths(np.zeros(6))[0])))


def bench_run(changes: dict, duration_s: float) -> pl.DataFrame:
    """Log of the bench with changes, the report's sine."""
    return hx.run("heave", hx.load_machine("bench").with_(changes), set={"scenario.duration_s": duration_s}).log


def hexapod_run(machine: hx.Machine, duration_s: float, leg: bool = False) -> pl.DataFrame:
    """Log of the whole machine: heave, or the report's own experiment with one leg driven and the others held."""
    scenario = hx.load_scenario("heave", duration_s=duration_s)
    if leg:
        sine = {"kind": "sine", "amplitude": AMPLITUDE_m, "frequency_Hz": FREQUENCY_Hz}
        scenario = scenario_from_dict(
            {"name": "one leg", "mode": "actuator", "duration_s": duration_s, "axes": {"leg_1": sine}}
        )
    return hx.run(scenario, machine, fast=True).log


def late(log: pl.DataFrame) -> pl.DataFrame:
    """The last whole periods after the fade-in."""
    time = log["time_s"].to_numpy()
    period = 1.0 / FREQUENCY_Hz
    count = max(int((time[-1] - 4.0 + 1e-3) / period), 1)
    return log.filter(pl.col("time_s") > time[-1] - count * period)


def reversal_peaks(time: np.ndarray, acceleration: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Largest deviation from the fundamental at the top and at the bottom of the stroke [m/s2], 50 Hz band."""
    deviation = harmonic_deviation(time, acceleration, FREQUENCY_Hz, start_s=time[0])
    part = np.searchsorted(time, deviation.time_s[0] - 1e-9)
    reversals = reversals_of_velocity(deviation.time_s, velocity[part : part + len(deviation.time_s)])
    peaks = peaks_at_reversals(deviation.time_s, deviation.band, reversals)
    return tuple(max(p.peak for p in peaks if p.end == end) for end in ("top", "bottom"))


def bar(log: pl.DataFrame, column: str) -> np.ndarray:
    return log[column].to_numpy() / 1e5


@styled
def supply(simulation: pl.DataFrame, duration_s: float, out: Path) -> Table:
    """Constant supply against the power unit: one leg as in the report, and all six."""
    one = bench_run(POWER_UNIT, duration_s)
    machine = hx.load_machine("micro_motion_system")
    six_constant = hexapod_run(machine, duration_s)
    six = hexapod_run(hx.load_machine("micro_motion_system/power_unit"), duration_s)
    figure, plots = small_multiples(4, "Supply: constant against power unit (Fig. 2.8, 4.2)", 2, share_columns=True)
    table: Table = []
    columns = (("one leg", simulation, one, ""), ("six legs, heave", six_constant, six, "_1"))
    for column, (name, constant, unit, mark) in enumerate(columns):
        signals = (("Ps", "true_pressure_supply_Pa"), ("P1", f"true_pressure_bottom{mark}_Pa"))
        for row, (title, signal) in enumerate(signals):
            plot = plots[2 * row + column]
            plot.plot(constant["time_s"], bar(constant, signal), label="constant supply")
            plot.plot(unit["time_s"], bar(unit, signal), label="power unit")
            plot.set_ylabel(f"{title} [bar]")
            plot.set_title(f"{title}, {name}", loc="left")
            swings = [float(np.ptp(bar(late(log), signal))) for log in (constant, unit)]
            means = [float(bar(late(log), signal).mean()) for log in (constant, unit)]
            table.append((f"supply, {name}", f"{title} swing", *swings, "bar"))
            table.append((f"supply, {name}", f"{title} mean", *means, "bar"))
        plots[2 + column].set_xlabel("time [s]")
    legend(plots[1])
    (out / "supply.png").write_bytes(png(figure))
    return table


@styled
def inclination(simulation: pl.DataFrame, duration_s: float, out: Path) -> Table:
    """Vertical leg against one inclined as in the machine, and against the machine with one leg driven."""
    angle = leg_inclination()
    inclined = bench_run({"effects.incline": {"angle_rad": angle}}, duration_s)
    driven = hexapod_run(hx.load_machine("micro_motion_system"), duration_s, leg=True)
    driven = driven.with_columns(
        pl.Series("true_acceleration_m_s2", np.gradient(driven["velocity_1_m_s"].to_numpy(), 1e-3))
    )
    figure, plots = new_figure(2, "Vertical against inclined leg (4.2)")
    cases = (
        ("vertical", simulation, ""),
        (f"inclined by {np.degrees(angle):.0f} deg", inclined, ""),
        ("leg 1 of the 600 kg machine", driven, "_1"),
    )
    table: Table = []
    reference: list[float] = []
    for name, log, mark in cases:
        log = late(log)
        time, acceleration = log["time_s"].to_numpy(), log["true_acceleration_m_s2"].to_numpy()
        pressure = bar(log, f"true_pressure_bottom{mark}_Pa")
        width = 1.5 if reference else 3.0
        plots[0].plot(time, band_limit(time, acceleration), label=name, linewidth=width)
        plots[1].plot(time, pressure, label=name, linewidth=width)
        top, bottom = reversal_peaks(time, acceleration, log[f"velocity{mark}_m_s"].to_numpy())
        values = [float(pressure.mean()), float(np.ptp(pressure)), top, bottom]
        if not reference:
            reference = values
            continue
        quantities = (("P1 mean", "bar"), ("P1 swing", "bar"), *PEAKS)
        table += [(name, quantity, reference[k], values[k], unit) for k, (quantity, unit) in enumerate(quantities)]
    plots[0].set_ylabel("acceleration along\nthe leg, 50 Hz [m/s2]")
    plots[1].set_ylabel("P1 [bar]")
    plots[1].set_xlabel("time [s]")
    legend(plots[0])
    (out / "inclination.png").write_bytes(png(figure))
    return table


def filtered_flow_curve(log: pl.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """(valve volts, velocity) as the report gets them: both through one zero-phase low-pass, then differentiated."""
    time = log["time_s"].to_numpy()
    step = float(time[1] - time[0])
    volts = band_limit(time, log["valve_V"].to_numpy(), FILTER_Hz)
    velocity = np.gradient(band_limit(time, log["position_m"].to_numpy(), FILTER_Hz), step)
    return volts, velocity


def crossing_volts(volts: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Mean volts at which the velocity passes zero, downwards (top of the stroke) and upwards (bottom)."""
    places = np.flatnonzero(np.diff(np.signbit(velocity)))
    down = [volts[k] for k in places if velocity[k] > velocity[k + 1]]
    up = [volts[k] for k in places if velocity[k] < velocity[k + 1]]
    return float(np.mean(down)), float(np.mean(up))


@styled
def flow_curve(simulation: pl.DataFrame, duration_s: float, out: Path) -> Table:
    """Sharp valve against hysteresis and rounded edges: the flow curve as it is and as the report's filter shows it."""
    cases = (
        ("sharp", simulation),
        ("rounded edges", bench_run(ROUNDED, duration_s)),
        ("hysteresis", bench_run(HYSTERESIS, duration_s)),
    )
    figure, plots = small_multiples(3, "Flow curve (Fig. 4.3): true near zero, and behind the low-pass", 3, height=3.2)
    table: Table = []
    reference: list[float] = []
    for name, log in cases:
        log = late(log)
        time, velocity = log["time_s"].to_numpy(), log["velocity_m_s"].to_numpy()
        volts, shown = filtered_flow_curve(log)
        inner = slice(300, -300)  # the filter's ends
        plots[0].plot(log["valve_V"].to_numpy()[:2000], velocity[:2000] * 1e3, label=name, linewidth=0.8)
        plots[1].plot(volts[inner], shown[inner] * 1e3, label=name, linewidth=0.8)
        plots[2].plot(volts[inner], shown[inner] * 1e3, label=name, linewidth=0.8)
        top, bottom = crossing_volts(volts[inner], shown[inner])
        true_top, true_bottom = crossing_volts(log["valve_V"].to_numpy(), velocity)
        peaks = reversal_peaks(time, log["true_acceleration_m_s2"].to_numpy(), velocity)
        values = [1e3 * (true_bottom - true_top), 1e3 * (bottom - top), *peaks]
        if not reference:
            reference = values
            continue
        quantities = (("loop at v = 0, true", "mV"), ("loop at v = 0, filtered", "mV"), *PEAKS)
        table += [(name, quantity, reference[k], values[k], unit) for k, (quantity, unit) in enumerate(quantities)]
    titles = ("true, near zero", f"filtered at {FILTER_Hz:g} Hz, near zero", "filtered, whole")
    for plot, title in zip(plots, titles, strict=True):
        plot.set_title(title, loc="left")
        plot.set_xlabel("valve setpoint [V]")
    for plot in plots[:2]:
        plot.set_xlim(-0.15, 0.15)
        plot.set_ylim(-20, 20)
    plots[0].set_ylabel("piston velocity [mm/s]")
    plots[2].legend(loc="lower right", frameon=False)
    (out / "flow_curve.png").write_bytes(png(figure))
    return table


@styled
def whole(simulation: pl.DataFrame, duration_s: float, out: Path) -> Table:
    """Fig. 4.1: the simulation against all differences together, as the accelerometer shows it."""
    incline = {"effects.incline": {"angle_rad": leg_inclination()}}
    log = late(bench_run(POWER_UNIT | ROUNDED | HYSTERESIS | incline, duration_s))
    simulation = late(simulation)
    figure, plots = new_figure(2, "Acceleration (Fig. 4.1): simulation, and with all differences")
    for plot, signal, shown, colour in (
        (plots[0], "true_acceleration_m_s2", simulation, "C0"),
        (plots[1], "acceleration_m_s2", log, "C1"),
    ):
        plot.plot(shown["time_s"], shown[signal], linewidth=0.7, color=colour)
        plot.set_ylabel("acceleration [m/s2]")
    plots[0].set_title("simulation: constant supply, vertical, sharp valve, no sensor", loc="left")
    plots[1].set_title("power unit, inclined, rounded edges and hysteresis, accelerometer", loc="left")
    plots[1].set_xlabel("time [s]")
    limit = max(np.abs(plot.get_ylim()).max() for plot in plots)
    for plot in plots:
        plot.set_ylim(-limit, limit)
    (out / "acceleration.png").write_bytes(png(figure))
    peaks = [
        reversal_peaks(x["time_s"].to_numpy(), x["true_acceleration_m_s2"].to_numpy(), x["velocity_m_s"].to_numpy())
        for x in (simulation, log)
    ]
    table = [("all", quantity, peaks[0][k], peaks[1][k], unit) for k, (quantity, unit) in enumerate(PEAKS)]
    noise = float(np.std(log["acceleration_m_s2"].to_numpy() - log["true_acceleration_m_s2"].to_numpy()))
    return [*table, ("all", "sensor noise, one sigma", 0.0, noise, "m/s2")]


def main(out: Path, duration_s: float = 10.0) -> Table:
    """Write four figures and the table; returns the table."""
    out.mkdir(parents=True, exist_ok=True)
    simulation = bench_run({}, duration_s)
    table: Table = []
    for part in (supply, inclination, flow_curve, whole):
        table += part(simulation, duration_s, out)
    lines = [f"{'difference':30s} {'quantity':26s} {'simulation':>11s} {'with it':>11s}"]
    lines += [f"{what:30s} {quantity:26s} {a:11.3f} {b:11.3f} {unit}" for what, quantity, a, b, unit in table]
    (out / "table.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Chapter 4 of the report: each difference with figure and number.")
    parser.add_argument("--out", type=Path, default=Path("runs/report_chapter4"), help="folder for figures and table")
    parser.add_argument("--duration", type=float, default=10.0, help="seconds of each run (6 or more)")
    arguments = parser.parse_args()
    main(arguments.out, arguments.duration)
