"""What a balance is, and the measured point that the balances of a hydraulic leg share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics import valve
from hexsim.hydraulics.compiled import compiled
from hexsim.hydraulics.parameters import P
from hexsim.machine.declaration import Machine
from hexsim.machine.resolved import Resolved, resolve
from hexsim.tracing.log import MeasuredLog
from hexsim.tracing.weak_form import velocity

Array = np.ndarray


@runtime_checkable
class Balance(Protocol):
    """name and unit of the residual; `residual` gives it under a window, one row a place: (n_places, n).

    `wants` tells whether a log has the channels; `places` names the rows ("leg 1", "platform").
    """

    name: str
    unit: str

    def wants(self, log: MeasuredLog) -> bool: ...

    def places(self, log: MeasuredLog) -> list[str]: ...

    def residual(self, log: MeasuredLog, machine: Any) -> Array: ...


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPoint:
    """Signals of one leg with the sensors' known gains taken out: (n,) each. Volts as they reach the spool."""

    y: Array
    v: Array
    volts: Array
    x: Array
    P1: Array | None
    Ps: Array
    t: Array


def measured_point(log: MeasuredLog, machine: Machine, resolved: Resolved, leg: int) -> MeasuredPoint:
    """The point at which the balances of a leg are evaluated."""
    gains, shared, row = resolved.leg_sensors, resolved.sensors, resolved.rows[leg]
    y = advanced(
        (log.position[leg] - gains["position_offset_m"][leg]) / gains["position_gain"][leg],
        gains["position_delay_s"][leg] * log.rate,
    )
    acceleration = None
    if log.n_legs == 1 and log.acceleration is not None:
        acceleration = (log.acceleration[0] - shared.acceleration_offset_m_s2) / shared.acceleration_gain
        acceleration = advanced(acceleration, shared.acceleration_delay_s * log.rate)
    t = log.time - log.time[0]
    volts = log.volts[leg] if log.volts is not None else np.zeros(log.n)
    held, x = spool_state(row, np.ascontiguousarray(volts), t, log.rate)
    if row[P.SPOOL_OMEGA] == 0.0:  # volts are held from sample to sample: at a sample stands the mean of both sides
        x = 0.5 * (x + np.concatenate([x[:1], x[:-1]]))
    pressure = None
    if log.pressure is not None:
        pressure = (log.pressure[leg] - gains["pressure_offset_Pa"][leg]) / gains["pressure_gain"][leg]
        pressure = advanced(pressure, gains["pressure_delay_s"][leg] * log.rate)
    supply = np.full(log.n, row[P.SUPPLY_PRESSURE])
    if log.supply is not None:
        supply = log.supply / shared.supply_pressure_gain
    return MeasuredPoint(y=y, v=velocity(y, acceleration, log.rate), volts=held, x=x, P1=pressure, Ps=supply, t=t)


def advanced(signal: Array, samples: float) -> Array:
    """A late channel shifted back to where it belongs."""
    if samples == 0.0:
        return signal
    place = np.arange(signal.shape[-1])
    return np.interp(place + samples, place, signal)


def spool_state(row: Array, volts: Array, t: Array, rate: float) -> tuple[Array, Array]:
    """Volts that reach the spool, and the spool's position: the recursions of delay, play and spool on measured volts."""
    held = leg_equations.valve_volts(volts, row[P.HYSTERESIS], round(row[P.VALVE_DELAY] * rate))
    return held, spool_positions(row, held, t)


@compiled
def spool_positions(p, volts, t):
    """Spool position [m] sample by sample for volts held between samples, 10 steps a sample."""
    n = volts.shape[0]
    x = np.empty(n)
    lag = p[P.SPOOL_OMEGA] > 0.0
    place = leg_equations.commanded_spool(p, volts[0], t[0])
    speed = 0.0
    for i in range(n):
        command = leg_equations.commanded_spool(p, volts[i], t[i])
        if not lag:
            x[i] = command
            continue
        x[i] = place
        h = (t[i] - t[i - 1] if i > 0 else t[1] - t[0]) / 10.0
        for _ in range(10):
            speed += h * valve.spool_acceleration(place, speed, command, p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING])
            moved = speed
            if p[P.SPOOL_RATE] > 0.0:
                moved = min(max(speed, -p[P.SPOOL_RATE]), p[P.SPOOL_RATE])
            place += h * moved
    return x


def resolved_machine(machine: Machine) -> Resolved:
    """Rows of a machine with the bristle switched on where it has one."""
    resolved = resolve(machine)
    for row in resolved.rows:
        row[P.ACT_BRISTLE] = 0.0 if row[P.BRISTLE_STIFFNESS] > 0.0 else -1.0
    return resolved
