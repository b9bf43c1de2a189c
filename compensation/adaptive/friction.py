"""Load and friction, identified from pressure: what a motion needs, above all the pressure step at a reversal.

While the piston moves, the bottom pressure balances load, inertia and friction (Eq. 3.8, 3.9). Over windows,

    P1 - Ps A2/A1 = p0 + p1 a + p2 v+ + p3 v- + p4 sign(v) + p5 y

y and a are the mean position and demanded acceleration, v+ and v- the velocity of each direction, from displacements.
At a reversal all terms but the sign are continuous: the pressure must step by 2 p4, whatever mass, geometry and viscous
friction. Stribeck friction near rest is identified apart (stribeck.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..compensator import Context, Parameters, clip
from .recursive_least_squares import RecursiveLeastSquares
from .reference import Reference
from .stribeck import MIN_RATE, StribeckEstimator

MAX_HALF_STEP_MPA = 1.0
DM = 10.0  # [dm/m]
STRIBECK_VELOCITY_M_S = 5e-3  # over which friction falls after breakaway; a common size, and the report's
POSITION_PRIOR = 10.0  # standard deviation of p5 [2 kPa/dm]: load hardly depends on position
TYPICAL_STRIBECK, REVERSALS_NEEDED = 0.5, 5  # P_s over half the step, assumed until so many reversals were seen
MIN_WINDOWS = 20  # in each direction, before the fit is used


@dataclass(slots=True)
class FrictionEstimator:
    """Window sums and the fit; pressures in MPa, lengths in dm inside, so that the numbers are alike."""

    context: Context
    window: int  # ticks
    min_speed_m_s: float
    memory: float  # windows
    fit: RecursiveLeastSquares = field(init=False)
    count: int = 0
    start_m: float = 0.0
    sum_load: float = 0.0
    sum_a: float = 0.0
    windows: list[int] = field(default_factory=lambda: [0, 0])
    half_step_Pa: float = 0.0
    stribeck: StribeckEstimator = field(init=False)
    position_weight: float = field(init=False)

    def __post_init__(self) -> None:
        # prior standard deviations in units of the noise of a window's mean (2 kPa): 1 MPa or 1 MPa per (m/s2, dm/s)
        self.fit = RecursiveLeastSquares([0.0] * 6, [500.0, 500.0, 500.0, 500.0, 250.0, POSITION_PRIOR], self.memory)
        self.stribeck = StribeckEstimator(self.context.tick_s)
        self.position_weight = 1.0 / (POSITION_PRIOR * math.sqrt(self.memory))

    @property
    def ready(self) -> bool:
        """Whether both directions have enough windows."""
        return self.windows[0] >= MIN_WINDOWS and self.windows[1] >= MIN_WINDOWS

    def add(self, position_m: float, load_Pa: float, acceleration_m_s2: float) -> None:
        """One tick: position, P1 - Ps A2/A1 and the demanded acceleration, all of now."""
        if self.count == 0:
            self.start_m, self.sum_load, self.sum_a = position_m, 0.0, 0.0
        self.sum_load += load_Pa
        self.sum_a += acceleration_m_s2
        self.count += 1
        if self.count > self.window:
            self._finish(position_m)
            self.count = 0

    def _finish(self, position_m: float) -> None:
        v = (position_m - self.start_m) / (self.window * self.context.tick_s)
        if abs(v) < self.min_speed_m_s:
            return
        n, up = self.window + 1, 1 if v > 0 else 0
        y = 0.5 * DM * (position_m + self.start_m - self.context.stroke_m)
        v *= DM
        phi = [1.0, self.sum_a / n, v if up else 0.0, 0.0 if up else v, 1.0 if up else -1.0, y]
        self.fit.update(phi, self.sum_load / n * 1e-6)
        self.fit.update([0.0, 0.0, 0.0, 0.0, 0.0, self.position_weight], 0.0)
        self.windows[up] += 1
        self.half_step_Pa = 1e6 * clip(self.fit.theta[4], 0.0, MAX_HALF_STEP_MPA)

    def smooth_Pa(self, position_m: float, velocity_m_s: float, acceleration_m_s2: float) -> float:
        """The fit without its step [Pa]."""
        t = self.fit.theta
        v = DM * velocity_m_s
        y = DM * position_m - 0.5 * DM * self.context.stroke_m
        return 1e6 * (t[0] + t[1] * acceleration_m_s2 + v * (t[2] if v > 0 else t[3]) + t[5] * y)

    def inertia_Pa(self) -> float:
        """p1: pressure for an acceleration of 1 m/s2."""
        return 1e6 * max(self.fit.theta[1], 5e-3)

    def step_acceleration_m_s2(self) -> float:
        """Acceleration that the friction step gives the load while the pressure stands still."""
        return 2 * (self.half_step_Pa + self.stribeck.pressure_Pa) / self.inertia_Pa()

    def resonance_growth_1_s(self) -> float:
        """Growth rate of the hydraulic resonance near rest, where friction falls with speed."""
        viscous = 1e7 * min(self.fit.theta[2], self.fit.theta[3])
        stribeck = self.stribeck.pressure_Pa
        if self.stribeck.reversals < REVERSALS_NEEDED and stribeck < TYPICAL_STRIBECK * self.half_step_Pa:
            stribeck = TYPICAL_STRIBECK * self.half_step_Pa
        return 0.5 * (stribeck / STRIBECK_VELOCITY_M_S - viscous) / self.inertia_Pa()

    def parameters(self) -> Parameters:
        """What was identified, in numbers."""
        return {"theta_MPa": list(self.fit.theta), "windows": list(self.windows), "half_step_Pa": self.half_step_Pa,
                "stribeck_Pa": self.stribeck.pressure_Pa}  # fmt: skip

    def restore(self, known: Parameters) -> None:
        """Start with what was identified before."""
        self.fit.theta[:] = [float(x) for x in known["theta_MPa"]]
        self.windows = [int(x) for x in known["windows"]]
        if self.ready:
            self.fit.covariance = [[0.01 * x for x in row] for row in self.fit.covariance]
            self.stribeck.reversals = round(1.0 / MIN_RATE)
        self.half_step_Pa = float(known["half_step_Pa"])
        self.stribeck.pressure_Pa = float(known["stribeck_Pa"])


def stribeck_share(velocity_m_s: float) -> float:
    """Share of the Stribeck pressure at a velocity, 1 at rest."""
    speed = abs(velocity_m_s)
    return math.exp(-speed / STRIBECK_VELOCITY_M_S) if speed < 4 * STRIBECK_VELOCITY_M_S else 0.0


def demanded_pressure(
    reference: Reference, friction: FrictionEstimator, weight: float, spread: tuple[float, float, float, float]
) -> tuple[float, float]:
    """P1 - Ps A2/A1 [Pa] that the reference needs, and the signed share of the Stribeck pressure in it.

    weight: of friction; spread of its step at a reversal: jerk [m/s3], shortest and longest time [s], velocity [m/s].
    """
    if weight == 0.0:
        return 0.0, 0.0
    v, a = reference.velocity_m_s, reference.acceleration_m_s2
    jerk_m_s3, shortest_s, longest_s, presliding_m_s = spread
    sign = 1.0 if v > 0.0 else -1.0
    if abs(v) < abs(a) * longest_s + presliding_m_s:
        width_s = clip(friction.step_acceleration_m_s2() / jerk_m_s3, shortest_s, longest_s)
        x = v / (abs(a) * width_s + presliding_m_s)
        if -1.0 < x < 1.0:
            sign = x * (2.0 - abs(x))
    share = sign * stribeck_share(v)
    step = sign * friction.half_step_Pa + share * friction.stribeck.pressure_Pa
    return weight * (friction.smooth_Pa(reference.position_m, v, a) + step), share
