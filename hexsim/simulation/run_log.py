"""The log of a run: the columns of a measured log, then the truth behind them; and the run's figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from hexsim.mechanics.points import point_acceleration, point_velocity
from hexsim.plant import Plant
from hexsim.plant.readout import imu_motion, leg_motion, leg_signals, platform_signals, power_unit_signals
from hexsim.scenarios import Scenario
from hexsim.scenarios.bench_motion import bench_motion
from hexsim.sensors.bank import SensorBank
from hexsim.signals.table import motion_column, places, point_signal, table
from hexsim.smoothness import AxisMotion, BANDWIDTH_Hz, summary_axes
from hexsim.smoothness.threshold import times_threshold

Array = NDArray[np.float64]
MEANS = ("true_acceleration", "true_angular_acceleration")  # over a sample of the log


@dataclass(kw_only=True)
class RecordedMotion:
    """Raw motion of the bodies and what was asked of them, (m, ...) at every tick."""

    time: Array
    setpoints: Array
    qpos: Array
    qvel: Array
    mean_acceleration: Array  # over one tick: what the figures judge


@dataclass(kw_only=True)
class Recorded(RecordedMotion):
    """Raw states of a run at every tick (m, ...). every: ticks from a row of the log to the next."""

    positions: Array
    qacc: Array  # of the instant: what the accelerometer samples
    act: Array
    timestep: Array  # mean of the tick [s]
    volts: Array
    spool_volts: Array
    compensation: Array
    every: int = 1


def run_log(plant: Plant, scenario: Scenario, recorded: Recorded, sensors: SensorBank) -> pl.DataFrame:
    """All columns; names of measured ones as in the shared log format, truth under its own names.

    Everything is evaluated at every tick, transducers with their filters, too. The log takes every `recorded.every`-th
    row; true accelerations are means over one of its samples about the instant, so that nothing aliases into the band.
    """
    states = (recorded.time, recorded.qpos, recorded.qvel, recorded.act, recorded.spool_volts)
    legs = leg_signals(plant, *states)
    measured = {
        "setpoint": recorded.setpoints,
        "position": sensors.rows("position", recorded.positions),
        "valve": recorded.volts,
        "pressure_bottom": sensors.rows("pressure_bottom", legs.pressure_bottom),
        "pressure_supply": sensors.rows("pressure_supply", legs.supply_Pa[:, None]),
    }
    instant = platform_signals(plant, recorded.qpos, recorded.qvel, recorded.qacc)
    felt, turning = imu_motion(plant.resolved, instant, recorded.qvel[:, 3:6])
    measured["acceleration"] = sensors.rows("acceleration", felt)
    measured["angular_acceleration"] = sensors.rows("angular_acceleration", turning)
    pose, motion = _motion(plant, scenario, recorded)
    poses = {"platform": instant.pose, "commanded": pose}
    # a transducer sits on a rod side that is a chamber of the valve; on the supply it needs none
    rod_side = "true_pressure_top" if plant.machine.cylinder.rod_side == "valve" else "pressure_top"
    truth = {
        "true_position": legs.position,
        "velocity": legs.velocity,
        "true_pressure_bottom": legs.pressure_bottom,
        rod_side: legs.pressure_top,
        "spool": legs.spool,
        "flow": legs.flow,
        "friction": legs.friction,
        "leg_force": legs.force,
        "compensation": recorded.compensation,
        "true_pressure_supply": legs.supply_Pa[:, None],
    }
    truth |= {
        places()[name][0].stem: values[:, None]
        for name, values in power_unit_signals(plant, *states, recorded.timestep).items()
    }
    extra = sensors.extra(motion | truth)
    motion |= {stem: mean_of_sample(motion[stem], recorded.every) for stem in MEANS}
    named = _columns(measured | poses, plant.n_legs)
    named += sorted(_columns(motion, plant.n_legs), key=lambda column: column[0])  # x of all, then y, then z
    named += _columns(truth | extra, plant.n_legs)
    named += _point_columns(plant, motion, instant.omega(plant.kinematics))
    rows = slice(None, None, recorded.every)
    return pl.DataFrame({"time_s": recorded.time[rows]} | {name: values[rows].copy() for _, name, values in named})


def mean_of_sample(values: Array, ticks: int) -> Array:
    """Means (m, n) over `ticks` ticks about each instant, of means over one tick: half of the outer ones if even."""
    if ticks == 1:
        return values
    weights = np.ones(ticks + 1 - ticks % 2)
    weights[[0, -1]] *= 1.0 if ticks % 2 else 0.5
    return scipy.ndimage.convolve1d(values, weights / ticks, axis=0, mode="nearest") if values.size else values


def _point_columns(plant: Plant, motion: dict[str, Array], omega: Array) -> list[tuple[int, str, Array]]:
    """The true acceleration of each declared point of the platform."""
    named = []
    for point, place in plant.machine.points.items():
        felt = point_acceleration(motion["true_acceleration"], motion["true_angular_acceleration"], omega, place)
        named += [(k, name, felt[:, k]) for k, name in enumerate(point_signal(point).columns(plant.n_legs))]
    return named


def _columns(signals: dict[str, Array], n_legs: int) -> list[tuple[int, str, Array]]:
    """(place, name, values (m,)) of each column of signals (m, n_places)."""
    return [
        (place, name, values[:, place])
        for stem, values in signals.items()
        for place, name in enumerate(table()[stem].columns(n_legs))
    ]


def motion_log(plant: Plant, scenario: Scenario, recorded: RecordedMotion) -> pl.DataFrame:
    """The columns of a log that the figures of motion are made of: true and commanded motion, at every tick."""
    motion = _motion(plant, scenario, recorded)[1]
    named = _columns(motion, plant.n_legs)
    if plant.machine.points:
        instant = platform_signals(plant, recorded.qpos, recorded.qvel, recorded.mean_acceleration)
        named += _point_columns(plant, motion, instant.omega(plant.kinematics))
    return pl.DataFrame({"time_s": recorded.time} | {name: values.copy() for _, name, values in named})


def _motion(plant: Plant, scenario: Scenario, recorded: RecordedMotion) -> tuple[Array, dict[str, Array]]:
    """Commanded pose (m, 6); true and commanded motion by signal, (m, 3) each; along a bench's leg (m, 1), about it (m, 0)."""
    mean = platform_signals(plant, recorded.qpos, recorded.qvel, recorded.mean_acceleration)
    pose, velocity, acceleration = _commanded(plant, scenario, recorded)
    return pose, {
        "true_acceleration": mean.acceleration,
        "true_angular_acceleration": mean.angular_acceleration,
        "commanded_velocity": velocity[:, :3],
        "commanded_angular_velocity": velocity[:, 3:],
        "commanded_acceleration": acceleration[:, :3],
        "commanded_angular_acceleration": acceleration[:, 3:],
    }


