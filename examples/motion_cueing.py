"""Motion cueing end to end: a car's manoeuvre, a classical washout, the machine, and what a person on it feels.

    python examples/motion_cueing.py --out cueing             writes setpoints.csv, felt.csv, cueing.png, cueing.json

The manoeuvre is generated: pull away, brake, a double lane change, and a bump; or it is a table of a vehicle's motion,
as flight_manoeuvre.py writes one (`--vehicle flight.csv`). A classical washout splits it (`hexsim.cueing.washout`):
what is quick goes through high-pass filters to position, what is slow leans the platform so that gravity stands in for
it (tilt coordination, limited to 3 deg/s so that the leaning itself is not felt).

    python examples/motion_cueing.py --compensator adaptive --tune --host 60,jitter=0.2,loss=0.02,derivatives

With `--tune` the compensator starts with what it has learned on the machine's simulated twin; with `--host` packets of a
host that knows no future drive the machine, `derivatives` with velocities and accelerations in them.
setpoints.csv is an ordinary setpoint file: `hexsim run cueing/setpoints.csv` plays it too.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import polars as pl

import hexsim as hx
from hexsim.cueing.protocols import NAMES
from hexsim.cueing.washout import Washout, g, poses, specific_force
from hexsim.machine.geometry import machine_kinematics
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, new_figure, png, styled
from hexsim.simulation.hosted import Host
from hexsim.smoothness import band_limit, response_delay_s
from hexsim.smoothness.threshold import PERCEPTION_m_s2
from hexsim.studies.tune_start import FILE, teach

RATE_Hz = 500.0
WASHOUT = Washout()


def bell(time, start, length):
    """A smooth pulse of height 1, sin^2, from start on."""
    phase = np.clip((time - start) / length, 0.0, 1.0)
    return np.sin(np.pi * phase) ** 2


def plateau(time, start, length, rise=0.6):
    """Smoothly up in `rise`, held, smoothly down."""
    smooth = lambda r: r**3 * (10 - 15 * r + 6 * r**2)  # noqa: E731
    return smooth(np.clip((time - start) / rise, 0, 1)) - smooth(np.clip((time - start - length) / rise, 0, 1))


def manoeuvre(time):
    """Accelerations of the vehicle (n, 3) [m/s2], forward, left, up."""
    forward = 2.0 * plateau(time, 2.0, 4.0) - 3.5 * plateau(time, 9.0, 2.5)
    lane = np.where((time > 14.0) & (time < 18.0), 2.5 * np.sin(np.pi * (time - 14.0)), 0.0) * bell(time, 13.5, 5.0)
    bump = 2.0 * (bell(time, 21.0, 0.3) - bell(time, 21.3, 0.6) * 0.5)
    return np.column_stack([forward, lane, bump])


def vehicle_motion(table):
    """Time (n,), accelerations (n, 3) and rates (n, 3) at RATE_Hz: of a table, or of the manoeuvre."""
    if table is None:
        time = np.arange(0.0, 25.0, 1.0 / RATE_Hz)
        return time, manoeuvre(time), np.zeros((len(time), 3))
    rows = pl.read_csv(table)
    time = np.arange(0.0, rows["time_s"].max(), 1.0 / RATE_Hz)
    found = np.column_stack([np.interp(time, rows["time_s"], rows[name]) for name in NAMES])
    return time, found[:, :3], found[:, 3:]


def compare(log, kinematics, vehicle):
    """What the vehicle's driver, the commanded and the real platform feel: name -> (n, 3), gravity at rest taken off.

    In the 50 Hz band, as every acceleration of this project unless said otherwise.
    """
    column = lambda name: log[name].to_numpy()  # noqa: E731
    rest = np.array([0.0, 0.0, g])
    felt = {"vehicle": WASHOUT.scale * vehicle}
    for name, pose, accelerations in (
        ("commanded", "commanded", "commanded_acceleration_{}_m_s2"),
        ("felt", "platform", "true_acceleration_{}_m_s2"),
    ):
        units = ("m", "m", "m", "rad", "rad", "rad")
        platform_poses = np.column_stack(
            [column(f"{pose}_{k}_{u}") for k, u in zip(("x", "y", "z", "roll", "pitch", "yaw"), units, strict=True)]
        )
        acceleration = np.column_stack([column(accelerations.format(axis)) for axis in "xyz"])
        force = specific_force(kinematics.rotation(platform_poses), acceleration) - rest
        felt[name] = np.column_stack([band_limit(column("time_s"), values) for values in force.T])
    return felt


def figures(time, felt):
    """Per axis: felt against commanded: rms of both, of their difference, delay [ms], correlation."""
    table = {}
    for k, axis in enumerate("xyz"):
        commanded, got = felt["commanded"][:, k], felt["felt"][:, k]
        table[axis] = {
            "commanded_rms_m_s2": float(np.sqrt(np.mean(commanded**2))),
            "felt_rms_m_s2": float(np.sqrt(np.mean(got**2))),
            "difference_rms_m_s2": float(np.sqrt(np.mean((got - commanded) ** 2))),
            "peak_difference_m_s2": float(np.max(np.abs(got - commanded))),
            "delay_ms": 1e3 * response_delay_s(time, got, commanded),
            "correlation": float(np.corrcoef(commanded, got)[0, 1]),
        }
    return table


@styled
def picture(time, felt, table, what):
    figure, plots = new_figure(4, f"Specific force on the platform: {what}", heights=[1.7, 1.7, 1.7, 1.2])
    colours = (palette.RESPONSE, palette.DEVIATION, palette.REFERENCE)
    for plot, (k, description) in zip(plots[:3], enumerate(("forward", "left", "up")), strict=True):
        plot.plot(time, felt["felt"][:, k], color=palette.RESPONSE, lw=0.8, label="felt on the machine, 50 Hz band")
        plot.plot(time, felt["commanded"][:, k], color=palette.DEVIATION, lw=1.1, label="commanded by the washout")
        plot.plot(
            time,
            felt["vehicle"][:, k],
            color=palette.REFERENCE,
            lw=1.1,
            ls="--",
            label=f"vehicle, scaled by {WASHOUT.scale:g}",
        )
        row = table["xyz"[k]]
        late, off = round(row["delay_ms"]), row["difference_rms_m_s2"]
        plot.set_title(f"{description}: delay {late} ms, rms of felt less commanded {off:.3f} m/s²")
        plot.set_ylabel("[m/s²]")
        plots[3].plot(time, felt["felt"][:, k] - felt["commanded"][:, k], color=colours[k], lw=0.8, label=description)
    plots[3].set_title(
        "felt less commanded, in a scale of its own; between the dotted lines people do not feel it", pad=22
    )
    plots[3].set_ylabel("[m/s²]")
    for side in (-1.0, 1.0):
        plots[3].axhline(side * min(PERCEPTION_m_s2.values()), color=palette.REFERENCE, lw=1.0, ls=":")
    legend(plots[3], columns=3)
    plots[0].set_title(plots[0].get_title(), pad=22)
    legend(plots[0], columns=3)
    plots[-1].set_xlabel("time [s]")
    return png(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("cueing"))
    parser.add_argument("--machine", default="micro_motion_system")
    parser.add_argument("--vehicle", type=Path, default=None, help=f"table of a vehicle: time_s, {', '.join(NAMES)}")
    parser.add_argument("--compensator", default="none")
    parser.add_argument("--fast", action="store_true", help="tendon model instead of full legs")
    parser.add_argument("--host", default=None, help="a host that knows no future plays it: 60,jitter=0.2,loss=0.02")
    parser.add_argument("--tune", action="store_true", help="start with what the compensator learns on the twin")
    arguments = parser.parse_args()
    machine = hx.load_machine(arguments.machine)
    kinematics = machine_kinematics(machine)
    time, vehicle, rates = vehicle_motion(arguments.vehicle)
    pose = poses(WASHOUT, vehicle, rates)
    kinematics.check_trajectory(time, pose, margin_m=machine.cylinder.cushion_length_m)
    arguments.out.mkdir(parents=True, exist_ok=True)
    names = ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
    setpoints = arguments.out / "setpoints.csv"
    pl.DataFrame({"time_s": time, **{name: pose[:, k] for k, name in enumerate(names)}}).write_csv(setpoints)
    compensator = arguments.compensator
    if arguments.tune:
        teach(machine, arguments.out, compensator)
        compensator = str(arguments.out / FILE)
    host = Host.parse(arguments.host) if arguments.host else None
    run = hx.run(setpoints, machine, compensator, fast=arguments.fast, host=host)
    log = run.log.head(run.log.height - 100)  # the setpoints end there
    moments = log["time_s"].to_numpy()
    felt = compare(log, kinematics, np.column_stack([np.interp(moments, time, a) for a in vehicle.T]))
    table = figures(moments, felt)
    (arguments.out / "cueing.json").write_text(json.dumps(table, indent=1), encoding="utf-8")
    what = "plain control" if run.compensator == "none" else f"compensator {run.compensator}"
    if host:
        what += f", {host.rate_Hz:g} packets a second, {100 * host.loss:g} % lost"
    (arguments.out / "cueing.png").write_bytes(picture(moments, felt, table, what))
    columns = {f"{name}_{axis}_m_s2": values[:, k] for name, values in felt.items() for k, axis in enumerate("xyz")}
    pl.DataFrame({"time_s": moments, **columns}).write_csv(arguments.out / "felt.csv")
    for axis, row in table.items():
        print(f"{axis}: " + ", ".join(f"{key} {value:.3g}" for key, value in row.items()))


if __name__ == "__main__":
    main()
