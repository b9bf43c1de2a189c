"""Formulas for what no effect of the library explains, on machines that are made up: right, wrong or none
-> benchmarks/results/own_formulas.jsonl.gz, docs/results/own_formulas.md

    python benchmarks/own_formulas.py --first 41000 --runs 3
    python benchmarks/own_formulas.py --page

Drives and tanks of four runs, written apart from hexsim's equations; numbers, motion, noise and process disturbance are drawn from
the seed. Twelve effects are missing in turn. Nine are a formula of the signals. Three are none: damping that speed heats, springs that
slip one after another, an inflow that swings in time. Seeds below 41000 were used while the search was written.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
from own_calibration import DRIVE, FINE, FORMULAS, RUNS, SEALED_FORMULAS, commit, filled, motion, rows_of, slow_noise

from hexsim.own.folder import load_simulated
from hexsim.own.trace import trace_own

PAGE = Path(__file__).parents[1] / "docs" / "results" / "own_formulas.md"
SLIPS = np.array([0.1, 0.25, 0.5, 0.9])  # of the reach: where the springs in parallel begin to slip
# What is missing -> its formula at its place; none where it remembers or hangs on time.
OF_DRIVE: dict[str, str | None] = {
    "damping that grows with the place": "x**2 * v in v",
    "root friction": "root(v) in v",
    "cubic damping": "v**3 in v",
    "force periodic over the place": "sin(k * x) in v",
    "drive's gain periodic over the place": "sin(k * x) * command_V in v",
    "quadratic spring": "x * abs(x) in v",
    "drive that droops with speed": "abs(v) * command_V in v",
    "damping that grows as speed heats it": None,
    "springs that slip one after another": None,
}
OF_TANK: dict[str, str | None] = {
    "pump that feels the level": "level_m * pump_V in level_m",
    "pump with a quadratic curve": "pump_V**2 in pump_V",
    "inflow that swings in time": None,
}
TRUTH = OF_DRIVE | OF_TANK


def force_of(what: str, size: float, reach: float, speed: float, wave: float) -> Callable[[float, float, float], float]:
    """What a force without memory takes, over place, velocity and command."""
    laws: dict[str, Callable[[float, float, float], float]] = {
        "damping that grows with the place": lambda x, v, u: 2 * size * v / speed * (x / reach) ** 2,
        "root friction": lambda x, v, u: size * math.copysign(math.sqrt(abs(v) / speed), v),
        "cubic damping": lambda x, v, u: size * (v / speed) ** 3,
        "force periodic over the place": lambda x, v, u: size * math.sin(wave * x / reach),
        "drive's gain periodic over the place": lambda x, v, u: size * u * math.sin(wave * x / reach),
        "quadratic spring": lambda x, v, u: size * x * abs(x) / reach**2,
        "drive that droops with speed": lambda x, v, u: size * u * abs(v) / speed,
    }
    return laws.get(what, lambda x, v, u: 0.0)


def drive(rng: np.random.Generator, what: str, place: Path) -> None:
    mass, w0, zeta = rng.uniform(0.5, 5), 2 * np.pi * rng.uniform(0.3, 1.5), rng.uniform(0.1, 0.5)
    gain, wave, share = rng.uniform(5, 20), rng.uniform(3.0, 9.0), rng.uniform(0.1, 0.3)
    k, c, dt, n = mass * w0**2, 2 * zeta * mass * w0, 0.02, 900
    reach = gain / k
    cools = rng.uniform(2.0, 8.0)  # of 1 / w0: time constant of the heat
    noise, process = rng.uniform(0.002, 0.02) * reach, rng.uniform(0.0, 0.03) * gain
    law = force_of(what, share * gain, reach, w0 * reach, wave)
    off = lambda value: value * rng.uniform(0.8, 1.2)  # noqa: E731
    (place / "model.toml").write_text(DRIVE.format(mass=off(mass), viscous=off(c), stiffness=off(k), gain=gain))
    for run in range(RUNS):
        u, d = motion(rng, n, dt), process * slow_noise(rng, n, 0.1)
        x = v = heat = 0.0
        slid, seen, h = np.zeros(len(SLIPS)), np.zeros(n), dt / FINE
        for i in range(n):
            seen[i] = x
            for _ in range(FINE):
                extra = law(x, v, u[i])
                if what == "damping that grows as speed heats it":
                    heat += h * w0 / cools * ((v / (w0 * reach)) ** 2 - heat)
                    extra = 2 * c * heat * v
                elif what == "springs that slip one after another":
                    slid = np.clip(slid, x - SLIPS * reach, x + SLIPS * reach)
                    extra = 2 * share * k * float(np.mean(x - slid))
                v += h * (gain * u[i] - c * v - k * x - extra + d[i]) / mass
                x += h * v
        seen += noise * rng.standard_normal(n)
        pl.DataFrame({"time_s": np.arange(n) * dt, "command_V": u, "position": seen}).write_csv(place / f"run{run}.csv")


def tank(rng: np.random.Generator, what: str, place: Path) -> None:
    outlet, inlet, share = rng.uniform(0.02, 0.06), rng.uniform(0.01, 0.03), rng.uniform(0.1, 0.3)
    middle = outlet / inlet  # volts that hold the level at 1 m

    def net(level: float, u: float, t: float) -> float:
        acting = u - (share * u**2 / middle if what == "pump with a quadratic curve" else 0.0)
        extra = {
            "pump that feels the level": share * inlet * u * level,
            "inflow that swings in time": share * outlet * math.sin(t / 25),
        }.get(what, 0.0)
        return inlet * acting - outlet * math.sqrt(max(level, 0.0)) - extra

    filled(rng, place, outlet, inlet, net)


def judged(seed: int, what: str) -> dict:
    """One machine made and traced."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (drive if what in OF_DRIVE else tank)(np.random.default_rng(seed), what, place)
        trace = trace_own(load_simulated(place))
    formula, truth = trace.formula, TRUTH[what]
    stated = formula.best.title if formula is not None and formula.proven else None
    steps = [{"title": step.title, "tied": step.tied} for step in trace.steps]
    return {
        "commit": commit(),
        "steps": steps,
        "seed": seed,
        "missing": what,
        "truth": truth,
        "stated": stated,
        "why": formula.why if formula else "",
        "verdict": "none" if stated is None else "right" if stated == truth else "wrong",
        "named": [step.title for step in trace.steps],
        "seconds": time.process_time() - began,
        "fitted": [(one.title, one.nats, one.compared) for one in formula.fitted] if formula else [],
    }