def _commanded(plant: Plant, scenario: Scenario, recorded: RecordedMotion) -> tuple[Array, Array, Array]:
    """Commanded pose, twist and its rate (m, 6), the latter two in the commanded platform's frame; along a leg (m, 1)."""
    kinematics = plant.machine.mechanics
    if not kinematics.has_platform:
        _, velocity, acceleration = bench_motion(scenario, recorded.time)
        return kinematics.forward(recorded.setpoints), velocity[:, None], acceleration[:, None]
    if scenario.mode == "dof":
        pose, rate, acceleration = scenario.evaluate(recorded.time)
    else:
        pose = kinematics.forward(recorded.setpoints)
        step = recorded.time[1] - recorded.time[0] if len(recorded.time) > 1 else 1.0
        rate = np.gradient(pose, step, axis=0) if len(pose) > 1 else np.zeros_like(pose)
        acceleration = np.gradient(rate, step, axis=0) if len(pose) > 1 else np.zeros_like(pose)
    twist = kinematics.to_platform_frame(pose, kinematics.twist(pose, rate))
    return pose, twist, kinematics.to_platform_frame(pose, kinematics.twist_rate(pose, rate, acceleration))


def figures_log(plant: Plant, recorded: Recorded) -> pl.DataFrame:
    """What of a log the figures need that `motion_log` has not: setpoints and true positions of the legs."""
    legs = {"setpoint": recorded.setpoints, "true_position": leg_motion(plant, recorded.qpos, recorded.qvel)[0]}
    rows = slice(None, None, recorded.every)
    named = _columns(legs, plant.n_legs)
    return pl.DataFrame({"time_s": recorded.time[rows]} | {name: values[rows].copy() for _, name, values in named})


