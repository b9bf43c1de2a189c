"""A leg on a bench, small and on its own: the report's equations (3.2 to 3.9), so that the compensators' tests need
no simulator.

One vertical leg: spool (second order, or none), backlash before it, overlap or quadratic law, orifice flow, one
chamber, load with Stribeck friction. RK4; volts held over a control tick; noise and quantisation of the transducers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numba as nb
import numpy as np

from compensation import Compensator, Context, Sample, preview_count

AREA_BOTTOM = math.pi / 4 * 0.04**2
AREA_TOP = math.pi / 4 * (0.04**2 - 0.03**2)
GRAVITY = 9.8


@dataclass
class Leg:
    """Parameters of the report's appendix A, and what it leaves out. Changeable during a run, like a real machine."""

    mass_kg: float = 40.0
    density_kg_m3: float = 860.0
    bulk_modulus_Pa: float = 1.5e9
    supply_Pa: float = 7e6
    overlap_m: float = 5e-6
    rounding_m: float = 0.0  # 0 = sharp edges
    quadratic: bool = False  # Eq. 3.11 in place of 3.3
    spool_Hz: float = 60.0  # 0 = none
    backlash_V: float = 0.0  # half width
    friction: float = 1.0  # of the report's
    sharpness_m_s: float = 2e-4  # 0 = arctan(100 v) of Eq. 3.9

    def row(self) -> np.ndarray:
        """Numbers for the compiled equations."""
        return np.array([
            self.mass_kg, self.density_kg_m3, self.bulk_modulus_Pa, self.supply_Pa, self.overlap_m, self.rounding_m,
            float(self.quadratic), 2 * math.pi * self.spool_Hz, self.friction, self.sharpness_m_s,
        ])  # fmt: skip


@nb.njit(cache=True)
def _area(x, p):
    if p[6] == 1.0:
        return 300.0 * x * x if x > 0 else 0.0
    t = x - p[4]
    if p[5] > 0.0:
        return math.pi * 0.01 * p[5] * (t / p[5] if t > 30 * p[5] else math.log1p(math.exp(t / p[5])))
    return math.pi * 0.01 * max(t, 0.0)


@nb.njit(cache=True)
def _rates(s, u, p):
    y, v, pressure, x, w = s
    if p[7] > 0.0:
        dx, dw = w, p[7] * p[7] * (u - x) - 1.4 * p[7] * w
    else:
        dx, dw, x = 0.0, 0.0, u
    spool = x * 1.1e-4
    up, down = p[3] - pressure, pressure
    c = math.pi / (math.pi + 2) * math.sqrt(2 / p[1])
    flow = c * (_area(spool, p) * up / math.sqrt(abs(up) + 1e3) - _area(-spool, p) * down / math.sqrt(abs(down) + 1e3))
    sign = math.atan(100 * v) if p[9] == 0.0 else math.tanh(v / p[9])
    viscous, coulomb = (2200.0, 65.0) if v >= 0 else (1800.0, 60.0)
    friction = p[8] * (viscous * v + sign * (coulomb + 30.0 * math.exp(-abs(v) / 0.005)))
    a = (pressure * 1.2566370614359172e-3 - p[3] * 5.497787143782138e-4 - friction) / p[0] - 9.8
    dp = p[2] / (max(y, 1e-3) * 1.2566370614359172e-3 + 5e-7) * (flow - v * 1.2566370614359172e-3)
    return np.array([v, a, dp, dx, dw])


@nb.njit(cache=True)
def _advance(s, u, p, steps, h, acceleration):
    for i in range(steps):
        k1 = _rates(s, u, p)
        acceleration[i] = k1[1]
        k2 = _rates(s + 0.5 * h * k1, u, p)
        k3 = _rates(s + 0.5 * h * k2, u, p)
        k4 = _rates(s + h * k3, u, p)
        s += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@dataclass
