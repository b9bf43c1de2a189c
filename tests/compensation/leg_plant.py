"""A leg on a bench, small and on its own: the report's equations (3.2 to 3.9), so that the compensators' tests need
no simulator.

One vertical leg: spool (second order, or none), backlash before it, overlap or quadratic law, orifice flow, one chamber,
load with Stribeck friction. And what real machines add: delays of any length, leaks, a null offset and its drift,
presliding (LuGre), entrained air, transducer ripple, seal friction, a supply that droops, back pressure in the tank
line, a worn spot of the bore, friction that falls as it warms. RK4; volts held over a control tick; noise and
quantisation of the transducers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, field

import numba as nb
import numpy as np

from compensation import Compensator, Context, Sample, preview_count

AREA_BOTTOM = math.pi / 4 * 0.04**2
AREA_TOP = math.pi / 4 * (0.04**2 - 0.03**2)
GRAVITY = 9.8
STEP_S = 1e-4


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
    leak_supply_m3_s_Pa: float = 0.0  # supply to chamber, laminar
    leak_tank_m3_s_Pa: float = 0.0  # chamber to tank, laminar
    null_V: float = 0.0  # added to the volts before the spool
    bristle_N_m: float = 0.0  # presliding stiffness; 0 = none, friction by `sharpness_m_s`
    air: float = 0.0  # volume fraction of undissolved air at 1 bar
    seal_N_Pa: float = 0.0  # Coulomb friction for chamber pressure
    line_Pa_s_m3: float = 0.0  # laminar resistance of the pump line, before an accumulator of 6e-12 m3/Pa
    tank_line_Pa_s_m3: float = 0.0  # laminar resistance of the return line
    worn_m3_s_Pa: float = 0.0  # leak past the piston to tank at mid-stroke, over +-20 mm
    port_ratio: float = 0.0  # ports: gain of the supply edge over the tank edge, less 1
    spring_N_m: float = 0.0  # about mid-stroke
    valve_delay_s: float = 0.0  # of the volts: valve or computing
    position_delay_s: float = 0.0
    drift_V_s: float = 0.0  # of the null
    warm_up: float = 0.0  # friction lost with a time constant of 20 s
    ripple_m: float = 0.0  # amplitude of the position transducer's, over 2 mm
    volts_count_V: float = 0.0  # of the converter; 0 = none

    def row(self) -> np.ndarray:
        """Numbers for the compiled equations, in the order of the fields up to `spring_N_m`."""
        return np.array(astuple(self)[:22], dtype=float)

    def state(self) -> np.ndarray:
        """At rest: y, v, P1, spool [V] and its rate, bristle [m], Ps."""
        p1 = (self.supply_Pa * AREA_TOP + self.mass_kg * GRAVITY) / AREA_BOTTOM
        return np.array([0.1, 0.0, p1, self.null_V, 0.0, 0.0, self.supply_Pa])


fast = nb.njit(cache=True, _nrt=False)  # makes no arrays, so that no owner need be counted


@fast
def _area(x, p):
    if p[6] == 1.0:
        return 300.0 * x * x if x > 0 else 0.0
    t = x - p[4]
    if p[5] > 0.0:
        return math.pi * 0.01 * p[5] * (t / p[5] if t > 30 * p[5] else math.log1p(math.exp(t / p[5])))
    return math.pi * 0.01 * max(t, 0.0)


@fast
def _rates(s, u, p, out):
    y, v, pressure, x, supply = s[0], s[1], s[2], s[3], s[6]
    u += p[13]
    if p[7] > 0.0:
        w = 2 * math.pi * p[7]
        out[3], out[4] = s[4], w * w * (u - x) - 1.4 * w * s[4]
    else:
        out[3], out[4], x = 0.0, 0.0, u
    spool = x * 1.1e-4
    c = math.pi / (math.pi + 2) * math.sqrt(2 / p[1])
    up = supply - pressure
    inflow = c * (1.0 + p[20]) * _area(spool, p) * up / math.sqrt(abs(up) + 1e3)
    orifice = c * _area(-spool, p)
    outflow = orifice * pressure / math.sqrt(abs(pressure) + 1e3)
    for _ in range(3 if p[18] > 0.0 else 0):  # back pressure of the return line, by iteration
        down = pressure - p[18] * outflow
        outflow = orifice * down / math.sqrt(abs(down) + 1e3)
    worn = (y - 0.1) / 0.02
    leak = p[11] * up - p[12] * pressure - p[19] * math.exp(-worn * worn) * pressure
    viscous, coulomb = (2200.0, 65.0) if v >= 0 else (1800.0, 60.0)
    coulomb += p[16] * pressure
    level = coulomb + 30.0 * math.exp(-abs(v) / 0.005)
    if p[14] > 0.0:
        out[5] = v - p[14] * abs(v) * s[5] / (p[9] * level)
        friction = p[14] * s[5] + 1e3 * out[5] + p[9] * viscous * v
    else:
        out[5] = 0.0
        sign = math.atan(100 * v) if p[10] == 0.0 else math.tanh(v / p[10])
        friction = p[9] * (viscous * v + sign * level)
    force = pressure * 1.2566370614359172e-3 - supply * 5.497787143782138e-4 - friction - p[21] * (y - 0.1)
    out[0], out[1] = v, force / p[0] - 9.8
    compliance = (1.0 - p[15]) / p[2] + p[15] * 1e5 / (max(pressure, 1e5) * max(pressure, 1e5))
    volume = max(y, 1e-3) * 1.2566370614359172e-3 + 5e-7
    out[2] = (inflow - outflow + leak - v * 1.2566370614359172e-3) / (volume * compliance)
    out[6] = ((p[3] - supply) / p[17] - inflow) / 6e-12 if p[17] > 0.0 else 0.0


@fast
def _towards(s, h, slope, out):
    for j in range(7):
        out[j] = s[j] + h * slope[j]


@fast
def _advance(s, volts, p, h, position, acceleration, space):
    k1, k2, k3, k4, there = space[0], space[1], space[2], space[3], space[4]
    parts = 1 if p[14] == 0.0 else 4  # stiff bristles
    h /= parts
    for i in range(len(volts)):
        u = volts[i]
        if p[17] == 0.0:
            s[6] = p[3]
        position[i] = s[0]
        for part in range(parts):
            _rates(s, u, p, k1)
            if part == 0:
                acceleration[i] = k1[1]
            _towards(s, 0.5 * h, k1, there)
            _rates(there, u, p, k2)
            _towards(s, 0.5 * h, k2, there)
            _rates(there, u, p, k3)
            _towards(s, h, k3, there)
            _rates(there, u, p, k4)
            for j in range(7):
                s[j] += h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j])


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
    known: dict = field(default_factory=dict)  # what the compensator has learned
    bands: dict[float, np.ndarray] = field(default_factory=dict)

    def peak(self, start_s: float, stop_s: float, frequency_Hz: float = 0.5, band_Hz: float | None = 50.0) -> float:
        """Largest deviation from the fundamental [m/s2]; in the band by a zero-phase 4th-order Butterworth."""
        return float(np.abs(self._deviation(start_s, stop_s, frequency_Hz, band_Hz)).max())

    def _deviation(self, start_s: float, stop_s: float, frequency_Hz: float, band_Hz: float | None) -> np.ndarray:
        t = np.arange(len(self.acceleration_m_s2)) * 1e-4
        inside = (t >= start_s) & (t < stop_s)
        w = 2 * math.pi * frequency_Hz * t[inside]
        basis = np.c_[np.ones(inside.sum()), np.sin(w), np.cos(w)]
        fundamental = basis @ np.linalg.lstsq(basis, self.acceleration_m_s2[inside], rcond=None)[0]
        return self._filtered(band_Hz)[inside] - fundamental

    def _filtered(self, band_Hz: float | None) -> np.ndarray:
        """The acceleration in a band, filtered once."""
        from scipy.signal import butter, sosfiltfilt

        if band_Hz is None:
            return self.acceleration_m_s2
        if band_Hz not in self.bands:
            self.bands[band_Hz] = sosfiltfilt(butter(4, band_Hz, fs=1e4, output="sos"), self.acceleration_m_s2)
        return self.bands[band_Hz]

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
    ticks, steps, look = round(duration_s * rate_Hz), round(1 / STEP_S / rate_Hz), preview_count(compensator, context)
    wanted = (setpoint or sine())(np.arange(ticks + look) / rate_Hz)
    rng = np.random.default_rng(seed)
    wiggle = rng.normal(0, 1, (ticks, 3)) * ([3e-6, 4e3, 4e3] if noise else [0.0, 0.0, 0.0])
    wiggle[:, 0] += np.cumsum(rng.normal(0, velocity_noise_m_s / rate_Hz, ticks)) if velocity_noise_m_s else 0.0
    s, space = leg.state(), np.zeros((5, 7))
    position, valve, added = np.zeros(ticks), np.zeros(ticks), np.zeros(ticks)
    acceleration, true_m = np.zeros(ticks * steps), np.full(ticks * steps + 1, s[0])
    arriving, late = np.zeros(ticks * steps + 1000), round(leg.valve_delay_s / STEP_S)  # volts before the play, late
    follower, sent, row = 0.0, 0.0, leg.row()
    ripple, back = 2 * math.pi / 2e-3, leg.position_delay_s / STEP_S
    statuses: list[tuple[float, str]] = []
    for k in range(ticks):
        time_s, now = k / rate_Hz, slice(k * steps, (k + 1) * steps)
        if change is not None:
            change(time_s, leg)
            row = leg.row()
        row[13] = leg.null_V + leg.drift_V_s * time_s
        row[9] = leg.friction * (1.0 - leg.warm_up * (1.0 - math.exp(-time_s / 20.0)))
        true_m[k * steps] = s[0]
        first, share = divmod(max(k * steps - back, 0.0), 1.0)
        y = (1.0 - share) * true_m[int(first)] + share * true_m[int(first) + 1] if share else true_m[int(first)]
        y += leg.ripple_m * math.sin(ripple * y) + wiggle[k, 0]
        y = round(y / 3e-6) * 3e-6 if noise else y
        here, ahead = float(wanted[k]), wanted[k : k + look]
        pressures = float(s[2] + wiggle[k, 1]), float(s[6] + wiggle[k, 2])
        sample = Sample(time_s, here, ahead, float(y), 50.0 * (here - float(y)), sent, *pressures)
        if spoil is not None:
            spoil(time_s, sample)
        more, state = compensator.step(state, sample)
        if (text := compensator.status(state)) != (statuses[-1][1] if statuses else ""):
            statuses.append((time_s, text))
        total = sample.control_V + more
        sent = min(max(total, -10.0), 10.0) if math.isfinite(total) else 0.0
        sent = round(sent / leg.volts_count_V) * leg.volts_count_V if leg.volts_count_V else sent
        follower = min(max(follower, sent - leg.backlash_V), sent + leg.backlash_V)
        arriving[k * steps + late : (k + 1) * steps + late] = follower
        position[k], valve[k], added[k] = s[0], sent, more
        _advance(s, arriving[now], row, STEP_S, true_m[now], acceleration[now], space)
    return Record(
        np.arange(ticks) / rate_Hz, position, valve, added, acceleration, state, statuses, compensator.parameters(state)
    )
