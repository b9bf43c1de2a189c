"""Machine folders written by a second, independent plant: what the tracer is tested on. Shares no code with hexsim.

    write_machine(folder, seed=3, effects={"leakage_supply_to_chamber": None}, kind="bench")

writes machine.toml (declared), logs in the format of the measured ones (noise, quantisation, parameter error drawn
inside [uncertainty]) and truth.json. An effect's value None = its typical strength; `leg` (1-based) puts leg effects
in that leg only, a name with "@3" that one in leg 3.
"""

import gzip
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from other_effects import BUILT_OTHERWISE, EFFECTS, SMALL_REALITIES
from other_equations import LEG_TYPE, PER_LEG, RIG_TYPE, integrate, leg_lengths, rotation

BENCH_RUNS = ("fit", "sweep", "validate")
HEXAPOD_RUNS = ("fit", "validate_heave", "validate_roll")
KNOWN = EFFECTS | SMALL_REALITIES | BUILT_OTHERWISE
SUBSTEPS = {"bench": 20, "hexapod": 20}  # RK4 steps a millisecond; convergence is tested
UNCERTAINTY = {
    "discharge_coefficient": 0.04,
    "bulk_modulus_Pa": 0.10,
    "moving_mass_kg": 0.02,
    "viscous_extend_N_s_m": 0.12,
    "viscous_retract_N_s_m": 0.12,
    "coulomb_extend_N": 0.12,
    "coulomb_retract_N": 0.12,
    "static_extend_N": 0.15,
    "static_retract_N": 0.15,
    "supply_pressure_Pa": 0.01,
}
DECLARED_LEG = {
    "area1": np.pi / 4 * 0.04**2,
    "area2": np.pi / 4 * (0.04**2 - 0.03**2),
    "stroke": 0.2,
    "pipe_volume": 5e-7,
    "density": 860.0,
    "modulus": 1.5e9,
    "discharge": 0.611,
    "gradient_supply": np.pi * 0.01,
    "gradient_tank": np.pi * 0.01,
    "overlap_supply": 5e-6,
    "overlap_tank": 5e-6,
    "rounding": 2e-6,
    "spool_per_volt": 1.1e-4,
    "travel": 1.1e-3,
    "viscous_out": 2200.0,
    "viscous_in": 1800.0,
    "coulomb_out": 65.0,
    "coulomb_in": 60.0,
    "static_out": 30.0,
    "static_in": 30.0,
    "stribeck": 0.005,
    "sharpness": 2e-4,
    "position_gain": 1.0,
    "pressure_gain": 1.0,
    "scale_length": 1e-3,
    "warm_up_s": 10.0,
    "wear_width": 0.01,
    "viscosity": 56.9e-6,  # [m2/s] 46 mm2/s at 40 degC and 7.9 at 100, at 35 degC
}
UNCERTAIN_LEG = {
    "discharge": "discharge_coefficient",
    "modulus": "bulk_modulus_Pa",
    "viscous_out": "viscous_extend_N_s_m",
    "viscous_in": "viscous_retract_N_s_m",
    "coulomb_out": "coulomb_extend_N",
    "coulomb_in": "coulomb_retract_N",
    "static_out": "static_extend_N",
    "static_in": "static_retract_N",
}


@dataclass
class Plant:
    """The true machine: legs (n,) and rig (1,) records, joints of base and platform (6, 3) [m], neutral height [m]."""

    kind: str
    legs: np.ndarray
    rig: np.ndarray
    base: np.ndarray
    joints: np.ndarray
    height: float