def run_summary(
    plant: Plant,
    scenario: Scenario,
    compensator: str,
    log: pl.DataFrame,
    recorded: Recorded,
    realtime: float,
    warnings: list[str],
) -> dict[str, Any]:
    """The figures of a run, as in summary.json. Judged on the true acceleration at every tick, not on the noisy sensor,
    whatever the rate of the log."""
    whole = recorded.every == 1 and motion_column("true_acceleration", plant.kinematics.axes[0]) in log.columns
    motion = log if whole else motion_log(plant, scenario, recorded)
    setpoints, positions = (table()[stem].columns(plant.n_legs) for stem in ("setpoint", "true_position"))
    errors = [log[setpoint] - log[position] for setpoint, position in zip(setpoints, positions, strict=True)]
    start = figures_start(scenario, recorded.time)
    late = log["time_s"].to_numpy() >= start
    return {
        "scenario": scenario.name,
        "machine": plant.machine.name,
        "compensator": compensator,
        "duration_s": float(len(recorded.time) * (recorded.time[1] - recorded.time[0]))
        if len(recorded.time) > 1
        else 0.0,
        "bandwidth_Hz": BANDWIDTH_Hz,
        "figures_from_s": start,
        "axes": _axes(plant, scenario, motion, start),
        **({"points": _points(plant, scenario, motion, start)} if plant.machine.points else {}),
        "tracking_rms_m": [float(np.sqrt(np.mean(error.to_numpy()[late] ** 2))) for error in errors if late.any()],
        "realtime_factor": realtime,
        "timestep_mean_s": float(1.0 / np.mean(1.0 / recorded.timestep)),
        "timestep_shortest_s": float(recorded.timestep.min()),
        "warnings": list(warnings),
    }


def axis_motions(log: pl.DataFrame, scenario: Scenario, axes: tuple[str, ...]) -> dict[str, AxisMotion]:
    """Response and command of each axis; what is alone is always driven."""
    motions: dict[str, AxisMotion] = {}
    for axis in axes:
        signal = scenario.signals.get(axis) if len(axes) > 1 else next(iter(scenario.signals.values()), None)
        driven = len(axes) == 1 or signal is not None or (scenario.mode == "actuator" and bool(scenario.signals))
        motions[axis] = AxisMotion(
            acceleration=log[motion_column("true_acceleration", axis)].to_numpy(),
            commanded_velocity=log[motion_column("commanded_velocity", axis)].to_numpy() if driven else None,
            commanded_acceleration=log[motion_column("commanded_acceleration", axis)].to_numpy() if driven else None,
            frequency_Hz=signal.fundamental_Hz if signal else None,
        )
    return motions


def figures_start(scenario: Scenario, time: Array) -> float:
    """Where the figures begin; in the middle of a run that ended before that."""
    end = float(time[-1]) if len(time) else 0.0
    return scenario.figures_start_s if scenario.figures_start_s < 0.9 * end else 0.5 * end


def _axes(plant: Plant, scenario: Scenario, log: pl.DataFrame, start_s: float) -> dict[str, Any]:
    if log.height < 100:
        return {}
    motions = axis_motions(log, scenario, plant.kinematics.axes)
    return summary_axes(log["time_s"].to_numpy(), motions, start_s=start_s)


def _points(plant: Plant, scenario: Scenario, log: pl.DataFrame, start_s: float) -> dict[str, Any]:
    """Point -> axis -> figures as in `axes`, against the command at that point; peak_over_threshold: of the deviation in
    the band over the threshold of perception of a motion along that axis."""
    if log.height < 100:
        return {}
    time, n, found = log["time_s"].to_numpy(), plant.n_legs, {}
    velocity, omega, acceleration, turning = (
        log.select(table()[f"commanded_{what}"].columns(n)).to_numpy()
        for what in ("velocity", "angular_velocity", "acceleration", "angular_acceleration")
    )
    driven = bool(scenario.signals)
    for point, place in plant.machine.points.items():
        asked = point_acceleration(acceleration, turning, omega, place)
        moved = point_velocity(velocity, omega, place)
        motions = {
            axis: AxisMotion(
                acceleration=log[name].to_numpy(),
                commanded_velocity=moved[:, k] if driven else None,
                commanded_acceleration=asked[:, k] if driven else None,
            )
            for k, (axis, name) in enumerate(zip("xyz", point_signal(point).columns(n), strict=True))
        }
        found[point] = summary_axes(time, motions, start_s=start_s)
        for axis, figures in found[point].items():
            figures["peak_over_threshold"] = times_threshold(axis, figures["peak_band_m_s2"] or 0.0)
    return found