class Record:
    """A run: per tick, and the acceleration every 1e-4 s."""

    time_s: np.ndarray
    position_m: np.ndarray
    valve_V: np.ndarray
    added_V: np.ndarray
    acceleration_m_s2: np.ndarray
    state: object
    statuses: list[tuple[float, str]] = field(default_factory=list)

    def peak(self, start_s: float, stop_s: float, frequency_Hz: float = 0.5, band_Hz: float | None = 50.0) -> float:
        """Largest deviation from the basic harmonic [m/s2]; in the band by a zero-phase 4th-order Butterworth."""
        return float(np.abs(self._deviation(start_s, stop_s, frequency_Hz, band_Hz)).max())

    def _deviation(self, start_s: float, stop_s: float, frequency_Hz: float, band_Hz: float | None) -> np.ndarray:
        from scipy.signal import butter, sosfiltfilt

        a = self.acceleration_m_s2
        t = np.arange(len(a)) * 1e-4
        filtered = a if band_Hz is None else sosfiltfilt(butter(4, band_Hz, fs=1e4, output="sos"), a)
        inside = (t >= start_s) & (t < stop_s)
        w = 2 * math.pi * frequency_Hz * t[inside]
        basis = np.c_[np.ones(inside.sum()), np.sin(w), np.cos(w)]
        return filtered[inside] - basis @ np.linalg.lstsq(basis, a[inside], rcond=None)[0]

    def peaks(self, period_s: float = 2.0, first_s: float = 2.0, band_Hz: float | None = 50.0) -> np.ndarray:
        """The peak of each period."""
        end = len(self.acceleration_m_s2) * 1e-4
        starts = np.arange(first_s, end - period_s + 1e-9, period_s)
        return np.array([self.peak(t, t + period_s, 1 / period_s, band_Hz) for t in starts])


def sine(
    amplitude_m: float = 0.05, frequency_Hz: float = 0.5, fade_s: float = 2.0
) -> Callable[[np.ndarray], np.ndarray]:
    """The report's setpoint (Eq. 3.10), faded in."""
    return lambda t: 0.1 + amplitude_m * np.sin(2 * math.pi * frequency_Hz * t) * np.minimum(t / fade_s, 1.0)


Spoil = Callable[[float, Sample], None]


def run(
    compensator: Compensator,
    leg: Leg | None = None,
    setpoint: Callable[[np.ndarray], np.ndarray] | None = None,
    duration_s: float = 12.0,
    rate_Hz: float = 500.0,
    noise: bool = True,
    period_s: float | None = 2.0,
    change: Callable[[float, Leg], None] | None = None,
    spoil: Spoil | None = None,
    state: object | None = None,
    seed: int = 0,
    velocity_noise_m_s: float = 0.0,
) -> Record:
    """Drive the leg. `change` may alter it each tick, `spoil` the sample; `state` continues what was learned."""
    leg = leg or Leg()
    context = Context(rate_Hz=rate_Hz, period_s=period_s)
    state = compensator.start(context) if state is None else state
    ticks, steps, look = round(duration_s * rate_Hz), round(1e4 / rate_Hz), preview_count(compensator, context)
    wanted = (setpoint or sine())(np.arange(ticks + look) / rate_Hz)
    rng = np.random.default_rng(seed)
    wiggle = rng.normal(0, 1, (ticks, 3)) * ([3e-6, 4e3, 4e3] if noise else [0.0, 0.0, 0.0])
    wiggle[:, 0] += np.cumsum(rng.normal(0, velocity_noise_m_s / rate_Hz, ticks)) if velocity_noise_m_s else 0.0
    s = np.array([0.1, 0.0, (leg.supply_Pa * AREA_TOP + leg.mass_kg * GRAVITY) / AREA_BOTTOM, 0.0, 0.0])
    position, valve, added = np.zeros(ticks), np.zeros(ticks), np.zeros(ticks)
    acceleration, follower, sent, row = np.zeros(ticks * steps), 0.0, 0.0, leg.row()
    statuses: list[tuple[float, str]] = []
    for k in range(ticks):
        if change is not None:
            change(k / rate_Hz, leg)
            row = leg.row()
        y = s[0] + wiggle[k, 0]
        y = round(y / 3e-6) * 3e-6 if noise else y
        here, ahead = float(wanted[k]), wanted[k : k + look]
        pressures = float(s[2] + wiggle[k, 1]), float(leg.supply_Pa + wiggle[k, 2])
        sample = Sample(k / rate_Hz, here, ahead, float(y), 50.0 * (here - float(y)), sent, *pressures)
        if spoil is not None:
            spoil(k / rate_Hz, sample)
        more, state = compensator.step(state, sample)
        if (text := compensator.status(state)) != (statuses[-1][1] if statuses else ""):
            statuses.append((k / rate_Hz, text))
        total = sample.control_V + more
        sent = min(max(total, -10.0), 10.0) if math.isfinite(total) else 0.0
        follower = min(max(follower, sent - leg.backlash_V), sent + leg.backlash_V)
        position[k], valve[k], added[k] = s[0], sent, more
        _advance(s, follower, row, steps, 1e-4, acceleration[k * steps : (k + 1) * steps])
    return Record(np.arange(ticks) / rate_Hz, position, valve, added, acceleration, state, statuses)
