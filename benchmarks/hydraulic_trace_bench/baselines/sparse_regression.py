"""Baseline: sparse regression (LassoCV) over candidate terms of the balances, one term an effect. Knows nothing of hexsim.

    python baselines/sparse_regression.py CASES_FOLDER answers/sparse_regression.json
    python baselines/sparse_regression.py CASES_FOLDER answers/sparse_regression_bold.json 0.2

Needs numpy and scikit-learn. The residuals of four balances (force, continuity of the bottom chamber, acceleration,
supply) are stacked, each in units of its own scatter, with one column an effect: the derivative of the balance by the
effect's number at zero. The declared parameters are first fitted inside their uncertainty. LassoCV on `fit` and `sweep`
selects; the selected term that explains most is named if it also explains more than half (or the last argument) of the
residual's mean square of one balance in `validate`, beyond chance in blocks of half a second. Terms that are alike up to a
correlation of 0.98 are tied. Hexapods: continuity and supply alone, each leg with its own columns; without a platform's
balance, what acts on the platform cannot be named. A residual that no term explains is not reported as "unknown".
"""

from __future__ import annotations

import gzip
import json
import sys
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import cont2discrete, lfilter
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LassoCV
from sklearn.model_selection import GroupKFold

TAPS = 51  # Hann window of 0.1 s: noise of a second difference of 3 um falls below 0.02 m/s2
FEW = 15  # of the velocity in friction: noise 1e-4 m/s, half the width of its sign
EVERY = 10  # rows: 50 Hz, above the window's 20 Hz
SKIP_S = 0.5  # the oil comes to rest
BLOCK_S = 0.5
ALIKE = 0.98  # correlation of tied terms
HALF = 0.5  # more than all else in that balance together
MOST_TIED = 4  # the benchmark's limit
LASSO = {"alphas": 30, "max_iter": 3000, "tol": 1e-3}
ATMOSPHERE_PA = 1.01325e5
SAMPLING = 0.25  # samples at the instants of the controller's update read so much less of the acceleration (README.md)
UNCERTAIN = {  # nuisance column: keys of [uncertainty]
    "discharge": ("discharge_coefficient", "rated_flow_m3_s"),
    "modulus": ("bulk_modulus_Pa",),
    "mass": ("moving_mass_kg",),
    "supply pressure": ("supply_pressure_Pa",),
    "viscous out": ("viscous_extend_N_s_m",),
    "viscous in": ("viscous_retract_N_s_m",),
    "coulomb out": ("coulomb_extend_N",),
    "coulomb in": ("coulomb_retract_N",),
    "static out": ("static_extend_N",),
    "static in": ("static_retract_N",),
    "sampling": ("sampling",),
}
Columns = dict[str, np.ndarray]


class Log:
    """Signals of one log of one leg, SI units, each (n,)."""

    def __init__(self, table: Columns, leg: int, machine: dict):
        mark = f"_{leg}" if "position_1_m" in table else ""
        self.t = table["time_s"]
        self.y = table[f"position{mark}_m"]
        volts = table[f"valve{mark}_V"]
        held = 0.5 * (volts + np.roll(volts, 1))  # a central difference spans the volts before and behind its row
        held[0] = volts[0]
        self.u = behind_spool(held, machine["valve"], self.t[1] - self.t[0])
        self.P = table[f"pressure_bottom{mark}_Pa"]
        self.Ps = table["pressure_supply_Pa"]
        self.P2 = table.get("pressure_top_Pa", self.Ps)
        self.a = table.get("acceleration_m_s2")
        self.v = np.gradient(smooth(self.y, FEW), self.t)
        self.machine = machine


def behind_spool(volts: np.ndarray, valve: dict, step_s: float) -> np.ndarray:
    """Volts behind the declared spool, a lag of second order; themselves where none is declared."""
    if "spool_frequency_Hz" not in valve:
        return volts
    w = 2.0 * np.pi * valve["spool_frequency_Hz"]
    plant = ([w * w], [1.0, 2.0 * valve.get("spool_damping", 0.7) * w, w * w])
    top, below, _ = cont2discrete(plant, step_s, method="foh")
    return lfilter(top.ravel(), below, volts - volts[0]) + volts[0]


