"""Made-up machines of one's own whose missing effect is known: names right, tied and wrong -> benchmarks/results/own_calibration.jsonl.gz

    python benchmarks/own_calibration.py --first 22206 --count 80

Drives and tanks, written apart from hexsim's equations: numbers, motion, noise, process disturbance and the missing effect are drawn from
the seed. A third lacks nothing, a third an effect of the library, a third an effect that the library does not have. Seeds to 22205 were
looked at while the inference was written; from 22206 on they are scored once.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl

from hexsim.own.folder import load_simulated
from hexsim.own.trace import trace_own

FINE = 10  # steps of the plant a sample
RUNS = 4  # the last one is held out for good

DRIVE = """
[runs]
fit = ["run0", "run1", "run2"]
validate = ["run3"]
[signals]
command_V = {{ quantity = "voltage", hold = true }}
[parameters]
mass = {{ start = {mass:.4g}, sign = 1 }}
viscous = {{ start = {viscous:.4g}, sign = 1 }}
stiffness = {{ start = {stiffness:.4g}, sign = 1 }}
[states.x]
rate = "v"
[states.v]
quantity = "force"
sum = "{gain:.6g} * command_V - viscous * v - stiffness * x"
storage = "mass"
[outputs.position]
formula = "x"
[simulation]
scheme = "heun"
steps = 4
"""
TANK = """
[runs]
fit = ["run0", "run1", "run2"]
validate = ["run3"]
[signals]
pump_V = {{ quantity = "voltage", hold = true }}
level_m = {{ quantity = "level" }}
[parameters]
inlet = {{ start = {inlet:.4g}, sign = 1 }}
outlet = {{ start = {outlet:.4g}, sign = 1 }}
[states.level_m]
quantity = "flow"
sum = "inlet * pump_V - outlet * sqrt(level_m)"
start = "free"
guess = 1.0
[outputs.level_m]
formula = "level_m"
[simulation]
scheme = "heun"
steps = 2
"""
OF_DRIVE = {
    "library": [
        "Coulomb friction",
        "quadratic friction",
        "cubic spring",
        "constant force",
        "dead band of a drive",
        "backlash of a drive",
        "lag of a drive",
        "hysteresis (Bouc-Wen)",
        "asymmetric friction",
    ],
    "outside": ["periodic force", "damping over place", "root friction", "rippled gain"],
}
OF_TANK = {
    "library": ["overflow", "laminar leak", "inflow", "dead band of a drive"],
    "outside": ["outlet exponent", "rippled gain", "swinging inflow"],
}
SAME = {
    "constant force": ("constant force", "offset of a drive"),
    "inflow": ("inflow", "offset of a drive"),
    "outlet exponent": ("flow over another power",),  # outside the library until seed 20039
}
FORMULA = {
    "periodic force": ["sin(k * x) in v"],
    "damping over place": ["x**2 * v in v"],
    "root friction": ["root(v) in v"],
    "rippled gain": ["sin(k * command_V) in command_V", "sin(k * pump_V) in pump_V"],
    "outlet exponent": ["abs(level_m)**n in level_m"],
}
JOURNAL = Path(__file__).parent / "results" / "own_calibration.jsonl.gz"
FORMULAS = JOURNAL.with_name("own_formulas.jsonl.gz")
SEALED = 22_206  # seeds from here on: not looked at while the inference was written
SEALED_FORMULAS = 41_028


def motion(rng: np.random.Generator, n: int, dt: float) -> np.ndarray:
    """A few sines and steps, about 1 in size."""
    t = np.arange(n) * dt
    f = np.exp(rng.uniform(np.log(1.5), np.log(40.0), 6)) / (n * dt)
    sines = sum(np.sin(2 * np.pi * one * t + rng.uniform(0, 2 * np.pi)) for one in f) / 2.5
    steps = np.repeat(rng.normal(0, 0.6, n // 50 + 1), 50)[:n]
    return (sines + steps) * rng.uniform(0.7, 1.3)


def slow_noise(rng: np.random.Generator, n: int, corner: float) -> np.ndarray:
    """First-order noise of unit size; corner: of a sample."""
    a, y = math.exp(-corner), np.zeros(n)
    for k in range(1, n):
        y[k] = a * y[k - 1] + math.sqrt(1 - a * a) * rng.standard_normal()
    return y


def oscillator(rng: np.random.Generator) -> tuple[float, float, float, float, float]:
    """Mass, natural frequency [rad/s], gain, stiffness and damping of a drive."""
    mass, w0, zeta, gain = (
        rng.uniform(0.5, 5),
        2 * np.pi * rng.uniform(0.3, 1.5),
        rng.uniform(0.1, 0.5),
        rng.uniform(5, 20),
    )
    return mass, w0, gain, mass * w0**2, 2 * zeta * mass * w0


def drive(rng: np.random.Generator, what: str, place: Path) -> None:
    mass, w0, gain, k, c = oscillator(rng)
    dt, n = 0.02, 900
    force, reach = gain, gain / k
    speed, share = w0 * reach, rng.uniform(0.08, 0.3)
    noise, process = rng.uniform(0.002, 0.02) * reach, rng.uniform(0.0, 0.03) * force
    lag, play, band = rng.uniform(2, 6) * dt, share, share
    off = lambda value: value * rng.uniform(0.8, 1.2)  # noqa: E731
    (place / "model.toml").write_text(DRIVE.format(mass=off(mass), viscous=off(c), stiffness=off(k), gain=gain))
    for run in range(RUNS):
        u, d = motion(rng, n, dt), process * slow_noise(rng, n, 0.1)
        x = v = z = 0.0
        held, lagged, seen, h = 0.0, 0.0, np.zeros(n), dt / FINE
        for i in range(n):
            seen[i] = x
            for _ in range(FINE):
                held = min(max(held, u[i] - 0.5 * play), u[i] + 0.5 * play)
                lagged += (u[i] - lagged) * (1 - math.exp(-h / lag))
                acting = {
                    "backlash of a drive": held,
                    "lag of a drive": lagged,
                    "rippled gain": u[i] + share * math.sin(5 * u[i]),
                    "dead band of a drive": math.copysign(max(abs(u[i]) - band, 0.0), u[i]),
                }.get(what, u[i])
                z += h * (v - 2.0 / reach * abs(v) * z)
                extra = {
                    "quadratic friction": share * force * v * abs(v) / speed**2,
                    "cubic spring": share * force * (x / reach) ** 3,
                    "constant force": share * force,
                    "hysteresis (Bouc-Wen)": 2 * share * force * z / reach,
                    "asymmetric friction": share * force * abs(v) / speed,
                    "periodic force": share * force * math.sin(12 * x / reach),
                    "damping over place": 2 * share * force * v / speed * (x / reach) ** 2,
                    "root friction": share * force * math.copysign(math.sqrt(abs(v) / speed), v),
                }.get(what, 0.0)
                pushed = gain * acting - c * v - k * x - extra + d[i]
                if what == "Coulomb friction":
                    dry = 0.5 * share * force
                    new = v + h * pushed / mass
                    v = math.copysign(max(abs(new) - h * dry / mass, 0.0), new)
                else:
                    v += h * pushed / mass
                x += h * v
        seen += noise * rng.standard_normal(n)
        pl.DataFrame({"time_s": np.arange(n) * dt, "command_V": u, "position": seen}).write_csv(place / f"run{run}.csv")


def tank(rng: np.random.Generator, what: str, place: Path) -> None:
    outlet, inlet = rng.uniform(0.02, 0.06), rng.uniform(0.01, 0.03)
    share, exponent = rng.uniform(0.08, 0.3), rng.uniform(0.62, 0.8)
    middle = outlet / inlet  # volts that hold the level at 1 m

    def net(level: float, u: float, t: float) -> float:
        acting = {
            "dead band of a drive": max(u - share * middle, 0.0),
            "rippled gain": u + share * middle * math.sin(8 * u / middle),
        }.get(what, u)
        out = outlet * math.sqrt(max(level, 0.0))
        extra = {
            "overflow": 5 * share * outlet * max(level - 1.25, 0.0) * 4,
            "laminar leak": share * outlet * level,
            "inflow": -share * outlet,
            "swinging inflow": share * outlet * math.sin(t / 25),
            "outlet exponent": outlet * max(level, 0.0) ** exponent - out,
        }.get(what, 0.0)
        return inlet * acting - out - extra

    filled(rng, place, outlet, inlet, net)


def filled(
    rng: np.random.Generator, place: Path, outlet: float, inlet: float, net: Callable[[float, float, float], float]
) -> None:
    """Model file and runs of a tank. net: inflow less outflow [m/s] over level [m], volts and time [s], beside the disturbance."""
    dt, n = 1.0, 1000
    noise, process = rng.uniform(0.003, 0.02), rng.uniform(0.0, 0.02) * outlet
    off = lambda value: value * rng.uniform(0.8, 1.2)  # noqa: E731
    (place / "model.toml").write_text(TANK.format(inlet=off(inlet), outlet=off(outlet)))
    for run in range(RUNS):
        u = np.maximum(outlet / inlet * (1 + 0.35 * motion(rng, n, dt)), 0.0)
        d = process * slow_noise(rng, n, 0.05)
        level, seen, h = rng.uniform(0.6, 1.2), np.zeros(n), dt / FINE
        for i in range(n):
            seen[i] = level
            for _ in range(FINE):
                level = max(level + h * (net(level, u[i], i * dt) + d[i]), 0.0)
        seen += noise * rng.standard_normal(n)
        pl.DataFrame({"time_s": np.arange(n) * dt, "pump_V": u, "level_m": seen}).write_csv(place / f"run{run}.csv")


def drawn(rng: np.random.Generator) -> tuple[str, str, str]:
    """(kind, class of what is missing, its name)."""
    kind, effects = ("drive", OF_DRIVE) if rng.random() < 0.6 else ("tank", OF_TANK)
    sort = str(rng.choice(["none", "library", "outside"]))
    return kind, sort, "nothing" if sort == "none" else str(rng.choice(effects[sort]))


def machine(seed: int, place: Path) -> tuple[str, str, str]:
    """What `drawn` says of the machine whose files are made."""
    rng = np.random.default_rng(seed)
    kind, sort, what = drawn(rng)
    {"drive": drive, "tank": tank}[kind](rng, what, place)
    return kind, sort, what


def verdicts_of(what: str, steps: list[dict], formula: str | None = None) -> list[str]:
    """Of each name: wrong if it is neither what is missing nor tied with it or with its formula."""
    right = (*SAME.get(what, (what,)), *([formula] if formula else FORMULA.get(what, ())))
    return [
        "right"
        if all(title.startswith(right) for title in (step["title"], *step["tied"]))
        else "tied"
        if any(title.startswith(right) for title in (step["title"], *step["tied"]))
        else "wrong"
        for step in steps
    ]


def verdict_of(what: str, steps: list[dict]) -> str:
    """Of a machine: wrong where one name is."""
    of = verdicts_of(what, steps)
    return next((one for one in ("wrong", "tied", "right") if one in of), "nothing named")


def rows_of(path: Path) -> list[dict]:
    with gzip.open(path, "rt", encoding="utf-8") as file:
        return [json.loads(line) for line in file]


@cache
def commit() -> str:
    """At the first call: of the code that runs."""
    return subprocess.run(
        ["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()


def judged(seed: int) -> dict:
    """One machine made and traced."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        kind, sort, what = machine(seed, place)
        trace = trace_own(load_simulated(place))
    steps = [{"title": step.title, "nats": step.nats, "chance": step.chance, "tied": step.tied} for step in trace.steps]
    formula = trace.formula
    return {
        "commit": commit(),
        "stated": formula.best.title if formula is not None and formula.proven else None,
        "seed": seed,
        "kind": kind,
        "sort": sort,
        "missing": what,
        "verdict": verdict_of(what, steps),
        "steps": steps,
        "refused": [(one.title, one.nats, one.why) for one in trace.found.refused],
        "seconds": time.process_time() - began,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=20000)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--only", nargs="+", default=["none", "library", "outside"], help="classes of what is missing")
    parser.add_argument("--out", type=Path, default=JOURNAL)
    asked = parser.parse_args()
    print(f"commit {commit()}")
    counts: dict[str, dict[str, int]] = {}
    for seed in range(asked.first, asked.first + asked.count):
        if drawn(np.random.default_rng(seed))[1] not in asked.only:
            continue
        row = judged(seed)
        with gzip.open(asked.out, "at", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        of = counts.setdefault(row["sort"], {})
        of[row["verdict"]] = of.get(row["verdict"], 0) + 1
        named = ", ".join(f"{step['title']} {step['nats']:.0f}" for step in row["steps"])
        print(f"{seed} {row['kind']} {row['missing']}: {row['verdict']} [{named}] {row['seconds']:.1f} s", flush=True)
    print(counts)


if __name__ == "__main__":
    main()
