"""A valve's flow curve as a table, and its inverse.

The valve's volume flow divided by the piston area is the velocity of the piston while the pressure stands still
(report 5.2). For one edge it is proportional to the root of the pressure drop, so one curve a direction at a
reference drop holds for all pressures:

    v = g(u) sqrt(dp / dp_ref),   dp = Ps - P1 for u > 0,   P1 - Pt for u < 0        (Eq. 5.1, corrected)
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

DISCHARGE_COEFFICIENT = math.pi / (math.pi + 2)  # report appendix A


AREA_BOTTOM_M2 = math.pi / 4 * 0.04**2  # report appendix A
TRAVEL_m_V = 1.1e-3 / 10.0  # of the spool, report appendix A


@dataclass(frozen=True)
class FlowCurve:
    """Piecewise linear, monotone, odd-sided curve: volts (n,) increasing, velocity [m/s] (n,) non-decreasing."""

    voltage_V: tuple[float, ...]
    velocity_m_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.voltage_V) != len(self.velocity_m_s) or len(self.voltage_V) < 2:
            raise ValueError("a flow curve needs as many velocities as volts, two at least: check the two lists")
        if not all(math.isfinite(x) for x in (*self.voltage_V, *self.velocity_m_s)):
            raise ValueError("a flow curve holds a value that is not finite: check the two lists")
        pairs = zip(self.voltage_V, self.voltage_V[1:], self.velocity_m_s, self.velocity_m_s[1:], strict=False)
        if any(u1 <= u0 or v1 < v0 for u0, u1, v0, v1 in pairs):
            raise ValueError(
                "a flow curve must have increasing volts and velocities that never fall: sort the two lists by volts"
            )

    def velocity(self, voltage_V: float) -> float:
        """Velocity [m/s] at the reference pressure drop; straight on beyond the ends."""
        return _interpolate(voltage_V, self.voltage_V, self.velocity_m_s)

    def voltage(self, velocity_m_s: float) -> float:
        """Volts for a velocity at the reference drop; across the overlap, where many would do, the one nearest its
        end."""
        return _interpolate(velocity_m_s, self.velocity_m_s, self.voltage_V)


def _interpolate(x: float, xs: tuple[float, ...], ys: tuple[float, ...]) -> float:
    i = min(max(bisect_right(xs, x) - 1, 0), len(xs) - 2)
    while xs[i + 1] == xs[i] and i > 0:
        i -= 1
    if xs[i + 1] == xs[i]:
        return ys[i]
    return ys[i] + (ys[i + 1] - ys[i]) * (x - xs[i]) / (xs[i + 1] - xs[i])


def overlap_curve(overlap_m: float = 5e-6, pressure_drop_Pa: float = 3.5e6, voltage_max_V: float = 10.0) -> FlowCurve:
    """Curve of the report's valve with a(x) = pi d (x - O_l) (Eq. 3.3) at one pressure drop."""
    dead, spool_diameter_m = overlap_m / TRAVEL_m_V, 0.01  # report appendix A
    gain = math.pi * spool_diameter_m * TRAVEL_m_V * _speed(pressure_drop_Pa)
    end = gain * (voltage_max_V - dead)
    if dead == 0.0:
        return FlowCurve((-voltage_max_V, voltage_max_V), (-end, end))
    return FlowCurve((-voltage_max_V, -dead, dead, voltage_max_V), (-end, 0.0, 0.0, end))


def quadratic_curve(pressure_drop_Pa: float = 3.5e6, voltage_max_V: float = 10.0, knots: int = 401) -> FlowCurve:
    """Curve of the report's smooth valve, a(x) = 300 x^2 (Eq. 3.11, 5.1), knots dense around zero."""
    gain = 300.0 * TRAVEL_m_V**2 * _speed(pressure_drop_Pa)
    half = [voltage_max_V * (i / (knots // 2)) ** 2 for i in range(knots // 2 + 1)]
    volts = [-u for u in reversed(half[1:])] + half
    return FlowCurve(tuple(volts), tuple(math.copysign(gain * u * u, u) for u in volts))


def _speed(pressure_drop_Pa: float, oil_density_kg_m3: float = 860.0) -> float:
    """Piston velocity [m/s] per flow area [m2]; the density of report appendix A."""
    return DISCHARGE_COEFFICIENT * math.sqrt(2 * pressure_drop_Pa / oil_density_kg_m3) / AREA_BOTTOM_M2
