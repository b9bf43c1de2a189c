"""A four-way bench of another writer: two chambers, four edges, return line. Shares no code with hexsim.

    write_machine(folder, seed=3, effect="return_line")

writes machine.toml (declared), three logs and truth.json, as `other_plant` does for a three-way valve. State: P1, P2,
spool place and speed, Ps, y, v; Heun's method, 10 us a step.
"""

import json
from pathlib import Path

import numpy as np
import polars as pl
from numba import njit

STEP_S, RUNS, RATE_HZ = 1.0e-5, ("fit", "sweep", "validate"), 1000
D, ROD, STROKE, DEAD = 0.063, 0.045, 0.4, (4.0e-5, 3.0e-5)
A, B = np.pi / 4 * D**2, np.pi / 4 * (D**2 - ROD**2)
GRAVITY, TANK, LIMIT_V, KP = 9.81, 2.0e5, 10.0, 30.0
TRAVEL = 4.0e-4
DECLARED = {
    "supply": 1.4e7, "flow": 8.0e-4, "drop": 3.5e6, "modulus": 1.3e9, "density": 870.0, "mass": 240.0, "spool_hz": 100.0,
    "out": 1800.0, "in": 1600.0, "dry_out": 210.0, "dry_in": 200.0, "peak_out": 70.0, "peak_in": 70.0, "lap": 5.0e-6,
    "soft": 1.5e-6,
}  # fmt: skip
UNCERTAIN = {  # key of the machine file -> (field, half width)
    "rated_flow_m3_s": ("flow", 0.05), "bulk_modulus_Pa": ("modulus", 0.12), "moving_mass_kg": ("mass", 0.02),
    "viscous_extend_N_s_m": ("out", 0.15), "viscous_retract_N_s_m": ("in", 0.15), "coulomb_extend_N": ("dry_out", 0.15),
    "coulomb_retract_N": ("dry_in", 0.15), "static_extend_N": ("peak_out", 0.2), "static_retract_N": ("peak_in", 0.2),
    "supply_pressure_Pa": ("supply", 0.01), "spool_frequency_Hz": ("spool_hz", 0.10),
}  # fmt: skip
# name -> (size, unit, right names of the library, key of the number)
EFFECTS = {
    "none": (0.0, "", (), ""),
    "cross_leak": (8e-13, "m3/s/Pa", ("leakage_across_piston",), "conductance_m3_s_Pa"),
    "null": (0.06, "V", ("null_offset",), "offset_V"),
    "air": (0.01, "1", ("entrained_air",), "volume_fraction"),
    "hysteresis": (0.03, "V", ("valve_hysteresis",), "half_width_V"),
    "laps": (6e-6, "m", ("overlap_change",), "overlap_m"),
    "return_line": (1.2e9, "Pa s/m3", ("return_line_back_pressure",), "line_resistance_Pa_s_m3"),
    "seal": (2e-5, "N/Pa", ("pressure_dependent_friction", "seal_friction"), "force_per_pressure_N_Pa"),
    "droop": (2e9, "Pa s/m3", ("supply_droop",), "line_resistance_Pa_s_m3"),
    "spring": (6000.0, "N/m", ("spring",), "stiffness_N_m"),
    "late": (4e-3, "s", ("valve_delay",), "delay_s"),
}
FIELDS = (
    *DECLARED,
    "cross_leak",
    "null",
    "air",
    "hysteresis",
    "laps",
    "return_line",
    "seal",
    "droop",
    "spring",
    "late",
    "rest_V",
)
F = {name: k for k, name in enumerate(FIELDS)}
fast = njit(cache=True, error_model="numpy", _nrt=False)  # makes no arrays, so that no owner need be counted
SUPPLY, FLOW, DROP, MODULUS, _, MASS, SPOOL, OUT, IN, DRY_OUT, DRY_IN, PEAK_OUT, PEAK_IN, LAP, SOFT = range(15)
CROSS, NULL, AIR, HYSTERESIS, LAPS, RETURN, SEAL, DROOP, SPRING, LATE, REST = range(15, 26)


@fast
def orifice(g, place, soft, dp):
    """Flow through one edge that is open by `place` [m] (soft corner), quadratic resistance, laminar below 100 Pa."""
    area = place if place > 30.0 * soft else (0.0 if place < -30.0 * soft else soft * np.log1p(np.exp(place / soft)))
    return g * area * dp / np.sqrt(np.sqrt(dp * dp + 1.0e8))


@fast
def through(g, place, soft, dp, back):
    """Flow to the tank against the line's resistance `back`, by the secant of its own balance (bisection)."""
    q = orifice(g, place, soft, dp)
    if back <= 0.0 or q == 0.0:
        return q
    low, high = min(q, 0.0), max(q, 0.0)
    for _ in range(60):
        q = 0.5 * (low + high)
        if orifice(g, place, soft, dp - back * q) > q:
            low = q
        else:
            high = q
    return q


