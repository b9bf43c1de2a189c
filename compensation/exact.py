"""The exact look-up inverse of a flow curve that is known (report 5.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .compensator import Compensator, Context, Parameters, Sample, clip
from .flow_curve import FlowCurve, overlap_curve


@dataclass(slots=True)
class ExactState:
    context: Context
    pressure_Pa: float | None = None  # slow mean of P1
    gain: float = 0.0  # fade-in, 0 .. 1


@dataclass(frozen=True, kw_only=True)
class Exact(Compensator):
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

    def start(self, context: Context) -> ExactState:
        return ExactState(context)

    def step(self, state: ExactState, sample: Sample) -> tuple[float, ExactState]:
        context, u = state.context, sample.control_V
        if not math.isfinite(u):
            return 0.0, state
        state.gain = min(1.0, state.gain + context.tick_s / max(self.fade_s, context.tick_s))
        velocity = self._slope() * u * self._root(state, sample)
        return state.gain * clip(self._volts(u, velocity) - u, -context.voltage_max_V, context.voltage_max_V), state

    def _slope(self) -> float:
        if self.slope_m_s_V is not None:
            return self.slope_m_s_V
        (u0, u1), (v0, v1) = self.curve.voltage_V[-2:], self.curve.velocity_m_s[-2:]
        return (v1 - v0) / (u1 - u0)

    def _root(self, state: ExactState, sample: Sample) -> float:
        """sqrt(dp_ref / dp) of the edge that the control voltage opens, from a slow mean of the pressure."""
        if not self.schedule:
            return 1.0
        context, p = state.context, sample.pressure_bottom_Pa
        if state.pressure_Pa is None:
            state.pressure_Pa = p if math.isfinite(p) else self.reference_drop_Pa
        elif math.isfinite(p):
            state.pressure_Pa += 2 * math.pi * self.pressure_bandwidth_Hz * context.tick_s * (p - state.pressure_Pa)
        if sample.control_V > 0:
            drop = context.supply_pressure_Pa - state.pressure_Pa
        else:
            drop = state.pressure_Pa - context.tank_pressure_Pa
        return math.sqrt(self.reference_drop_Pa / max(drop, 0.05 * self.reference_drop_Pa))

    def _volts(self, u: float, velocity: float) -> float:
        if abs(u) >= self.width_V:
            return self.curve.voltage(velocity)
        edge = math.copysign(self.width_V, u)
        return self.curve.voltage(velocity * edge / u) * u / edge if u else 0.0

    def parameters(self, state: ExactState) -> Parameters:
        return {"voltage_V": list(self.curve.voltage_V), "velocity_m_s": list(self.curve.velocity_m_s)}

    def restore(self, context: Context, parameters: Parameters) -> ExactState:
        return self.start(context)
