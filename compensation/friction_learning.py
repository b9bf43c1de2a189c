"""The pressure that a motion needs, and above all its step at a reversal, learned from pressures on both sides of
reversals.

While the piston moves, the bottom pressure carries load, inertia and friction (Eq. 3.8, 3.9). Over windows,

    P1 - Ps A2/A1 = p0 + p1 a + p2 v+ + p3 v- + p4 sign(v) + p5 y

y and a the mean position and wanted acceleration, v+ and v- the velocity of each direction, from displacements. At a
reversal all terms but the sign are continuous: the pressure must step by 2 p4, whatever mass, geometry and viscous
friction. Close to rest friction rises (Stribeck): rise.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .base import Context, Parameters, clip
from .least_squares import RecursiveLeastSquares
from .rise import RATE_LOW, Rise

STEP_HIGH_MPA = 1.0  # bound of what is believed of half the step
STRIBECK_M_S = 5e-3  # velocity over which friction falls after breakaway; a common size, and the report's
POSITION_SPREAD = 10.0  # of the position's coefficient p5 [2 kPa/dm]: load hardly depends on position
RISE_TYPICAL, REVERSALS_NEEDED = 0.5, 5  # rise over half the step, as long as so few reversals have told of it
WINDOWS_NEEDED = 20  # in each direction, before the fit is used


@dataclass(slots=True)
class FrictionLearner:
    """Window sums and the fit; pressures in MPa, lengths in dm inside, so that the numbers are alike."""

    context: Context
    window: int  # ticks
    slowest_m_s: float
    memory: float  # windows
    fit: RecursiveLeastSquares = field(init=False)
    count: int = 0
    start_m: float = 0.0
    sum_load: float = 0.0
    sum_a: float = 0.0
    windows: list[int] = field(default_factory=lambda: [0, 0])
    half_step_Pa: float = 0.0
    rise: Rise = field(init=False)
    position_weight: float = field(init=False)

    def __post_init__(self) -> None:
        # spreads in units of the noise of a window's mean (2 kPa): 1 MPa or 1 MPa per (m/s2, dm/s)
        self.fit = RecursiveLeastSquares([0.0] * 6, [500.0, 500.0, 500.0, 500.0, 250.0, POSITION_SPREAD], self.memory)
        self.rise = Rise(self.context.tick_s)
        self.position_weight = 1.0 / (POSITION_SPREAD * math.sqrt(self.memory))

    @property
    def ready(self) -> bool:
        """Whether both directions were seen often enough."""
        return self.windows[0] >= WINDOWS_NEEDED and self.windows[1] >= WINDOWS_NEEDED

    def add(self, position_m: float, load_Pa: float, acceleration_m_s2: float) -> None:
        """One tick: position, P1 - Ps A2/A1 and the wanted acceleration, all of now."""
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
        if abs(v) < self.slowest_m_s:
            return
        n, up = self.window + 1, v > 0
        y = 5 * (position_m + self.start_m - self.context.stroke_m)
        v *= 10
        phi = [1.0, self.sum_a / n, v if up else 0.0, 0.0 if up else v, 1.0 if up else -1.0, y]
        self.fit.update(phi, self.sum_load / n * 1e-6)
        self.fit.update([0.0, 0.0, 0.0, 0.0, 0.0, self.position_weight], 0.0)
        self.windows[up] += 1
        self.half_step_Pa = 1e6 * clip(self.fit.theta[4], 0.0, STEP_HIGH_MPA)

    def smooth_Pa(self, position_m: float, velocity_m_s: float, acceleration_m_s2: float) -> float:
        """The fit without its step."""
        t = self.fit.theta
        v = 10 * velocity_m_s
        y = 10 * position_m - 5 * self.context.stroke_m
        return 1e6 * (t[0] + t[1] * acceleration_m_s2 + v * (t[2] if v > 0 else t[3]) + t[5] * y)

    def inertia_Pa(self) -> float:
        """p1: pressure for an acceleration of 1 m/s2."""
        return 1e6 * max(self.fit.theta[1], 5e-3)

    def jolt_m_s2(self) -> float:
        """Acceleration that friction's step would give the load, were the pressure to stand still."""
        return 2 * (self.half_step_Pa + self.rise.rise_Pa) / self.inertia_Pa()

    def growth_1_s(self) -> float:
        """Rate at which a swing grows close to rest, where friction falls with speed."""
        viscous = 1e7 * min(self.fit.theta[2], self.fit.theta[3])
        rise = self.rise.rise_Pa
        if self.rise.reversals < REVERSALS_NEEDED and rise < RISE_TYPICAL * self.half_step_Pa:
            rise = RISE_TYPICAL * self.half_step_Pa
        return 0.5 * (rise / STRIBECK_M_S - viscous) / self.inertia_Pa()

    def parameters(self) -> Parameters:
        """What is known, in numbers."""
        return {"theta_MPa": list(self.fit.theta), "windows": list(self.windows), "half_step_Pa": self.half_step_Pa,
                "rise_Pa": self.rise.rise_Pa}  # fmt: skip

    def restore(self, known: Parameters) -> None:
        """Start with what was known before."""
        self.fit.theta[:] = [float(x) for x in known["theta_MPa"]]
        self.windows = [int(x) for x in known["windows"]]
        if self.ready:
            self.fit.covariance = [[0.01 * x for x in row] for row in self.fit.covariance]
            self.rise.reversals = round(1.0 / RATE_LOW)
        self.half_step_Pa = float(known["half_step_Pa"])
        self.rise.rise_Pa = float(known["rise_Pa"])


def stribeck_part(velocity_m_s: float) -> float:
    """Share of the rise at a velocity, 1 at rest."""
    speed = abs(velocity_m_s)
    return math.exp(-speed / STRIBECK_M_S) if speed < 4 * STRIBECK_M_S else 0.0