@fast
def softness(volume, pressure, c):
    """Capacity [m3/Pa] of oil with free air (volume share at one atmosphere by Boyle, ripple adiabatic)."""
    if c[AIR] == 0.0:
        return volume / c[MODULUS]
    absolute = max(pressure + 1.01325e5, 2.0e4)
    share = c[AIR] * 1.01325e5 / absolute
    return volume * (1.0 / c[MODULUS] + share / (1.4 * absolute)) / (1.0 + share)


@fast
def flows(c, x, P1, P2, Ps):
    """Net flow into bottom and rod side, and what the supply gives [m3/s]; x [m] positive opens P-A and B-T."""
    g = c[FLOW] / (TRAVEL - c[LAP]) / np.sqrt(c[DROP])
    lap, soft = c[LAP] + c[LAPS], c[SOFT]
    pa, pb = orifice(g, x - lap, soft, Ps - P1), orifice(g, -x - lap, soft, Ps - P2)
    at, bt = through(g, -x - lap, soft, P1 - TANK, c[RETURN]), through(g, x - lap, soft, P2 - TANK, c[RETURN])
    seep = c[CROSS] * (P1 - P2)
    return pa - at - seep, pb - bt + seep, pa + pb


@fast
def rubbing(c, v, P1):
    """Friction [N] against the motion."""
    if v >= 0.0:
        viscous, dry, peak = c[OUT], c[DRY_OUT], c[PEAK_OUT]
    else:
        viscous, dry, peak = c[IN], c[DRY_IN], c[PEAK_IN]
    level = dry + c[SEAL] * max(P1, 0.0) + peak * np.exp(-abs(v) / 0.008)
    return viscous * v + level * np.tanh(v / 2.0e-4)


@fast
def slope_of(c, s, volts, out):
    """Rates of (P1, P2, x, x', Ps, y, v)."""
    P1, P2, x, speed, Ps, y, v = s
    asked = min(max((volts - c[NULL]) / LIMIT_V, -1.0), 1.0) * TRAVEL
    w = 2.0 * np.pi * c[SPOOL]
    out[2], out[3] = speed, w * (w * (asked - x) - 1.6 * speed)
    into, up, taken = flows(c, min(max(x, -TRAVEL), TRAVEL), P1, P2, Ps)
    out[0] = (into - A * v) / softness(DEAD[0] + A * y, P1, c)
    out[1] = (up + B * v) / softness(DEAD[1] + B * (STROKE - y), P2, c)
    out[4] = ((c[SUPPLY] - Ps) / c[DROOP] - taken) / 8.0e-12 if c[DROOP] > 0.0 else 0.0
    out[5] = v
    push = P1 * A - P2 * B - rubbing(c, v, P1) - c[SPRING] * (y - 0.5 * STROKE)
    out[6] = push / c[MASS] - GRAVITY


@njit(cache=True, error_model="numpy")
def run(c, start, setpoint, out):
    """Closed loop, setpoints at 1 kHz, controller every 2 ms; out (n, 6): y, volts, P1, P2, Ps, a. Heun's second order."""
    s, k1, k2, there = start.copy(), np.empty(7), np.empty(7), np.empty(7)
    n, steps = len(setpoint), round(1.0 / RATE_HZ / STEP_S)
    held, volts = 0.0, np.zeros(n)
    for i in range(n):
        volts[i] = min(max(KP * (setpoint[i] - s[5]), -LIMIT_V), LIMIT_V) if i % 2 == 0 else volts[i - 1]
        late = volts[max(i - round(c[LATE] * RATE_HZ), 0)]
        held = min(max(held, late - c[HYSTERESIS]), late + c[HYSTERESIS])
        slope_of(c, s, held, k1)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5] = s[5], volts[i], s[0], s[1], s[4], k1[6]
        for j in range(steps):
            if j > 0:
                slope_of(c, s, held, k1)
            for part in range(7):
                there[part] = s[part] + STEP_S * k1[part]
            slope_of(c, there, held, k2)
            for part in range(7):
                s[part] += 0.5 * STEP_S * (k1[part] + k2[part])


