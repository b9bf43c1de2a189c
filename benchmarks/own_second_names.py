"""Second names: machines that lack two effects of the library, and one whose form is not quite the library's.

    python benchmarks/own_second_names.py --first 51000 --count 8

Even seeds lack a pair, of which both should be named. Odd ones lack a neighbour of one effect: what a first name leaves of it is no
second effect. Drives as in own_calibration.py, with less noise, so that what a name leaves is seen.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl
from own_calibration import DRIVE, FINE, RUNS, motion, oscillator, slow_noise

from hexsim.own.folder import load_simulated
from hexsim.own.trace import OwnTrace, trace_own

PAIRS = (
    ("Coulomb friction", "cubic spring"),
    ("quadratic friction", "dead band of a drive"),
    ("backlash of a drive", "Coulomb friction"),
    ("cubic spring", "quadratic friction"),
    ("asymmetric friction", "cubic spring"),
    ("hysteresis (Bouc-Wen)", "quadratic friction"),
)
# Neighbour -> the effect of the library.
NEAR = {
    "quadratic friction, exponent 1.7": "quadratic friction",
    "cubic spring, exponent 2.6": "cubic spring",
    "Coulomb friction over tanh": "Coulomb friction",
    "dead band, 1.15 and 0.85": "dead band of a drive",
    "backlash with a lag": "backlash of a drive",
    "cubic spring, 1.2 and 0.8": "cubic spring",
}


def drive(rng: np.random.Generator, missing: tuple[str, ...], place: Path) -> None:
    mass, w0, gain, k, c = oscillator(rng)
    dt, n = 0.02, 900
    reach, speed, share = gain / k, w0 * gain / k, rng.uniform(0.12, 0.3)
    noise, process = rng.uniform(0.002, 0.008) * reach, rng.uniform(0.0, 0.01) * gain
    dry, h = (0.5 * share * gain if "Coulomb friction" in missing else 0.0), dt / FINE
    off = lambda value: value * rng.uniform(0.8, 1.2)  # noqa: E731
    (place / "model.toml").write_text(DRIVE.format(mass=off(mass), viscous=off(c), stiffness=off(k), gain=gain))
    for run in range(RUNS):
        u, d = motion(rng, n, dt), process * slow_noise(rng, n, 0.1)
        x = v = z = held = late = 0.0
        seen = np.zeros(n)
        for i in range(n):
            seen[i] = x
            for _ in range(FINE):
                held = min(max(held, u[i] - 0.5 * share), u[i] + 0.5 * share)
                late += (held - late) * (1 - math.exp(-h / (0.3 * dt)))
                z += h * (v - 2.0 / reach * abs(v) * z)
                acting = {
                    "dead band of a drive": math.copysign(max(abs(u[i]) - share, 0.0), u[i]),
                    "dead band, 1.15 and 0.85": max(u[i] - 1.15 * share, 0.0) - max(-u[i] - 0.85 * share, 0.0),
                    "backlash of a drive": held,
                    "backlash with a lag": late,
                }
                q, y = v / speed, x / reach
                takes = {
                    "quadratic friction": q * abs(q),
                    "quadratic friction, exponent 1.7": math.copysign(abs(q) ** 1.7, q),
                    "cubic spring": y**3,
                    "cubic spring, exponent 2.6": math.copysign(abs(y) ** 2.6, y),
                    "cubic spring, 1.2 and 0.8": y**3 * (1.2 if y > 0 else 0.8),
                    "asymmetric friction": abs(q),
                    "hysteresis (Bouc-Wen)": 2 * z / reach,
                    "Coulomb friction over tanh": 0.5 * math.tanh(q / 0.05),
                }
                extra = share * gain * sum(takes.get(one, 0.0) for one in missing)
                driven = next((acting[one] for one in missing if one in acting), u[i])
                new = v + h * (gain * driven - c * v - k * x - extra + d[i]) / mass
                v = math.copysign(max(abs(new) - h * dry / mass, 0.0), new)
                x += h * v
        seen += noise * rng.standard_normal(n)
        pl.DataFrame({"time_s": np.arange(n) * dt, "command_V": u, "position": seen}).write_csv(place / f"run{run}.csv")


def verdict(trace: OwnTrace, wanted: tuple[str, ...]) -> str:
    """Names against those that there should be: each right, tied with it, or wrong."""
    said = []
    for step in trace.steps:
        titles = (step.title, *step.tied)
        right = any(title.startswith(wanted) for title in titles)
        said.append(f"{step.title}: {'wrong' if not right else 'tied' if step.tied else 'right'}")
    return ", ".join(said) or "nothing named"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=51000)
    parser.add_argument("--count", type=int, default=8)
    asked = parser.parse_args()
    for seed in range(asked.first, asked.first + asked.count):
        began, near = time.process_time(), list(NEAR)[seed // 2 % len(NEAR)]
        missing = (near,) if seed % 2 else PAIRS[seed // 2 % len(PAIRS)]
        with tempfile.TemporaryDirectory() as folder:
            drive(np.random.default_rng(seed), missing, Path(folder))
            trace = trace_own(load_simulated(Path(folder)))
        formula = f"; formula {trace.formula.best.title}" if trace.formula is not None and trace.formula.proven else ""
        stand_ins = {one.title for one in trace.found.in_model} - {step.title for step in trace.steps}
        doubted = "; ".join(f"{one.title}: {one.why}" for one in trace.found.refused if one.title in stand_ins)
        print(
            f"{seed} {' + '.join(missing)} -> {verdict(trace, (NEAR[near],) if seed % 2 else missing)}{formula} "
            f"[{doubted}] {time.process_time() - began:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
