"""The log of a run: the columns of a measured log, then the truth behind them; and the run's figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.plant import Plant
from hexsim.plant.readout import LegSignals, PlatformSignals, leg_signals, platform_signals, power_unit_signals
from hexsim.scenarios import Scenario
from hexsim.scenarios.bench_motion import bench_motion
from hexsim.scenarios.scenario import DOF_NAMES
from hexsim.sensors.bank import SensorBank
from hexsim.smoothness import AxisMotion, BANDWIDTH_Hz, summary_axes

Array = NDArray[np.float64]
UNITS = ("m", "m", "m", "rad", "rad", "rad")


@dataclass(kw_only=True)
class Recorded:
    """Raw states of a run. time, ticks (m,) and most others at the log rate; positions and act at the tick rate."""

    time: Array
    ticks: NDArray[np.int64]
    setpoints: Array
    positions: Array
    qpos: Array
    qvel: Array
    qacc: Array  # of the instant: what the accelerometer samples
    mean_acceleration: Array  # over one tick: what the figures judge
    act: Array
    timestep: Array  # mean of the tick [s]
    volts: Array
    spool_volts: Array
    compensation: Array


def run_log(plant: Plant, scenario: Scenario, recorded: Recorded, sensors: SensorBank) -> pl.DataFrame:
    """All columns; names of measured ones as in the shared log format, truth under its own names."""
    rows = recorded.ticks
    states = (recorded.time, recorded.qpos, recorded.qvel, recorded.act[rows], recorded.spool_volts)
    legs = leg_signals(plant, *states)
    every_pressure = recorded.act[:, plant.pressure_places] * 1e6
    supply = np.full(len(recorded.act), np.nan)
    supply[rows] = legs.supply_Pa
    measured = {
        "setpoint_m": recorded.setpoints,
        "position_m": sensors.positions(recorded.positions)[rows],
        "valve_V": recorded.volts,
        "pressure_bottom_Pa": sensors.pressures(every_pressure)[rows],
    }
    columns: dict[str, Array] = {"time_s": recorded.time}
    columns |= _per_leg(measured, plant.n_legs)
    columns["pressure_supply_Pa"] = sensors.supplies(supply)[rows]
    if plant.kinematics is None:
        _bench_columns(columns, scenario, recorded, sensors)
    else:
        _hexapod_columns(columns, plant, scenario, recorded, sensors)
    columns |= _per_leg(_truth(legs, recorded), plant.n_legs)
    columns["true_pressure_supply_Pa"] = legs.supply_Pa
    columns |= power_unit_signals(plant, *states, recorded.timestep)
    return pl.DataFrame(columns)


def _truth(legs: LegSignals, recorded: Recorded) -> dict[str, Array]:
    return {
        "true_position_m": legs.position,
        "velocity_m_s": legs.velocity,
        "true_pressure_bottom_Pa": legs.pressure_bottom,
        "pressure_top_Pa": legs.pressure_top,
        "spool_m": legs.spool,
        "flow_m3_s": legs.flow,
        "friction_N": legs.friction,
        "leg_force_N": legs.force,
        "compensation_V": recorded.compensation,
    }


def leg_column(name: str, leg: int, n_legs: int) -> str:
    """Column of leg 1..n: the number stands before the unit on a hexapod and nowhere on a bench."""
    units = ("_m3_s", "_m_s2", "_m_s", "_Pa", "_m", "_V", "_N")
    unit = next(unit for unit in units if name.endswith(unit))
    return name if n_legs == 1 else f"{name.removesuffix(unit)}_{leg}{unit}"


def _per_leg(groups: dict[str, Array], n_legs: int) -> dict[str, Array]:
    return {
        leg_column(name, i + 1, n_legs): np.ascontiguousarray(values[:, i])
        for name, values in groups.items()
        for i in range(n_legs)
    }


def _bench_columns(columns: dict[str, Array], scenario: Scenario, recorded: Recorded, sensors: SensorBank) -> None:
    _, velocity, acceleration = bench_motion(scenario, recorded.time)
    columns["acceleration_m_s2"] = _thinned(sensors, recorded.qacc[:, :1], recorded)[:, 0]
    columns["true_acceleration_m_s2"] = recorded.mean_acceleration[:, 0]
    columns["commanded_velocity_m_s"] = velocity
    columns["commanded_acceleration_m_s2"] = acceleration


def _thinned(sensors: SensorBank, true: Array, recorded: Recorded) -> Array:
    """Measured accelerations at the log's rows (noise of those ticks; delay counted in log samples)."""
    if len(true) == len(recorded.positions):
        return sensors.accelerations(true)
    return sensors.accelerations(np.repeat(true, recorded.ticks[1], axis=0)[: len(recorded.positions)])[recorded.ticks]


