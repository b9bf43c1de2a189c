"""A made-up run for tests of what is recorded: kinematics and a bump drawn by hand, no simulation."""

from types import SimpleNamespace

import numpy as np
import polars as pl

from hexsim import Machine, load_scenario
from hexsim.machine import geometry, machine_from_dict
from hexsim.signals.log import Log

RATE_Hz = 1000.0
FREQUENCY_Hz = 0.5
BUMP_M_S2 = 0.5

TABLES = {
    "supply": {"pressure_Pa": 7.0e6},
    "oil": {"density_kg_m3": 860.0, "bulk_modulus_Pa": 1.5e9},
    "cylinder": {"piston_diameter_m": 0.04, "rod_diameter_m": 0.03, "stroke_m": 0.2, "pipeline_volume_m3": 5.0e-7},
    "valve": {
        "voltage_max_V": 10.0,
        "spool_travel_max_m": 1.1e-3,
        "spool_diameter_m": 0.01,
        "overlap_m": 5.0e-6,
        "discharge_coefficient": 0.611,
    },
    "friction": {
        "viscous_extend_N_s_m": 2200.0,
        "viscous_retract_N_s_m": 1800.0,
        "coulomb_extend_N": 65.0,
        "coulomb_retract_N": 60.0,
        "static_extend_N": 30.0,
        "static_retract_N": 30.0,
        "stribeck_velocity_m_s": 0.005,
    },
    "controller": {"gain_V_per_m": 50.0},
}
HEXAPOD = {
    "machine": {"name": "made_up_hexapod", "kind": "hexapod", "gravity_m_s2": 9.81},
    "load": {"platform_mass_kg": 600.0, "platform_inertia_kg_m2": [60.0, 60.0, 100.0]},
    "geometry": {
        "base_radius_m": 0.6,
        "base_half_angle_deg": 7.66,
        "platform_radius_m": 0.5,
        "platform_half_angle_deg": 9.21,
        "neutral_leg_length_m": 0.7,
    },
}
BENCH = {
    "machine": {"name": "made_up_bench", "kind": "bench", "gravity_m_s2": 9.81},
    "load": {"moving_mass_kg": 40.0},
}
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def made_up_machine(hexapod: bool = True) -> Machine:
    return machine_from_dict({**TABLES, **(HEXAPOD if hexapod else BENCH)})


def bump(time_s: np.ndarray) -> np.ndarray:
    """A 30 Hz wave packet of BUMP_M_S2 at each reversal of sin(2 pi f t), alternately up and down."""
    total = np.zeros_like(time_s)
    for k in range(int(time_s[-1] * 2 * FREQUENCY_Hz) + 1):
        t = time_s - (k + 0.5) / (2 * FREQUENCY_Hz)
        total += (-1) ** k * BUMP_M_S2 * np.exp(-((t / 0.03) ** 2)) * np.cos(2 * np.pi * 30.0 * t)
    return total