def page(rows: list[dict]) -> str:
    """docs/results/own_formulas.md"""
    seeds = [row["seed"] for row in rows]
    lines = [
        "# Formulas for what the library does not explain",
        "",
        f"`python benchmarks/own_formulas.py`, seeds {min(seeds)} to {max(seeds)}, scored once (the first two twice, after a crash; "
        "41028 and on by",
        "the present rules): each model is missing an effect outside the library "
        "([how](../own_machines.md#a-formula-of-its-own)). Right: this",
        "formula is stated. None: no formula is stated. Named: an effect of the library is named instead.",
        "",
        "| missing | its formula | machines | right | wrong | none | named |",
        "|---|---|---|---|---|---|---|",
    ]
    for what, truth in TRUTH.items():
        own = [row for row in rows if row["missing"] == what]
        if not own:
            continue
        count = {key: sum(row["verdict"] == key for row in own) for key in ("right", "wrong", "none")}
        named = sum(bool(row["named"]) for row in own)
        formula = f"`{truth}`" if truth else "none"
        lines.append(
            f"| {what} | {formula} | {len(own)} | {count['right']} | {count['wrong']} | {count['none']} | {named} |"
        )
    right = {row["missing"] for row in rows if row["verdict"] == "right"}
    wrong = [row for row in rows if row["verdict"] == "wrong"]
    sealed = [row for row in rows if row["seed"] >= SEALED_FORMULAS]
    lines += [
        "",
        f"Of twelve effects {len(right)} get their formula on one machine at least; {len(wrong)} of "
        f"{len(rows)} machines get a wrong one.",
        f"By the present rules: {sum(row['verdict'] == 'right' for row in sealed)} of {len(sealed)} machines right, "
        f"{sum(row['verdict'] == 'wrong' for row in sealed)} wrong.",
    ]
    lines += [f"Wrong: seed {row['seed']}, {row['missing']}: `{row['stated']}`." for row in wrong]
    lines += [f"A machine takes {np.median([row['seconds'] for row in rows]):.0f} s of processor time (median)."]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=40000)
    parser.add_argument("--runs", type=int, default=1, help="machines of each effect")
    parser.add_argument("--only", nargs="+", default=list(TRUTH), help="missing effects")
    parser.add_argument("--out", type=Path, default=FORMULAS)
    parser.add_argument("--page", action="store_true", help="write the page of the journal, and end")
    asked = parser.parse_args()
    if asked.page:
        PAGE.write_text(page(rows_of(asked.out)), encoding="utf-8")
        return
    for k in range(asked.runs):
        for j, what in enumerate(TRUTH):
            if what not in asked.only:
                continue
            row = judged(asked.first + k * len(TRUTH) + j, what)
            with gzip.open(asked.out, "at", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(
                f"{row['seed']} {what}: {row['verdict']} [{row['stated'] or row['why']}] {row['named']} "
                f"{row['seconds']:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