def smooth(values: np.ndarray, taps: int = TAPS) -> np.ndarray:
    """Hann window, the ends held."""
    window = np.hanning(taps + 2)[1:-1]
    padded = np.pad(values, taps // 2, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def root(dp: np.ndarray) -> np.ndarray:
    return np.sign(dp) * np.sqrt(np.abs(dp))


def opening(x: np.ndarray, overlap: float, rounding: float) -> np.ndarray:
    return rounding * np.logaddexp(0.0, (x - overlap) / rounding)


def edges(log: Log, u=None, P=None, Ps=None, more_overlap=0.0, back=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Declared flow (into, out of) the bottom chamber [m3/s]."""
    valve, tank = log.machine["valve"], log.machine["supply"].get("tank_pressure_Pa", 0.0)
    u, P, Ps = (log.u if u is None else u), (log.P if P is None else P), (log.Ps if Ps is None else Ps)
    travel, overlap = valve["spool_travel_max_m"], valve["overlap_m"]
    if valve.get("kind") == "four_way":
        k = valve["rated_flow_m3_s"] / (travel - overlap) / np.sqrt(valve["rated_pressure_drop_Pa"])
    else:
        k = valve["discharge_coefficient"] * np.pi * valve["spool_diameter_m"]
        k *= np.sqrt(2.0 / log.machine["oil"]["density_kg_m3"])
    x = travel * np.clip(u / valve["voltage_max_V"], -1.0, 1.0)
    into = k * opening(x, overlap + more_overlap, valve["edge_rounding_m"]) * root(Ps - P)
    conductance = k * opening(-x, overlap + more_overlap, valve["edge_rounding_m"])
    drop = np.maximum(P - tank, 0.0)
    b = conductance**2 * back
    return into, 0.5 * (np.sqrt(b * b + 4.0 * conductance**2 * drop) - b)


def net(log: Log, **changed) -> np.ndarray:
    into, out = edges(log, **changed)
    return into - out


def play(u: np.ndarray, half: float) -> np.ndarray:
    """Backlash."""
    out, last = np.empty_like(u), u[0]
    for k, value in enumerate(u):
        last = min(max(last, value - half), value + half)
        out[k] = last
    return out


def continuity(log: Log) -> tuple[np.ndarray, Columns, Columns]:
    """(residual, nuisance columns, effect columns) of the bottom chamber [m3/s]."""
    cylinder, oil = log.machine["cylinder"], log.machine["oil"]
    area = np.pi / 4.0 * cylinder["piston_diameter_m"] ** 2
    volume = cylinder["pipeline_volume_m3"] + area * log.y
    rate, q = np.gradient(log.P, log.t), net(log)
    _, out = edges(log)
    tank = log.machine["supply"].get("tank_pressure_Pa", 0.0)
    by_volt = (net(log, u=log.u + 5e-3) - net(log, u=log.u - 5e-3)) / 1e-2
    by_P = (net(log, P=log.P + 1e4) - net(log, P=log.P - 1e4)) / 2e4
    absolute = np.maximum(log.P, 0.0) + ATMOSPHERE_PA
    residual = area * np.gradient(log.y, log.t) + volume / oil["bulk_modulus_Pa"] * rate - q
    x = log.machine["valve"]["spool_travel_max_m"] * log.u / log.machine["valve"]["voltage_max_V"]
    lap, length = log.machine["valve"]["overlap_m"], 3e-6
    clearance = (log.Ps - log.P) * length / (length + np.maximum(lap - x, 0.0))
    clearance -= (log.P - tank) * length / (length + np.maximum(lap + x, 0.0))
    nuisance = {"discharge": q, "modulus": -volume / oil["bulk_modulus_Pa"] * rate}
    effects = {
        "leakage_supply_to_chamber": log.Ps - log.P,
        "leakage_chamber_to_tank": -(log.P - tank),
        "clearance_leakage": clearance,
        "entrained_air": -volume * ATMOSPHERE_PA / (1.4 * absolute**2) * rate,
        "hose_compliance": -rate,
        "dead_volume": -rate / oil["bulk_modulus_Pa"],
        "overlap_change": (net(log, more_overlap=1e-6) - q) / 1e-6,
        "null_offset": -by_volt,
        "null_drift": -by_volt * log.t,
        "unequal_ports": -out,
        "spool_lag": -by_volt * np.gradient(log.u, log.t),
        "valve_delay": -by_volt * np.gradient(log.u, log.t),
        "valve_hysteresis": (net(log, u=play(log.u, 0.03)) - q) / 0.03,
        "return_line_back_pressure": (net(log, back=1e9) - q) / 1e9,
        "pressure_gain": -by_P * log.P + volume / oil["bulk_modulus_Pa"] * rate,
        "pressure_offset": -by_P,
        "pressure_delay": by_P * rate,
        "position_gain": area * log.v,
        "position_delay": -area * np.gradient(log.v, log.t),
        "supply_pressure_gain": -(net(log, Ps=1.005 * log.Ps) - q) / 0.005,
    }
    if "pressure_top_Pa" in log.machine["columns"]:
        effects["leakage_across_piston"] = -(log.P - log.P2)
    for place in np.linspace(0.3, 0.7, 5) * cylinder["stroke_m"]:
        key = f"worn_bore#{place:.3f}"
        effects[key] = (log.Ps - log.P) * np.exp(-(((log.y - place) / (0.04 * cylinder["stroke_m"])) ** 2))
    return residual, nuisance, effects


def force(log: Log) -> tuple[np.ndarray, Columns, Columns]:
    """The same of the force balance of one leg [N]: what pushes more than the declared model."""
    cylinder, f, m = log.machine["cylinder"], log.machine["friction"], log.machine["load"]["moving_mass_kg"]
    A1 = np.pi / 4.0 * cylinder["piston_diameter_m"] ** 2
    A2 = A1 - np.pi / 4.0 * cylinder["rod_diameter_m"] ** 2
    g, off = log.machine["machine"]["gravity_m_s2"], log.y - 0.5 * cylinder["stroke_m"]
    out, sign = log.v >= 0.0, np.tanh(log.v / f["sharpness_m_s"])
    fade = np.exp(-np.abs(log.v) / f["stribeck_velocity_m_s"])
    parts = {
        "viscous": np.where(out, f["viscous_extend_N_s_m"], f["viscous_retract_N_s_m"]) * log.v,
        "coulomb": np.where(out, f["coulomb_extend_N"], f["coulomb_retract_N"]) * sign,
        "static": np.where(out, f["static_extend_N"], f["static_retract_N"]) * fade * sign,
    }
    friction = sum(parts.values())
    assert log.a is not None
    residual = m * (log.a + g) + friction - (log.P * A1 - log.P2 * A2)
    nuisance = {
        f"{name} {way}": -value * (out == (way == "out")) for name, value in parts.items() for way in ("out", "in")
    }
    nuisance |= {"mass": -m * (log.a + g), "sampling": -m * log.a}
    effects = {
        "coulomb_friction_change": -sign,
        "viscous_friction_change": -log.v,
        "stribeck_friction_change": -fade * sign,
        "pressure_dependent_friction": -log.P * sign,
        "mass_change": -(log.a + g),
        "incline": m * g * np.ones_like(off),
        "friction_warm_up": friction * (1.0 - np.exp(-log.t / 8.0)),
        "spring": -off,
        "hardening_spring": -(off**3),
        "accelerometer_gain": m * log.a,
        "accelerometer_offset": m * np.ones_like(off),
        "accelerometer_delay": -m * np.gradient(smooth(log.a), log.t),
        "pressure_gain": -A1 * log.P,
        "pressure_offset": -A1 * np.ones_like(off),
        "pressure_delay": A1 * np.gradient(log.P, log.t),
    }
    if "pressure_top_Pa" not in log.machine["columns"]:
        effects["supply_pressure_gain"] = A2 * log.Ps
    for wave in np.array([0.1, 0.15, 0.2, 0.3]) * cylinder["stroke_m"]:
        for name, ripple in (("s", np.sin), ("c", np.cos)):
            effects[f"position_dependent_friction#{wave:.3f}{name}"] = -sign * ripple(2.0 * np.pi * log.y / wave)
    tone = loudest(smooth(residual), log.t)
    for name, wave in (("s", np.sin), ("c", np.cos)):
        effects[f"outside_force_tone#{name}"] = wave(2.0 * np.pi * tone * log.t)
    return residual, nuisance, effects


def loudest(values: np.ndarray, t: np.ndarray) -> float:
    """Frequency [Hz] above 3 Hz, beyond the motion, of the largest line."""
    frequencies = np.fft.rfftfreq(len(values), t[1] - t[0])
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
    power[frequencies < 3.0] = 0.0
    return float(frequencies[np.argmax(power)])


def motion(log: Log) -> tuple[np.ndarray, Columns, Columns]:
    """The same of acceleration against the position's second derivative [m/s2]."""
    assert log.a is not None
    twice = np.gradient(np.gradient(log.y, log.t), log.t)
    slope = np.gradient(smooth(log.a), log.t)
    effects = {
        "accelerometer_gain": log.a,
        "accelerometer_offset": np.ones_like(log.a),
        "accelerometer_delay": -slope,
        "position_gain": -log.a,
        "position_delay": slope,
    }
    return log.a - twice, {"sampling": -log.a}, effects


def supply(logs: list[Log]) -> tuple[np.ndarray, Columns, Columns]:
    """The same of the supply pressure [Pa]; logs: of every leg."""
    log = logs[0]
    declared = log.machine["supply"]["pressure_Pa"]
    taken = sum(np.maximum(edges(one)[0], 0.0) for one in logs)
    slow = np.cumsum(taken - taken.mean()) * (log.t[1] - log.t[0])
    effects = {"supply_droop": -taken, "gas_accumulator": -slow, "supply_pressure_gain": log.Ps}
    tone = loudest(smooth(log.Ps), log.t)
    effects |= {f"pump_ripple#{n}": wave(2.0 * np.pi * tone * log.t) for n, wave in (("s", np.sin), ("c", np.cos))}
    limit = 0.7 * float(np.quantile(taken, 0.98))
    effects["pump_flow_limit"] = -np.maximum(taken - limit, 0.0)
    return log.Ps - declared, {"supply pressure": np.full_like(log.Ps, declared)}, effects


Rows = tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]


def balances(tables: list[Columns], machine: dict) -> dict[str, list[Rows]]:
    """Each balance with its rows of each log, smoothed and thinned; effects of a hexapod have their leg behind them."""
    hexapod = "position_1_m" in tables[0]
    found: dict[str, list[Rows]] = {}

    def add(name: str, made: Rows, t: np.ndarray, leg: int) -> None:
        keep = np.flatnonzero(t >= SKIP_S)[::EVERY]
        place = f" in leg {leg}" if hexapod and leg else ""
        nuisance, effects = ({k: smooth(v)[keep] for k, v in one.items()} for one in made[1:])
        rows = smooth(made[0])[keep], nuisance, {k + place: v for k, v in effects.items()}
        found.setdefault(name + place, []).append(rows)

    for table in tables:
        machine = {**machine, "columns": list(table)}
        logs = [Log(table, leg, machine) for leg in range(1, 7 if hexapod else 2)]
        for leg, log in enumerate(logs, start=1):
            parts: list[tuple[str, Callable[[Log], Rows]]] = [("continuity", continuity)]
            parts += [] if hexapod else [("force", force), ("motion", motion)]
            for name, part in parts:
                add(name, part(log), log.t, leg)
        add("supply", supply(logs), logs[0].t, 0)
    return found


def matrices(found: dict[str, list[Rows]], names: list[str], scale: dict[str, float]):
    """(target, nuisance, effects, block of each row, names of nuisance), in units of each balance's scatter."""
    targets, effects, blocks, sizes = [], [], [], []
    nuisances: list[dict[str, np.ndarray]] = []
    k = 0
    for name, logs in found.items():
        for target, nuisance, own in logs:
            targets.append(target / scale[name])
            effects.append(np.stack([own.get(one, np.zeros(len(target))) for one in names], axis=1) / scale[name])
            nuisances.append({key: value / scale[name] for key, value in nuisance.items()})
            blocks.append(k + np.arange(len(target)) // int(BLOCK_S * 500 / EVERY))
            sizes.append(len(target))
            k = int(blocks[-1][-1]) + 1
    keys = sorted({key for one in nuisances for key in one})
    stacked = [
        np.stack([one.get(k, np.zeros(n)) for k in keys], axis=1) for one, n in zip(nuisances, sizes, strict=True)
    ]
    return np.concatenate(targets), np.concatenate(stacked), np.concatenate(effects), np.concatenate(blocks), keys


def scatter(logs: list[Rows]) -> float:
    """Rms of a balance's residual, its mean square over all logs."""
    return float(np.sqrt(np.mean(np.concatenate([one[0] for one in logs]) ** 2))) or 1.0


def without(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What is orthogonal to the columns."""
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def half_widths(keys: list[str], machine: dict) -> np.ndarray:
    """Relative half widths of the nuisance columns by [uncertainty]; what is not there is known."""
    stated = {**machine.get("uncertainty", {}), "sampling": SAMPLING}
    found = [max([stated[own] for own in UNCERTAIN[key] if own in stated] or [1e-9]) for key in keys]
    return np.array(found)


def answer(folder: Path, least: float = HALF) -> list[dict]:
    """The answer to one case."""
    machine = tomllib.loads((folder / "machine.toml").read_text(encoding="utf-8"))
    fit = balances(
        [read(folder / f"{n}.csv.gz") for n in ("fit", "sweep") if (folder / f"{n}.csv.gz").is_file()], machine
    )
    held = balances([read(folder / "validate.csv.gz")], machine)
    names = sorted({name for logs in fit.values() for one in logs for name in one[2]})
    scale = {name: scatter(logs) for name, logs in fit.items()}
    target, nuisance, effects, blocks, keys = matrices(fit, names, scale)
    width = half_widths(keys, machine)
    declared = lsq_linear(nuisance, target, (-width, width)).x
    target = target - nuisance @ declared
    size = np.sqrt(np.mean(effects**2, axis=0))
    names = [name for name, own in zip(names, size, strict=True) if own > 0.0]
    X, size = effects[:, size > 0.0] / size[size > 0.0], size[size > 0.0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        folds = list(GroupKFold(4).split(X, target, blocks))
        lasso = LassoCV(cv=folds, fit_intercept=False, **LASSO).fit(X, target)
    gains = {family(names[k]): 0.0 for k in np.flatnonzero(lasso.coef_)}
    if not gains:
        return []
    for one in gains:
        columns = X[:, [k for k, name in enumerate(names) if family(name) == one]]
        gains[one] = float(np.mean(target**2) - np.mean(without(columns, target) ** 2))
    best = max(gains, key=lambda one: gains[one])
    own = [name for name in names if family(name) == best]
    theta = np.linalg.lstsq(X[:, [names.index(n) for n in own]], target, rcond=None)[0]
    theta /= np.array([size[names.index(name)] for name in own])
    known = dict(zip(keys, declared, strict=True))
    return [finding(best, X, target, size, names)] if holds(own, theta, known, held, scale, least) else []


def family(name: str) -> str:
    """The effect and leg of a column, whose places and phases have marks."""
    bare, _, place = name.partition(" in ")
    return bare.partition("#")[0] + (f" in {place}" if place else "")


def holds(
    own: list[str],
    theta: np.ndarray,
    declared: dict[str, float],
    held: dict[str, list[Rows]],
    scale: dict,
    least: float,
) -> bool:
    """Does the term as fitted explain more than the least share of a balance's held-out residual, beyond chance?

    Beyond chance: by twice the error of the mean over blocks. A hexapod's legs are balances of their own.
    """
    for name, logs in held.items():
        if not any(one in logs[0][2] for one in own):
            continue
        target, nuisance, effects, blocks, keys = matrices({name: logs}, own, scale)
        target = target - nuisance @ np.array([declared[key] for key in keys])
        gain = target**2 - (target - effects @ theta) ** 2
        means = np.array([gain[blocks == block].mean() for block in np.unique(blocks)])
        error = means.std(ddof=1) / np.sqrt(len(means))
        if means.mean() - 2.0 * error > least * np.mean(target**2):
            return True
    return False


def finding(best: str, X: np.ndarray, target: np.ndarray, size: np.ndarray, names: list[str]) -> dict:
    """Its name, the terms that are like it, its place and its number."""
    own = [k for k, name in enumerate(names) if family(name) == best]
    main = max(own, key=lambda k: abs(X[:, k] @ target))
    alike = np.abs(X.T @ X[:, main]) / len(target)
    tied = [family(names[k]) for k in np.argsort(-alike) if alike[k] > ALIKE]
    bare, _, place = best.partition(" in ")
    all_names = list(dict.fromkeys([bare, *(one.partition(" in ")[0] for one in tied)]))[:MOST_TIED]
    value = float(X[:, main] @ target / len(target) / size[main])
    return {"names": all_names, "where": place or "leg 1", "value": value}


def read(path: Path) -> Columns:
    """A log as columns."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",")
    return dict(zip(names, rows.T, strict=True))


def main() -> None:
    cases, answers = Path(sys.argv[1]), Path(sys.argv[2])
    least = float(sys.argv[3]) if len(sys.argv) > 3 else HALF
    found = {folder.name: answer(folder, least) for folder in sorted(cases.iterdir())}
    answers.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