def _hexapod_columns(
    columns: dict[str, Array], plant: Plant, scenario: Scenario, recorded: Recorded, sensors: SensorBank
) -> None:
    platform: PlatformSignals = platform_signals(plant, recorded.qpos, recorded.qvel, recorded.qacc)
    smooth = platform_signals(plant, recorded.qpos, recorded.qvel, recorded.mean_acceleration)
    measured = _thinned(sensors, platform.acceleration, recorded)
    angular = sensors.angular_accelerations(platform.angular_acceleration)
    for k, axis in enumerate("xyz"):
        columns[f"acceleration_{axis}_m_s2"] = measured[:, k]
    for k, axis in enumerate("xyz"):
        columns[f"angular_acceleration_{axis}_rad_s2"] = angular[:, k]
    for k, (name, unit) in enumerate(zip(DOF_NAMES, UNITS, strict=True)):
        columns[f"platform_{name}_{unit}"] = platform.pose[:, k]
    pose, velocity, acceleration = _commanded(plant, scenario, recorded)
    for k, (name, unit) in enumerate(zip(DOF_NAMES, UNITS, strict=True)):
        columns[f"commanded_{name}_{unit}"] = pose[:, k]
    for k, axis in enumerate("xyz"):
        columns[f"true_acceleration_{axis}_m_s2"] = smooth.acceleration[:, k]
        columns[f"true_angular_acceleration_{axis}_rad_s2"] = smooth.angular_acceleration[:, k]
        columns[f"commanded_velocity_{axis}_m_s"] = velocity[:, k]
        columns[f"commanded_angular_velocity_{axis}_rad_s"] = velocity[:, 3 + k]
        columns[f"commanded_acceleration_{axis}_m_s2"] = acceleration[:, k]
        columns[f"commanded_angular_acceleration_{axis}_rad_s2"] = acceleration[:, 3 + k]


def _commanded(plant: Plant, scenario: Scenario, recorded: Recorded) -> tuple[Array, Array, Array]:
    """Commanded pose, twist and its rate (m, 6), the latter two in the commanded platform's frame."""
    kinematics = plant.kinematics
    assert kinematics is not None
    if scenario.mode == "dof":
        pose, rate, acceleration = scenario.evaluate(recorded.time)
    else:
        pose = kinematics.forward(recorded.setpoints)
        step = recorded.time[1] - recorded.time[0] if len(recorded.time) > 1 else 1.0
        rate = np.gradient(pose, step, axis=0) if len(pose) > 1 else np.zeros_like(pose)
        acceleration = np.gradient(rate, step, axis=0) if len(pose) > 1 else np.zeros_like(pose)
    twist = kinematics.to_platform_frame(pose, kinematics.twist(pose, rate))
    return pose, twist, kinematics.to_platform_frame(pose, kinematics.twist_rate(pose, rate, acceleration))


def run_summary(
    plant: Plant, scenario: Scenario, compensator: str, log: pl.DataFrame, recorded: Recorded, realtime: float,
    warnings: list[str],
) -> dict[str, Any]:  # fmt: skip
    """The figures of a run, as in summary.json. Judged on the true acceleration, not on the noisy sensor."""
    n = plant.n_legs
    errors = [log[leg_column("setpoint_m", i + 1, n)] - log[leg_column("true_position_m", i + 1, n)] for i in range(n)]
    start = figures_start(scenario, recorded.time)
    late = recorded.time >= start
    return {
        "scenario": scenario.name,
        "machine": plant.machine.name,
        "compensator": compensator,
        "duration_s": float(len(recorded.time) * (recorded.time[1] - recorded.time[0]))
        if len(recorded.time) > 1
        else 0.0,
        "bandwidth_Hz": BANDWIDTH_Hz,
        "figures_from_s": start,
        "axes": _axes(plant, scenario, log, start),
        "tracking_rms_m": [float(np.sqrt(np.mean(error.to_numpy()[late] ** 2))) for error in errors if late.any()],
        "realtime_factor": realtime,
        "timestep_mean_s": float(1.0 / np.mean(1.0 / recorded.timestep)),
        "timestep_shortest_s": float(recorded.timestep.min()),
        "warnings": list(warnings),
    }


def axis_motions(log: pl.DataFrame, scenario: Scenario, is_hexapod: bool) -> dict[str, AxisMotion]:
    """What each axis does and was asked to do."""
    if not is_hexapod:
        signal = next(iter(scenario.signals.values()), None)
        return {
            "leg": AxisMotion(
                acceleration=log["true_acceleration_m_s2"].to_numpy(),
                commanded_velocity=log["commanded_velocity_m_s"].to_numpy(),
                commanded_acceleration=log["commanded_acceleration_m_s2"].to_numpy(),
                frequency_Hz=signal.fundamental_Hz if signal else None,
            )
        }
    motions: dict[str, AxisMotion] = {}
    for k, name in enumerate(DOF_NAMES):
        axis = "xyz"[k % 3]
        kind, unit = ("angular_", "rad_s") if k >= 3 else ("", "m_s")
        driven = name in scenario.signals or (scenario.mode == "actuator" and bool(scenario.signals))
        signal = scenario.signals.get(name)
        motions[name] = AxisMotion(
            acceleration=log[f"true_{kind}acceleration_{axis}_{unit}2"].to_numpy(),
            commanded_velocity=log[f"commanded_{kind}velocity_{axis}_{unit}"].to_numpy() if driven else None,
            commanded_acceleration=log[f"commanded_{kind}acceleration_{axis}_{unit}2"].to_numpy() if driven else None,
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
    motions = axis_motions(log, scenario, plant.machine.is_hexapod)
    return summary_axes(log["time_s"].to_numpy(), motions, start_s=start_s)
