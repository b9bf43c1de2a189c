"""A real servo valve on a valve stand: leakage tests against the valve model.

    python examples/servovalve.py [FOLDER]       default: shared/measured/servovalve_bench beside the repository

Hysteresis against lag and null leakage; flow curve, pressure gain and exponent are examples/own_machines/servovalve_*. Shown here: laws
fitted on some blocks of a sweep and scored on the others, and verdicts that say what the data decide. The data have no licence and are
not part of the project.
"""

from __future__ import annotations

import gzip
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.optimize import least_squares
from scipy.signal import lfilter

from hexsim.errors import HexsimError
from hexsim.hydraulics.leg import valve_volts
from hexsim.hydraulics.valve import clearance_conductance

DATA = Path(__file__).resolve().parents[2] / "shared" / "measured" / "servovalve_bench"
GPM, PSI = 3.785411784e-3 / 60, 6894.757  # [m3/s], [Pa]
SUPPLY_PSI = 3000.0
SUFFIX = {"": 1.0, "m": 1e-3, "u": 1e-6, "n": 1e-9, "k": 1e3}
BLOCKS = 12  # contiguous blocks of a sweep: every second one is held out
PERIODS = (20, 50, 100, 200, 500)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One problem to the data: the numbers and the sentence."""

    problem: str
    numbers: dict[str, float]
    description: str


def number(text: str) -> float:
    """25.1m -> 0.0251."""
    match = re.fullmatch(r"(-?[0-9.]+(?:e-?[0-9]+)?)([munk]?)", text.strip())
    if match is None:
        raise HexsimError(f"{text!r} is no number with an SI suffix")
    return float(match[1]) * SUFFIX[match[2]]


def read(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """First two columns of a test, the measurement; the others are limits of its plot. Currents in mA."""
    path = folder / f"{name}.txt.gz"
    if not path.is_file():
        raise HexsimError(f"the measured data are not in {folder}: give their folder")
    lines = gzip.decompress(path.read_bytes()).decode().split("\n")[1:]
    cells = [line.split("\t") for line in lines if line.strip()]
    x = np.array([number(cell[0]) for cell in cells])
    y = np.array([number(cell[1]) for cell in cells])
    return (x if name == "Performance" else x * 1e3), y


def play(current: np.ndarray, half_width: float) -> np.ndarray:
    """The project's hysteresis operator on a sweep."""
    return valve_volts(np.ascontiguousarray(current), max(half_width, 0.0), 0)


def held_out(
    model: Callable, start: list[float], x: np.ndarray, y: np.ndarray, use: np.ndarray, turns: tuple[float, ...] = ()
) -> tuple[np.ndarray, float]:
    """(parameters from all, rms on held-out blocks): fitted on even blocks and scored on odd ones, and the reverse.

    turns: starting values of the last parameter (hysteresis has several valleys).
    """
    block = np.arange(len(x)) * BLOCKS // len(x) % 2
    left = np.full(len(x), np.nan)
    starts = [[*start[:-1], turn] for turn in turns] or [start]

    def fit(mask: np.ndarray) -> np.ndarray:
        tries = []
        for first in starts:
            scale = np.maximum(np.abs(first), 1e-3)

            def misfit(c: np.ndarray, scale: np.ndarray = scale) -> np.ndarray:
                return (model(c * scale, x) - y)[mask]

            found = least_squares(misfit, np.array(first) / scale, diff_step=1e-3)
            tries.append((float(found.cost), tuple(found.x * scale)))
        return np.array(min(tries)[1])

    for part in (0, 1):
        test = use & (block != part)
        left[test] = (y - model(fit(use & (block == part)), x))[test]
    return fit(use), float(np.sqrt(np.nanmean(left**2)))


