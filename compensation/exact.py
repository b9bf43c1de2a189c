# pyright: reportPrivateImportUsage=false
# (numba does not list its own functions)
"""The exact look-up inverse of a flow curve that is known (report 5.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np

from .arithmetic import clip
from .compensator import Context, Parameters
from .compiled import compiled
from .flow_curve import FlowCurve, overlap_curve
from .rows import RowCompensator, RowState, all_are_finite


class E(IntEnum):
    """Places in a row."""

    TICK = 0  # [s]
    LIMIT = 1  # [V]
    SUPPLY = 2  # [Pa]
    TANK = 3
    SLOPE = 4  # [m/s/V]
    REFERENCE = 5  # dp_ref [Pa]
    SCHEDULE = 6  # 1: scheduled on the pressure
    WIDTH = 7  # [V]
    FADE = 8  # [s]
    PRESSURE_SHARE = 9  # of the slow mean, a tick
    PRESSURE = 10  # slow mean of P1, 0 before the first reading
    GAIN = 11  # fade-in, 0 .. 1
    CURVE = 12  # volts, and behind them velocities


@dataclass(frozen=True, kw_only=True)
class Exact(RowCompensator):
    """Inverse of a known flow curve, scheduled on the measured pressure drop (report 5.2).

        u_c = g^-1(s u sqrt(dp_ref / dp)) - u

    u is the control voltage, s the slope of the desired linear valve, g the flow curve at the reference drop. It is
    exact only for the machine whose curve it is given (the default is the report's valve, Eq. 3.3). It knows neither
    spool lag nor friction.

    slope_m_s_V: None takes the slope at the curve's far end, so that the position loop keeps its gain at large volts.
    fade_s: fade-in time. schedule: False takes the curve as it stands, at any pressure drop. width_V: control voltage
    over which the step across the overlap is spread; wider is softer and less exact.
    """

    name: str = "exact"
    place = 1
    curve: FlowCurve = field(default_factory=overlap_curve)
    reference_drop_Pa: float = 3.5e6
    slope_m_s_V: float | None = None
    schedule: bool = True
    width_V: float = 1e-3
    fade_s: float = 1.0
    pressure_bandwidth_Hz: float = 5.0

    def new_row(self, context: Context) -> np.ndarray:
        volts, velocities = self.curve.voltage_V, self.curve.velocity_m_s
        row = np.concatenate([np.zeros(E.CURVE), volts, velocities])
        row[E.TICK], row[E.LIMIT], row[E.FADE] = context.tick_s, context.voltage_max_V, self.fade_s
        row[E.SUPPLY], row[E.TANK] = context.supply_pressure_Pa, context.tank_pressure_Pa
        row[E.REFERENCE], row[E.SCHEDULE], row[E.WIDTH] = self.reference_drop_Pa, self.schedule, self.width_V
        row[E.SLOPE] = (velocities[-1] - velocities[-2]) / (volts[-1] - volts[-2])
        if self.slope_m_s_V is not None:
            row[E.SLOPE] = self.slope_m_s_V
        row[E.PRESSURE_SHARE] = 2 * math.pi * self.pressure_bandwidth_Hz * context.tick_s
        return row

    def functions(self) -> tuple[Any, Any]:
        return tick, is_sound

    def parameters(self, state: RowState) -> Parameters:
        return {"voltage_V": list(self.curve.voltage_V), "velocity_m_s": list(self.curve.velocity_m_s)}

    def restore(self, context: Context, parameters: Parameters) -> RowState:
        return self.start(context)


@compiled
def tick(row, control_V, valve_V, position_m, bottom_Pa):
    """Volts to add."""
    u = control_V
    if not math.isfinite(u):
        return 0.0
    row[E.GAIN] = min(1.0, row[E.GAIN] + row[E.TICK] / max(row[E.FADE], row[E.TICK]))
    velocity = row[E.SLOPE] * u * root(row, u, bottom_Pa)
    return row[E.GAIN] * clip(spread_step(row, u, velocity) - u, -row[E.LIMIT], row[E.LIMIT])


@compiled
def root(row, control_V, bottom_Pa):
    """sqrt(dp_ref / dp) of the edge that the control voltage opens, from a slow mean of the pressure."""
    reference = row[E.REFERENCE]
    if row[E.SCHEDULE] == 0.0:
        return 1.0
    if row[E.PRESSURE] == 0.0:
        row[E.PRESSURE] = bottom_Pa if math.isfinite(bottom_Pa) else reference
    elif math.isfinite(bottom_Pa):
        row[E.PRESSURE] += row[E.PRESSURE_SHARE] * (bottom_Pa - row[E.PRESSURE])
    drop = row[E.SUPPLY] - row[E.PRESSURE] if control_V > 0.0 else row[E.PRESSURE] - row[E.TANK]
    return math.sqrt(reference / max(drop, 0.05 * reference))


@compiled
def spread_step(row, u, velocity):
    """Volts for a velocity; the step across the overlap is spread over the width."""
    if abs(u) >= row[E.WIDTH]:
        return inverse(row, velocity)
    if u == 0.0:
        return 0.0
    edge = math.copysign(row[E.WIDTH], u)
    return inverse(row, velocity * edge / u) * u / edge


@compiled
def inverse(row, velocity):
    """Volts for a velocity at the reference drop, as `FlowCurve.voltage`."""
    knots = (len(row) - E.CURVE) // 2
    volts, velocities = row[E.CURVE : E.CURVE + knots], row[E.CURVE + knots :]
    low, high = 0, knots
    while low < high:  # the first velocity that is larger
        middle = (low + high) // 2
        if velocity < velocities[middle]:
            high = middle
        else:
            low = middle + 1
    i = min(max(low - 1, 0), knots - 2)
    while velocities[i + 1] == velocities[i] and i > 0:
        i -= 1
    if velocities[i + 1] == velocities[i]:
        return volts[i]
    return volts[i] + (volts[i + 1] - volts[i]) * (velocity - velocities[i]) / (velocities[i + 1] - velocities[i])


@compiled
def is_sound(row):
    """Whether the slow mean and the fade-in are finite."""
    return all_are_finite(row, E.PRESSURE, E.CURVE)
