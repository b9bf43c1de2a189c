"""Setpoints of the grid, about mid-stroke, faded in over 2 s: 0.1 m + offsets within +-0.09 m."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

MIDDLE_m, FADE_S = 0.1, 2.0
RIDE, RIDE_HZ, RIDE_s = Path(__file__).with_name("ride.csv"), 50.0, 28.0
Setpoint = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Motion:
    """A setpoint [m] over time [s]; period_s: as a signal generator knows it, None where there is none."""

    name: str
    path: Setpoint
    duration_s: float
    period_s: float | None = None

    def sampled(self, ticks: int, rate_Hz: float = 500.0) -> np.ndarray:
        """(ticks,) setpoints."""
        return self.path(np.arange(ticks) / rate_Hz)

    def reversals(self, rate_Hz: float = 500.0) -> np.ndarray:
        """Instants [s] at which the commanded motion turns, after the fade-in."""
        t = np.arange(0.0, self.duration_s, 1.0 / rate_Hz)
        v = np.diff(self.path(t))
        turns = t[1:-1][np.signbit(v[1:]) != np.signbit(v[:-1])]
        return turns[(turns > FADE_S) & (turns < self.duration_s - 0.6)]


def faded(offset: Setpoint) -> Setpoint:
    return lambda t: (
        MIDDLE_m
        + np.clip(np.asarray(t) / FADE_S, 0.0, 1.0) ** 2
        * (3.0 - 2.0 * np.clip(np.asarray(t) / FADE_S, 0.0, 1.0))
        * offset(np.asarray(t))
    )


def tones(amplitudes: np.ndarray, frequencies: np.ndarray, seed: int) -> Setpoint:
    """A sum of sines with drawn phases."""
    phases = np.random.default_rng([seed, 7]).uniform(0.0, 2.0 * math.pi, len(frequencies))
    return lambda t: (amplitudes[:, None] * np.sin(2.0 * math.pi * np.outer(frequencies, t) + phases[:, None])).sum(0)


def limited(offset: Setpoint, duration_s: float, largest_m: float, fastest_m_s: float) -> Setpoint:
    """Scaled so that neither the offset nor the speed is beyond its limit."""
    t = np.arange(0.0, duration_s + 0.2, 2e-3)
    x = offset(t)
    scale = min(largest_m / np.abs(x).max(), fastest_m_s / np.abs(np.gradient(x, t)).max())
    return lambda t: scale * offset(t)


def sine(seed: int) -> Motion:
    """The report's, 0.05 m at 0.5 Hz."""
    return Motion("sine", faded(lambda t: 0.05 * np.sin(math.pi * t)), 28.0, 2.0)


def multisine(seed: int) -> Motion:
    """Five sines of 0.13 to 0.97 Hz."""
    f = np.array([0.13, 0.31, 0.47, 0.71, 0.97])
    return Motion("multisine", faded(limited(tones(f**-0.8, f, seed), 28.0, 0.07, 0.2)), 28.0)


def irregular(seed: int) -> Motion:
    """Twelve sines up to 3.1 Hz, of nearly even acceleration."""
    f = np.array([0.17, 0.29, 0.43, 0.61, 0.83, 1.07, 1.33, 1.61, 1.93, 2.29, 2.71, 3.1])
    return Motion("irregular", faded(limited(tones(f**-1.6, f, seed), 28.0, 0.06, 0.2)), 28.0)


def slow(seed: int) -> Motion:
    """0.05 and 0.12 Hz."""
    f = np.array([0.05, 0.12])
    return Motion("slow", faded(limited(tones(np.array([1.0, 0.5]), f, seed), 40.0, 0.07, 0.04)), 40.0)


@cache
def strokes() -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and offsets (n, 6) [m] of ride.csv."""
    offsets = 1e-6 * np.loadtxt(RIDE, delimiter=",")
    return np.arange(len(offsets)) / RIDE_HZ, offsets


def ride(seed: int) -> Motion:
    """A leg of a hexapod that follows a light aircraft in rough air (ride.py), begun at a drawn instant."""
    time, offsets = strokes()
    random = np.random.default_rng([seed, 11])
    leg, first_s = int(random.integers(6)), float(random.uniform(0.0, time[-1] - RIDE_s - 1.0))
    spline = CubicSpline(time, offsets[:, leg])
    return Motion("ride", faded(lambda t: spline(first_s + t)), RIDE_s)


MOTIONS: dict[str, Callable[[int], Motion]] = {
    "sine": sine,
    "multisine": multisine,
    "irregular": irregular,
    "slow": slow,
    "ride": ride,
}


def motion_of(name: str, seed: int) -> Motion:
    """The motion of a name; the seed draws its phases, or its part of the ride. ValueError for a name that is none."""
    if name not in MOTIONS:
        raise ValueError(f"no motion is called {name!r}: give one of {', '.join(MOTIONS)}")
    return MOTIONS[name](seed)