def hysteresis_or_lag(folder: Path) -> Verdict:
    """The leakage peak of up and down sweeps is 2 h + 2 rate tau apart: five periods tell hysteresis h from lag tau."""
    apart = []
    for period in PERIODS:
        i, q = read(folder, f"Leakage_period{period}")
        width = max(len(i) // 60, 3)
        rising = (
            np.gradient(np.convolve(np.pad(i, width, mode="edge"), np.ones(2 * width + 1) / (2 * width + 1), "valid"))
            > 0
        )
        peaks = []
        for side in (rising, ~rising):
            near = side & (q > np.quantile(q[side], 0.97))
            peaks.append(float(np.average(i[near], weights=q[near] - q[near].min() + 1e-12)))
        apart.append(peaks[0] - peaks[1])
    rate = 20.0 / np.array(PERIODS)  # [mA per unit of the period]: +-5 mA triangle
    A = np.column_stack([np.ones(len(rate)), rate])
    found, *_ = np.linalg.lstsq(A, np.array(apart), rcond=None)
    rest = np.array(apart) - A @ found
    error = np.sqrt(np.diag(np.linalg.inv(A.T @ A)) * np.sum(rest**2) / (len(rate) - 2))
    description = f"peaks {', '.join(f'{a:.2f}' for a in apart)} mA apart at periods {PERIODS}: "
    description += f"hysteresis +-{found[0] / 2:.3f} mA "
    description += f"(+-{error[0] / 2:.3f}), lag {found[1] / 2:.2f} (+-{error[1] / 2:.2f}) of the period's unit"
    description += "" if abs(found[0]) > 2 * error[0] else "; hysteresis and lag are not separated"
    numbers = {
        "hysteresis_half_width_mA": found[0] / 2,
        "error_mA": error[0] / 2,
        "lag": found[1] / 2,
        "lag_error": error[1] / 2,
        **{f"peaks_apart_{period}_mA": own for period, own in zip(PERIODS, apart, strict=True)},
    }
    return Verdict(problem="hysteresis or lag", numbers=numbers, description=description)


def one_hysteresis(verdicts: list[Verdict]) -> Verdict:
    """One width for the valve: only the five sweep periods tell it from the meter's lag, h + rate tau.

    A peak's distance is read to a share of itself; the error is a jackknife over the periods.
    """
    numbers = {verdict.problem: verdict.numbers for verdict in verdicts}
    apart = np.array([numbers["hysteresis or lag"][f"peaks_apart_{period}_mA"] for period in PERIODS])
    A = np.column_stack([np.ones(len(apart)), 20.0 / np.array(PERIODS)]) / apart[:, None]
    rows = [np.arange(len(apart)) != k for k in range(len(apart))]
    (width, lag), parts = fitted(A), np.array([fitted(A[use])[0] for use in rows])
    width, lag = 0.5 * width, 0.5 * lag
    error = 0.5 * float(np.sqrt((len(apart) - 1) / len(apart) * np.sum((parts - parts.mean()) ** 2)))
    description = f"+-{width:.3f} +- {error:.3f} mA ({width / 25:.2%} of rated half range) from five sweep periods"
    return Verdict(
        problem="one hysteresis", numbers={"half_width_mA": width, "error_mA": error}, description=description
    )


def fitted(A: np.ndarray) -> np.ndarray:
    """Least squares of A c = 1."""
    return np.linalg.lstsq(A, np.ones(len(A)), rcond=None)[0]


def series(x: np.ndarray, conductance: float, length: float, overlap: float, supply: float = SUPPLY_PSI) -> np.ndarray:
    """Leakage through both lands in series, both ports blocked: laminar clearance model of hexsim.hydraulics.valve."""
    one = np.array([clearance_conductance(v, overlap, conductance, length) for v in x])
    other = np.array([clearance_conductance(-v, overlap, conductance, length) for v in x])
    return 2.0 * supply * one * other / (one + other)


def slow(flow: np.ndarray, samples: float) -> np.ndarray:
    """First-order lag of the flow meter."""
    keep = np.exp(-1.0 / max(samples, 1e-2))
    return lfilter([1 - keep], [1, -keep], flow, zi=[keep * flow[0]])[0]


def null_leakage(folder: Path) -> Verdict:
    """Leakage against current: constant (pilot stage) + laminar clearance model, hysteresis and lag of the meter."""
    i, q = read(folder, "Leakage")
    thin = slice(None, None, 20)
    x, y = i[thin], q[thin]
    use = np.abs(x) < 20.0

    def model(c: np.ndarray, x: np.ndarray) -> np.ndarray:
        return slow(c[0] + series(play(x, c[5]) - c[3], abs(c[1]) * 1e-4, abs(c[2]), 0.0), abs(c[4]))

    constant = held_out(lambda c, x: c[0] + 0 * x, [0.2], x, y, use)[1]
    found, rms = held_out(model, [0.16, 0.7, 0.5, 0.1, 5.0, 0.2], x, y, use, (0.1, 0.3))
    length, conductance = abs(found[2]), abs(found[1]) * 1e-4
    peak = conductance * SUPPLY_PSI
    share = 1 - (rms / constant) ** 2
    description = (
        f"constant {found[0]:.3f} + peak {peak:.3f} gal/min at {found[3]:+.2f} mA, clearance length {length:.2f} mA: "
    )
    description += (
        f"the laminar clearance model explains {share:.0%} of the variation on held-out blocks (rest {rms:.4f} of "
    )
    description += (
        f"{constant:.4f}); one supply pressure only: that the leakage is laminar is not decided by these data"
    )
    numbers = {
        "constant_gpm": found[0],
        "peak_gpm": peak,
        "clearance_length_mA": length,
        "null_mA": found[3],
        "explained": share,
        "hysteresis_half_width_mA": abs(found[5]),
        "lag_samples": 20 * abs(found[4]),
        "conductance_m3_s_Pa": conductance * GPM / PSI,
    }
    return Verdict(problem="null leakage", numbers=numbers, description=description)


def trace(folder: Path) -> list[Verdict]:
    found = [test(folder) for test in (hysteresis_or_lag, null_leakage)]
    return [*found, one_hysteresis(found)]


def main() -> None:
    console = Console()
    try:
        verdicts = trace(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA)
    except HexsimError as error:
        console.print(str(error))
        sys.exit(2)
    for verdict in verdicts:
        console.print(f"[bold]{verdict.problem}[/bold]: {verdict.description}")


if __name__ == "__main__":
    main()