def setpoints(run_name: str, rng: np.random.Generator, n: int) -> np.ndarray:
    """Multisine, sweep, and the report's kind of sine, about mid stroke [m], held for 2 ms."""
    t = np.arange(n) // 2 * 2 / RATE_HZ
    fade = np.minimum(t / 2.0, 1.0)
    if run_name == "fit":
        f = np.array([0.19, 0.37, 0.53, 0.83, 1.3, 2.1, 3.3])
        wave = np.sum(np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, (len(f), 1))) / f[:, None], axis=0)
        move = 0.09 * wave / np.max(np.abs(wave))
    elif run_name == "sweep":
        move = 0.02 * np.sin(2 * np.pi * (0.2 * t + 0.05 * t**2))
    else:
        move = 0.08 * np.sin(2 * np.pi * 0.5 * t)
    return 0.5 * STROKE + (1.0 if run_name == "sweep" else fade) * move


def write_machine(
    folder, seed: int, effect: str = "none", size: float | None = None, duration_s: float = 20.0
) -> dict[str, float]:
    """Write machine.toml, the logs and truth.json; returns the true numbers."""
    folder, rng = Path(folder), np.random.default_rng([seed, 77])
    folder.mkdir(parents=True, exist_ok=True)
    true = dict(DECLARED)
    for field, width in UNCERTAIN.values():
        true[field] *= 1.0 + width * rng.uniform(-1, 1)
    true |= {name: 0.0 for name in FIELDS if name not in true}
    if effect != "none":
        true[effect] = EFFECTS[effect][0] if size is None else size
    c = np.array([true[name] for name in FIELDS])
    n = int(duration_s * RATE_HZ)
    for which in RUNS:
        noise = np.random.default_rng([seed, 5, *which.encode()])
        P2 = 0.5 * true["supply"]
        start = np.array([(true["mass"] * GRAVITY + P2 * B) / A, P2, 0.0, 0.0, true["supply"], 0.5 * STROKE, 0.0])
        setpoint, out = setpoints(which, rng, n), np.empty((n, 6))
        run(c, start, setpoint, out)
        y, volts, P1, P2, Ps, a = out.T
        table = {
            "time_s": np.arange(n) / RATE_HZ, "setpoint_m": setpoint.round(8),
            "position_m": (np.round((y + 2e-6 * noise.standard_normal(n)) / 2e-6) * 2e-6).round(7),
            "valve_V": (np.round(volts / 3e-4) * 3e-4).round(5),
        }  # fmt: skip
        for name, values in {"bottom": P1, "top": P2, "supply": Ps}.items():
            table[f"pressure_{name}_Pa"] = (values + 6e3 * noise.standard_normal(n)).round(1)
        table["acceleration_m_s2"] = (a + 0.02 * noise.standard_normal(n)).round(5)
        pl.DataFrame(table).write_parquet(folder / f"{which}.parquet")
    (folder / "machine.toml").write_text(machine_text(folder.name), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps({"effect": effect, "true": true}, indent=1), encoding="utf-8")
    return true


def machine_text(name: str) -> str:
    """machine.toml as its data sheets say."""
    d = DECLARED
    tables: dict[str, dict[str, object]] = {
        "machine": {"name": name, "kind": "bench", "gravity_m_s2": GRAVITY},
        "supply": {"pressure_Pa": d["supply"], "tank_pressure_Pa": TANK},
        "oil": {"density_kg_m3": d["density"], "bulk_modulus_Pa": d["modulus"]},
        "cylinder": {
            "piston_diameter_m": D, "rod_diameter_m": ROD, "stroke_m": STROKE, "pipeline_volume_m3": DEAD[0], "rod_side": "valve",
            "rod_side_volume_m3": DEAD[1],
        },
        "valve": {
            "kind": "four_way", "rated_flow_m3_s": d["flow"], "rated_pressure_drop_Pa": d["drop"], "voltage_max_V": LIMIT_V,
            "spool_travel_max_m": TRAVEL, "overlap_m": d["lap"], "edge_rounding_m": d["soft"], "spool_frequency_Hz": d["spool_hz"],
            "spool_damping": 0.8,
        },
        "friction": {
            "viscous_extend_N_s_m": d["out"], "viscous_retract_N_s_m": d["in"], "coulomb_extend_N": d["dry_out"],
            "coulomb_retract_N": d["dry_in"], "static_extend_N": d["peak_out"], "static_retract_N": d["peak_in"],
            "stribeck_velocity_m_s": 0.008, "sharpness_m_s": 2e-4,
        },
        "controller": {"gain_V_per_m": KP, "rate_Hz": 500.0},
        "sensors": {
            "position_noise_m": 2e-6, "position_resolution_m": 2e-6, "pressure_noise_Pa": 6e3, "acceleration_noise_m_s2": 0.02,
        },
        "uncertainty": {key: width for key, (_, width) in UNCERTAIN.items()},
        "load": {"moving_mass_kg": d["mass"]},
    }  # fmt: skip
    lines: list[str] = []
    for table, keys in tables.items():
        lines += [f"[{table}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items()), ""]
    return "\n".join(lines)