def made_up_log(machine: Machine, duration_s: float = 6.0, bump_scale: float = 1.0) -> pl.DataFrame:
    """Heave (or the leg) follows 0.05 m at 0.5 Hz, 20 ms late; valve, pressure and flow look like a cylinder's."""
    t = np.arange(round(duration_s * RATE_Hz)) / RATE_Hz
    w = 2 * np.pi * FREQUENCY_Hz
    asked, got = 0.05 * np.sin(w * t), 0.0495 * np.sin(w * (t - 0.02))
    acceleration = -w * w * got + bump_scale * bump(t)
    columns: dict[str, np.ndarray] = {"time_s": t}
    zero = np.zeros((len(t), 6))
    if machine.is_hexapod:
        commanded, pose = zero.copy(), zero.copy()
        commanded[:, 2], pose[:, 2] = asked, got
        kinematics = geometry.machine_kinematics(machine)
        setpoints, positions = kinematics.inverse(commanded), kinematics.inverse(pose)
    else:
        commanded, pose = asked[:, None], got[:, None]
        setpoints, positions = 0.1 + commanded, 0.1 + pose
    for i in range(machine.n_legs):
        tag = f"_{i + 1}_" if machine.is_hexapod else "_"
        velocity = np.gradient(positions[:, i], t)
        columns |= {
            f"setpoint{tag}m": setpoints[:, i],
            f"position{tag}m": positions[:, i],
            f"valve{tag}V": 50.0 * (setpoints[:, i] - positions[:, i]),
            f"pressure_bottom{tag}Pa": 4.0e6 + 2.0e5 * np.sign(velocity),
            f"true_position{tag}m": positions[:, i],
            f"flow{tag}m3_s": 1.26e-3 * velocity,
        }
    columns["pressure_supply_Pa"] = np.full_like(t, 7.0e6)
    if not machine.is_hexapod:
        columns |= {
            "acceleration_m_s2": acceleration,
            "true_acceleration_m_s2": acceleration,
            "commanded_acceleration_m_s2": -w * w * asked,
        }
        return pl.DataFrame(columns)
    for k, axis in enumerate(AXES):
        unit, name = (
            ("m", f"acceleration_{axis}_m_s2") if k < 3 else ("rad", f"angular_acceleration_{'xyz'[k - 3]}_rad_s2")
        )
        a = acceleration if axis == "z" else 1e-3 * bump(t)
        columns |= {
            f"platform_{axis}_{unit}": pose[:, k],
            f"commanded_{axis}_{unit}": commanded[:, k],
            name: a,
            f"true_{name}": a,
            f"commanded_{name}": -w * w * commanded[:, k],
        }
    return pl.DataFrame(columns)


def log_of(table: pl.DataFrame, machine: Machine) -> Log:
    return Log.of_table("run", table, machine.machine.kind)


def _scaled(figures: dict, axis: str) -> dict:
    """A parasitic axis has a thousandth of the driven one."""
    unit = "rad_s2" if axis in AXES[3:] else "m_s2"
    return {key.replace("m_s2", unit): value * (1.0 if axis == "z" else 1e-3) for key, value in figures.items()}


def made_up_run(hexapod: bool = True, duration_s: float = 6.0, complete: bool = True, **changes) -> SimpleNamespace:
    """Looks like hexsim.simulation.Run to whatever records it."""
    machine = made_up_machine(hexapod)
    axis = "z" if hexapod else "leg"
    figures = {
        "fundamental_m_s2": 0.49,
        "peak_raw_m_s2": 0.6,
        "peak_band_m_s2": 0.5,
        "noise_rms_m_s2": 0.05,
        "ratio_n": 0.14,
        "ratio_lf": 0.01,
        "ratio_hf": 0.1,
        "bump_pp_m_s2": 0.9,
    }
    axes = {axis: figures}
    if hexapod:
        axes = {name: _scaled(figures, name) for name in AXES}
    scenario = load_scenario("heave", duration_s=duration_s)
    summary = {
        "scenario": "heave",
        "machine": machine.name,
        "compensator": "none",
        "duration_s": duration_s,
        "bandwidth_Hz": 50.0,
        "axes": axes,
        "tracking_rms_m": [1.0e-3] * machine.n_legs,
        "realtime_factor": 5.0,
        "warnings": [],
    }
    run = SimpleNamespace(
        log=made_up_log(machine, duration_s),
        machine=machine,
        scenario=scenario,
        compensator="none",
        seed=0,
        model="full",
        timestep=None,
        summary=summary,
        warnings=[],
        messages=[(1.0, 1, "a message")],
        complete=complete,
        interrupted=not complete,
        reason="" if complete else "interrupted at 3.0 s",
        realtime_factor=5.0,
        compensator_parameters=[{}] * machine.n_legs,
    )
    for name, value in changes.items():
        setattr(run, name, value)
    return run
