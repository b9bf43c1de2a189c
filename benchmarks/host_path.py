"""What is felt of a reversal when a host drives: `python benchmarks/host_path.py [--seeds 0:3] [--latencies 0,5,...]`

The leg of tests/compensation/leg_plant.py (40 kg, no code of hexsim) behind the motion computer's host path: packets at
60 to 500 Hz, late by a fifth of a period (standard deviation), 2 % lost, a declared latency. Plain control, plain control
with the velocity fed forward, and `adaptive` from nothing learned. Sine 0.05 m 0.5 Hz: worst of the last five periods,
deviation from the fundamental in 50 Hz; irregular motion: half the largest of the last eight bumps, 3 to 50 Hz.
Writes docs/results/host_path.json, and docs/images/host_path.png of it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "compensation"), str(ROOT / "benchmarks")]

from leg_plant import run, sine  # noqa: E402 # pyright: ignore[reportMissingImports] (with the tests)

import compensation  # noqa: E402
from compensation import Context, preview_count  # noqa: E402
from hexsim.machine import load_machine  # noqa: E402
from hexsim.recording import palette  # noqa: E402
from hexsim.recording.figure_style import png, small_multiples, styled  # noqa: E402
from hexsim.simulation.hosted import Host, played  # noqa: E402

RESULT = ROOT / "docs" / "results" / "host_path.json"
DURATION_s, MASS_kg = 24.0, 40.0
BAND = butter(4, [3.0, 50.0], btype="band", fs=1e4, output="sos")
WAYS = ("plain", "feed-forward", "adaptive")
GAIN_V_s_m = 6.5  # about one over the velocity gain of the valve


def irregular(seed: int) -> Callable[[np.ndarray], np.ndarray]:
    """Five sines between 0.13 and 0.97 Hz, phases drawn."""
    frequencies = np.array([0.13, 0.31, 0.47, 0.71, 0.97])
    amplitudes, phases = 0.0072 / frequencies**0.8, np.random.default_rng(seed).uniform(0.0, 2 * math.pi, 5)
    return lambda t: (
        0.1
        + np.minimum(t / 2.0, 1.0)
        * sum(a * np.sin(2 * math.pi * f * t + p) for a, f, p in zip(amplitudes, frequencies, phases, strict=True))
    )


def bumps(acceleration_m_s2: np.ndarray, motion: Callable[[np.ndarray], np.ndarray], duration_s: float) -> np.ndarray:
    """Peak to peak in the band about each commanded reversal, of an acceleration every 0.1 ms."""
    t = np.arange(0.0, duration_s, 0.002)
    v = np.diff(motion(t), append=motion(t[-1:] + 0.002))
    band = sosfiltfilt(BAND, acceleration_m_s2)
    times = t[1:][np.signbit(v[1:]) != np.signbit(v[:-1])]
    return np.array(
        [np.ptp(band[round((x - 0.1) * 1e4) : round((x + 0.35) * 1e4)]) for x in times if 1.9 < x < duration_s - 0.4]
    )


def felt(motion_name: str, host: Host, way: str) -> float:
    """Bump [m/s2] of one run."""
    motion = sine() if motion_name == "sine" else irregular(host.seed)
    compensator = compensation.create("adaptive" if way == "adaptive" else "none")
    ticks, preview = round(DURATION_s * 500), preview_count(compensator, Context())

    def pose(time):
        out = np.zeros((len(time), 6))
        out[:, 2] = motion(time) - 0.1
        return out

    wanted = played(load_machine("bench"), pose, host, ticks, preview)[:, 0]
    forward = GAIN_V_s_m * np.gradient(wanted, 0.002)

    def feed(time_s, sample):
        if way == "feed-forward":
            sample.control_V += float(forward[round(time_s * 500)])

    done = run(
        compensator, None, lambda time: wanted[: len(time)], DURATION_s - 0.1, period_s=None, spoil=feed, seed=host.seed
    )
    if motion_name == "sine":
        return float(done.peaks(2.0)[-5:].max())
    late = lambda time: motion(time - (host.buffer_s or 0.0))  # noqa: E731
    return float(bumps(done.acceleration_m_s2, late, DURATION_s - 0.1)[-8:].max()) / 2


@styled
def picture(rows: list[dict], path: Path) -> None:
    figure, plots = small_multiples(2, "Bump of a leg behind a host's packets", columns=2, height=3.2)
    for plot, name in zip(plots, ("sine", "irregular"), strict=True):
        for way, colour in zip(WAYS, (palette.REFERENCE, palette.MARK, palette.RESPONSE), strict=True):
            for rate, style in ((500, "-"), (60, "--")):
                mine = [r for r in rows if (r["motion"], r["way"], r["rate_Hz"]) == (name, way, rate)]
                at = sorted({r["latency_ms"] for r in mine})
                worst = [max(r["bump_m_s2"] for r in mine if r["latency_ms"] == x) for x in at]
                plot.plot(at, worst, style, color=colour, marker="o", ms=3, label=f"{way}, {rate} a second")
        plot.set(
            title="sine 0.05 m, 0.5 Hz" if name == "sine" else "irregular motion", xlabel="latency given away [ms]"
        )
        plot.set_ylim(0.0, 0.62)
    plots[0].set_ylabel("bump in 50 Hz [m/s²]")
    plots[1].legend(loc="center right", bbox_to_anchor=(1.0, 0.35), frameon=False, fontsize=8.0)
    path.write_bytes(png(figure, 120))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="300:302")
    parser.add_argument("--rates", default="60,120,240,500")
    parser.add_argument("--latencies", default="0,5,10,20,40", help="[ms]")
    parser.add_argument("--jitter", type=float, default=0.2)
    parser.add_argument("--loss", type=float, default=0.02)
    arguments = parser.parse_args()
    rows = []
    for seed in range(*map(int, arguments.seeds.split(":"))):
        for rate in map(float, arguments.rates.split(",")):
            for latency_ms in map(float, arguments.latencies.split(",")):
                host = Host(
                    rate_Hz=rate, jitter=arguments.jitter, loss=arguments.loss, buffer_s=1e-3 * latency_ms, seed=seed
                )
                for name in ("sine", "irregular"):
                    for way in WAYS if rate in (60.0, 500.0) and seed % 2 == 0 else WAYS[2:]:
                        row = {"motion": name, "way": way, "rate_Hz": rate, "latency_ms": latency_ms, "seed": seed}
                        rows.append({**row, "bump_m_s2": round(felt(name, host, way), 4)})
                        print(rows[-1], flush=True)
    RESULT.write_text(json.dumps(rows, indent=0) + "\n", encoding="utf-8")
    picture(rows, ROOT / "docs" / "images" / "host_path.png")


if __name__ == "__main__":
    main()