def declared_plant(kind: str) -> Plant:
    """The machine as its file declares it."""
    n = 6 if kind == "hexapod" else 1
    legs, rig = np.zeros(n, LEG_TYPE), np.zeros(1, RIG_TYPE)
    for name, value in DECLARED_LEG.items():
        legs[name] = value
    base, joints = np.zeros((6, 3)), np.zeros((6, 3))
    for i in range(6):
        side, pair = (1 if i % 2 == 0 else -1), np.deg2rad(120.0 * (i // 2))
        low, high = pair + side * np.deg2rad(7.66), pair + side * np.deg2rad(60.0 - 9.21)
        base[i] = 0.6 * np.cos(low), 0.6 * np.sin(low), 0.0
        joints[i] = 0.5 * np.cos(high), 0.5 * np.sin(high), 0.0
    height = float(np.sqrt(0.7**2 - np.sum((joints[0] - base[0]) ** 2)))
    values = {
        "n_legs": n,
        "hexapod": n > 1,
        "supply_pressure": 7e6,
        "gas_exponent": 1.3,
        "acceleration_gain": 1.0,
        "supply_gain": 1.0,
        "neutral_length": 0.7,
        "gain_V_per_m": 50.0,
        "gravity": 9.81 if n > 1 else 9.8,
        "mass": 600.0 if n > 1 else 40.0,
        "inertia_x": 60.0,
        "inertia_y": 60.0,
        "inertia_z": 100.0,
    }
    for name, value in values.items():
        rig[name] = value
    return Plant(kind, legs, rig, base, joints, height)


def draw_parameter_error(plant: Plant, rng: np.random.Generator) -> None:
    """Uniform inside the declared half widths; the six legs of a hexapod are alike."""
    for field, key in UNCERTAIN_LEG.items():
        plant.legs[field] *= 1.0 + UNCERTAINTY[key] * rng.uniform(-1, 1)
    plant.rig["supply_pressure"] *= 1.0 + UNCERTAINTY["supply_pressure_Pa"] * rng.uniform(-1, 1)
    if plant.kind == "bench":
        plant.rig["mass"] *= 1.0 + UNCERTAINTY["moving_mass_kg"] * rng.uniform(-1, 1)


def multisine(t, frequencies, peak, rng):
    """Sines with amplitude ~ 1/f and random phases, `peak` at most."""
    wave = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / max(f, 0.3) for f in frequencies)
    return wave * peak / np.max(np.abs(wave))


def strokes(t, speeds, travel=0.07):
    """Out and back at each speed [m/s]: a triangular path about mid stroke, about 6 s a speed."""
    knots_t, knots_y = [0.0, 1.0], [0.0, 0.0]
    for speed in speeds:
        reach = min(travel, 1.5 * speed)
        for target in (reach, -reach, 0.0):
            knots_t.append(knots_t[-1] + abs(target - knots_y[-1]) / speed)
            knots_y.append(target)
    return np.interp(t, knots_t, knots_y)


SPEEDS = (0.001, 0.002, 0.003, 0.005, 0.008, 0.012, 0.02, 0.03, 0.05, 0.08, 0.11)


def bench_reference(run: str, t, rng) -> np.ndarray:
    """Setpoint about mid stroke [m]."""
    fade = np.minimum(t / 2.0, 1.0)
    if run.startswith("fit"):
        return fade * multisine(t, (0.17, 0.31, 0.43, 0.61, 0.73, 1.1, 1.9, 3.1), 0.055, rng)
    if run.startswith("sweep"):
        return 0.02 * np.sin(2 * np.pi * (0.2 * t + 0.06 * t**2))
    if run.startswith("constant"):
        return strokes(t, SPEEDS)
    if run.startswith("rest"):
        return np.zeros_like(t)
    return fade * 0.05 * np.sin(np.pi * t)


def hexapod_reference(run: str, t, rng) -> np.ndarray:
    """Setpoint of the platform, (n, 6): x y z [m], roll pitch yaw [rad]."""
    fade, dof = np.minimum(t / 2.0, 1.0), np.zeros((len(t), 6))
    if run.startswith("fit"):
        peaks = (0.025, 0.025, 0.03, 0.05, 0.05, 0.06)
        for axis, peak in enumerate(peaks):
            dof[:, axis] = fade * multisine(t, np.array([0.23, 0.41, 0.71, 1.3, 2.3]) * (1 + 0.03 * axis), peak, rng)
        return dof * 0.8
    axis, peak = (2, 0.05) if "heave" in run else (3, 0.07)
    dof[:, axis] = fade * peak * np.sin(np.pi * t)
    return dof


def leg_setpoints(plant: Plant, dof: np.ndarray) -> np.ndarray:
    """Inverse kinematics of the setpoint, (n, 6) [m]. Quaternion of roll, pitch, yaw about fixed axes x, y, z."""
    out, R, y = np.empty_like(dof), np.zeros((3, 3)), np.zeros(6)
    half = dof[:, 3:] / 2
    c, s = np.cos(half), np.sin(half)
    quat = np.stack(
        [
            c[:, 0] * c[:, 1] * c[:, 2] + s[:, 0] * s[:, 1] * s[:, 2],
            s[:, 0] * c[:, 1] * c[:, 2] - c[:, 0] * s[:, 1] * s[:, 2],
            c[:, 0] * s[:, 1] * c[:, 2] + s[:, 0] * c[:, 1] * s[:, 2],
            c[:, 0] * c[:, 1] * s[:, 2] - s[:, 0] * s[:, 1] * c[:, 2],
        ],
        axis=1,
    )
    for k in range(len(dof)):
        rotation(quat[k], R)
        leg_lengths(plant.rig[0], plant.legs, plant.base, plant.joints, dof[k, :3] + [0, 0, plant.height], R, y)
        out[k] = y
    return out


def state_at_rest(plant: Plant) -> np.ndarray:
    """Mid stroke, valves shut, pressures that carry the load."""
    n = len(plant.legs)
    rig, Ps = plant.rig[0], float(plant.rig["supply_pressure"][0])
    weight = (rig["mass"] + rig["payload_mass"]) * rig["gravity"]
    X = np.zeros(n * PER_LEG + (16 if n > 1 else 5))
    if n == 1:
        axial = np.array([weight * np.cos(rig["incline"])])
        X[9] = plant.legs["stroke"][0] / 2
    else:
        place = np.array([0, 0, plant.height])
        unit = place + plant.joints - plant.base
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        com = np.array([rig["com_x"], rig["com_y"], rig["com_z"]])
        load = np.concatenate([[0, 0, weight], np.cross(com, [0, 0, weight])])
        axial = np.linalg.solve(np.vstack([unit.T, np.cross(plant.joints, unit).T]), load)
        X[6 * PER_LEG + 5], X[6 * PER_LEG + 6] = plant.height, 1.0
    for i, leg in enumerate(plant.legs):
        X[i * PER_LEG] = (Ps * leg["area2"] + axial[i] - leg["force"]) / leg["area1"]
        X[i * PER_LEG + 4] = Ps
    X[n * PER_LEG] = Ps
    return X


def simulate(
    plant: Plant, run: str, seed: int, duration_s: float = 20.0, substeps: int | None = None
) -> dict[str, np.ndarray]:
    """Signals of one run without noise: (n, legs) each, supply (n,), acceleration (n, axes)."""
    rng = np.random.default_rng([seed, *run.encode()])
    t = np.arange(round(duration_s * 1000)) * 1e-3
    held = np.floor(t * 500 + 1e-6) / 500
    if plant.kind == "bench":
        setpoint = (bench_reference(run, held, rng) + 0.5 * plant.legs["stroke"][0])[:, None]
    else:
        setpoint = leg_setpoints(declared_plant(plant.kind), hexapod_reference(run, held, rng))
    late = rng.uniform(0, 1, len(t)) * plant.rig["jitter_s"][0] * (np.arange(len(t)) % 2 == 0)
    return driven(plant, setpoint, late, substeps)


def driven(
    plant: Plant, setpoint: np.ndarray, late: np.ndarray | None = None, substeps: int | None = None
) -> dict[str, np.ndarray]:
    """Signals without noise for setpoints (n, legs) [m], a row a millisecond. late: of each sample, by jitter [s]."""
    t = np.arange(len(setpoint)) * 1e-3
    y, u, P, Ps, a = integrate(
        plant.rig,
        plant.legs,
        plant.base,
        plant.joints,
        state_at_rest(plant),
        setpoint,
        np.zeros(len(t)) if late is None else late,
        substeps or SUBSTEPS[plant.kind],
    )
    return {"time": t, "setpoint": setpoint, "position": y, "valve": u, "pressure": P, "supply": Ps, "acceleration": a}


def delayed(values: np.ndarray, delay_ms: float) -> np.ndarray:
    """Later by so many samples; the first value holds."""
    place = np.arange(len(values))
    return values if delay_ms == 0 else np.interp(place - float(delay_ms), place, values)


def smoothed(values: np.ndarray, lag_ms: float, fine: int = 50) -> np.ndarray:
    """Behind an RC filter: its equation in implicit steps of 20 us, the signal straight between samples."""
    out, last = np.empty_like(values), values[0]
    for k in range(len(values)):
        for share in np.arange(1, fine + 1) / fine:
            there = values[max(k - 1, 0)] * (1 - share) + values[k] * share
            last = (last * lag_ms * fine + there) / (lag_ms * fine + 1)
        out[k] = last
    return out


def played(values: np.ndarray, half_width: float) -> np.ndarray:
    """Backlash of a transducer's joint."""
    out, last = np.empty_like(values), values[0]
    for k, value in enumerate(values):
        last = min(max(last, value - half_width), value + half_width)
        out[k] = last
    return out


def measured(plant: Plant, true: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of the log: sensor gains, offsets, delays, then noise and quantisation."""
    n, legs = len(true["time"]), plant.legs
    bench = plant.kind == "bench"
    columns = {"time_s": true["time"]}
    marks = ("",) if bench else tuple(f"_{i + 1}" for i in range(6))
    for i, mark in enumerate(marks):
        columns[f"setpoint{mark}_m"] = true["setpoint"][:, i].round(8)
    for i, (mark, leg) in enumerate(zip(marks, legs, strict=True)):
        y = (
            true["position"][:, i]
            if leg["position_play"] == 0
            else played(true["position"][:, i], leg["position_play"])
        )
        y = y + leg["scale_error"] * np.sin(2 * np.pi * y / leg["scale_length"])
        y = delayed(y * leg["position_gain"], leg["position_delay_ms"])
        y = (smoothed(y, leg["position_lag_ms"]) if leg["position_lag_ms"] else y) + 3e-6 * rng.standard_normal(n)
        columns[f"position{mark}_m"] = (np.round(y / 3e-6) * 3e-6 if bench else y).round(7)
    for i, mark in enumerate(marks):
        volts = true["valve"][:, i]
        columns[f"valve{mark}_V"] = (np.round(volts / 3e-4) * 3e-4 if bench else volts).round(5)
    for i, (mark, leg) in enumerate(zip(marks, legs, strict=True)):
        P = delayed(true["pressure"][:, i] * leg["pressure_gain"] + leg["pressure_offset"], leg["pressure_delay_ms"])
        P = smoothed(P, leg["pressure_lag_ms"]) if leg["pressure_lag_ms"] else P
        P = P + leg["hum"] * np.sin(2 * np.pi * leg["hum_frequency"] * true["time"])
        columns[f"pressure_bottom{mark}_Pa"] = (P + 4e3 * rng.standard_normal(n)).round(1)
    rig = plant.rig[0]
    columns["pressure_supply_Pa"] = (true["supply"] * rig["supply_gain"] + 4e3 * rng.standard_normal(n)).round(1)
    names = ["acceleration_m_s2"] if bench else [f"acceleration_{x}_m_s2" for x in "xyz"]
    names += [] if bench else [f"angular_acceleration_{x}_rad_s2" for x in "xyz"]
    felt = true["acceleration"]
    if rig["imu_turn_y"] != 0.0:  # its x axis points down by the turn about y
        c, s = np.cos(rig["imu_turn_y"]), np.sin(rig["imu_turn_y"])
        turned = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # columns: the IMU's axes in the platform
        felt = np.concatenate([felt[:, :3] @ turned, felt[:, 3:] @ turned], axis=1)
    for k, name in enumerate(names):
        noise = (0.02 if k < 3 else 0.03) * rng.standard_normal(n)
        gain, offset = (rig["acceleration_gain"], rig["acceleration_offset"]) if k < 3 else (1.0, 0.0)
        late = delayed(felt[:, k], rig["acceleration_delay_ms"])
        columns[name] = (gain * late + offset * (k in (0, 2)) * (bench or k == 2) + noise).round(5)
    return columns


def true_machine(
    kind: str, seed: int, effects: dict[str, float | None], leg: int | None = None
) -> tuple[Plant, dict[str, float]]:
    """The plant with its parameter error and effects; values used."""
    plant = declared_plant(kind)
    draw_parameter_error(plant, np.random.default_rng([seed, 1]))
    where = range(len(plant.legs)) if leg is None else [leg - 1]
    values = {}
    for key, value in effects.items():
        name, _, own = key.partition("@")
        effect = KNOWN[name]
        if name in EFFECTS and kind not in effect.kinds:
            raise ValueError(f"{name} is for {effect.kinds}, not for a {kind}")
        values[key] = effect.size(kind) if value is None else float(value)
        effect.change(plant, [int(own) - 1] if own else where, values[key])
    return plant, values


def write_machine(
    folder, seed, effects=None, kind="bench", leg=None, runs=None, duration_s=20.0, suffix=".csv.gz"
) -> Plant:
    """Write machine.toml, one log a run and truth.json; returns the true plant."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    plant, values = true_machine(kind, seed, effects or {}, leg)
    for run in runs or (BENCH_RUNS if kind == "bench" else HEXAPOD_RUNS):
        rng = np.random.default_rng([seed, 2, *run.encode()])
        log = pl.DataFrame(measured(plant, simulate(plant, run, seed, duration_s), rng))
        if suffix == ".parquet":
            log.write_parquet(folder / f"{run}.parquet")
        elif suffix == ".csv":
            log.write_csv(folder / f"{run}.csv")
        else:
            with gzip.open(folder / f"{run}.csv.gz", "wb", compresslevel=1) as file:
                file.write(log.write_csv().encode())
    (folder / "machine.toml").write_text(machine_text(folder.name, kind), encoding="utf-8")
    truth = {
        "undeclared": values,
        "where": {key: place_of(key, leg) for key in values},
        "balance": {key: KNOWN[key.partition("@")[0]].balance for key in values},
        "in_library": {key: KNOWN[key.partition("@")[0]].in_library for key in values},
        "description": [described(key, size) for key, size in values.items()] or ["nothing beyond parameter error"],
        "legs": [{name: float(row[name]) for name in LEG_TYPE.names} for row in plant.legs],
        "rig": {name: float(plant.rig[name][0]) for name in RIG_TYPE.names},
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return plant


def place_of(key: str, leg: int | None) -> str:
    """Where an effect acts, by its key and the leg of all."""
    name, _, own = key.partition("@")
    if KNOWN[name].place != "leg":
        return KNOWN[name].place
    return f"leg {own or leg}" if own or leg else "all legs"


def described(key: str, size: float) -> str:
    effect = KNOWN[key.partition("@")[0]]
    return f"{effect.description} ({size:g} {effect.unit})"


def machine_text(name: str, kind: str) -> str:
    """machine.toml with the keys of the measured machines."""
    tables: dict[str, dict[str, object]] = {
        "machine": {"name": name, "kind": kind, "gravity_m_s2": 9.8 if kind == "bench" else 9.81},
        "supply": {"pressure_Pa": 7.0e6, "tank_pressure_Pa": 0.0},
        "oil": {"density_kg_m3": 860.0, "bulk_modulus_Pa": 1.5e9},
        "cylinder": {"piston_diameter_m": 0.04, "rod_diameter_m": 0.03, "stroke_m": 0.2, "pipeline_volume_m3": 5e-7},
        "valve": {
            "flow_area": "overlap",
            "voltage_max_V": 10.0,
            "spool_travel_max_m": 1.1e-3,
            "spool_diameter_m": 0.01,
            "overlap_m": 5e-6,
            "edge_rounding_m": 2e-6,
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
            "sharpness_m_s": 2e-4,
        },
        "controller": {"gain_V_per_m": 50.0, "rate_Hz": 500.0},
        "sensors": {
            "position_noise_m": 3e-6,
            "position_resolution_m": 3e-6 if kind == "bench" else 0.0,
            "pressure_noise_Pa": 4e3,
            "acceleration_noise_m_s2": 0.02,
        },
        "uncertainty": {k: v for k, v in UNCERTAINTY.items() if kind == "bench" or k != "moving_mass_kg"},
        "load": {"moving_mass_kg": 40.0},
    }
    if kind == "hexapod":
        tables["sensors"]["angular_acceleration_noise_rad_s2"] = 0.03
        tables["load"] = {
            "platform_mass_kg": 600.0,
            "leg_mass_kg": 0.0,
            "platform_inertia_kg_m2": [60.0, 60.0, 100.0],
            "centre_of_mass_m": [0.0, 0.0, 0.0],
        }
        tables["geometry"] = {
            "base_radius_m": 0.6,
            "base_half_angle_deg": 7.66,
            "platform_radius_m": 0.5,
            "platform_half_angle_deg": 9.21,
            "neutral_leg_length_m": 0.7,
        }
    lines = []
    for table, keys in tables.items():
        lines += [f"[{table}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items()), ""]
    return "\n".join(lines)
