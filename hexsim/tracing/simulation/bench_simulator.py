"""Simulations of a bench that answer a log: same setpoint, same start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import S
from hexsim.signals.log import MeasuredLog
from hexsim.tracing.simulation import leg_simulation as ls

Array = np.ndarray
REST_M = 2.0e-5  # [m] a log that begins this near its setpoint begins at rest
START_S = 0.02  # [s] of the log that give position and speed at its beginning
STEP_S = 1.7e-4  # [s] integration step; RK4 needs step * (F_c + F_s)/(v_s m) < 2.7. Error: 0.013 of the sensors' noise


@dataclass(frozen=True, kw_only=True)
class Rows:
    """The numbers of one variant for the compiled simulation."""

    leg: Array
    supply: Array
    load: Array
    control: Array
    sensors: Array


def rows_of(machine: Machine, feedback: int = 0) -> Rows:
    """Resolve a machine into rows."""
    resolved = resolve(machine)
    load = np.zeros(ls.N_LOAD)
    load[ls.MASS] = resolved.load.moving_mass_kg
    load[ls.GRAVITY] = -resolved.gravity_m_s2[2]
    if resolved.payload_modes:
        mode = resolved.payload_modes[0]
        load[ls.PAYLOAD_MASS] = mode.mass_kg
        load[ls.PAYLOAD_OMEGA] = 2 * np.pi * mode.frequency_Hz
        load[ls.PAYLOAD_DAMPING] = mode.damping_ratio
    leg = resolved.rows[0]
    leg[P.ROD_SIDE_CHAMBER] = 0.0  # fits have the rod side at supply pressure
    controller = machine.controller
    control = np.array([controller.gain_V_per_m, controller.rate_Hz, machine.valve.voltage_max_V, float(feedback)])
    return Rows(leg=leg, supply=resolved.supply, load=load, control=control, sensors=sensor_row(resolved))


def sensor_row(resolved: Resolved) -> Array:
    """Gains, offsets and delays of a leg's sensors."""
    row, leg, shared = np.zeros(ls.N_SENSORS), resolved.leg_sensors, resolved.sensors
    row[ls.Y_GAIN], row[ls.Y_OFFSET] = leg["position_gain"][0], leg["position_offset_m"][0]
    row[ls.Y_DELAY], row[ls.P_DELAY] = leg["position_delay_s"][0], leg["pressure_delay_s"][0]
    row[ls.P_GAIN], row[ls.P_OFFSET] = leg["pressure_gain"][0], leg["pressure_offset_Pa"][0]
    row[ls.PS_GAIN] = shared.supply_pressure_gain
    row[ls.A_GAIN], row[ls.A_OFFSET] = shared.acceleration_gain, shared.acceleration_offset_m_s2
    row[ls.A_DELAY] = shared.acceleration_delay_s
    return row


def friction_step(legs: Array, pressure_Pa: float) -> Array:
    """Largest step of the friction [N] at a reversal, a row of legs: what makes it stiff."""
    level = np.maximum(legs[..., P.COULOMB_EXTEND], legs[..., P.COULOMB_RETRACT])
    level = level + np.maximum(legs[..., P.STATIC_EXTEND], legs[..., P.STATIC_RETRACT])
    return level + legs[..., P.SEAL_FRICTION] * pressure_Pa + np.abs(legs[..., P.RIPPLE_FORCE])


def substeps(rows: Sequence[Rows], rate: float) -> int:
    """Steps a log sample, small enough for the stiffest friction among the variants."""
    stiffest = max(
        float(friction_step(r.leg, r.supply[S.PRESSURE])) / (r.leg[P.SHARPNESS] * r.load[ls.MASS]) for r in rows
    )
    step = min(STEP_S, 2.2 / stiffest if stiffest > 0 else STEP_S)
    return int(np.ceil(1.0 / (rate * step) - 1e-9))


def start_of(log: MeasuredLog, gain: float = 1.0, offset: float = 0.0) -> tuple[float, float]:
    """Position [m] and speed [m/s] at the beginning of a log: at rest at the setpoint if the first sample is there.

    gain, offset: of the position sensor, y_m = gain y + offset.
    """
    y = log.position[0]
    if log.setpoint is not None and abs(log.setpoint[0, 0] - np.mean(y[:2])) < REST_M:
        return (float(log.setpoint[0, 0]) - offset) / gain, 0.0
    head = max(int(START_S * log.rate), 4)
    slope, start = np.polyfit(log.time[:head] - log.time[0], y[:head], 1)
    return (float(start) - offset) / gain, float(slope) / gain


def simulate_bench(machine: Machine, log: MeasuredLog, feedback: int, supply: Array | None = None) -> Array:
    """Outputs (N_OUTPUTS, n) as the sensors show them, without noise; NaN after a divergence.

    supply: (n,) pressure that drives the leg instead of the simulated supply [Pa].
    """
    rows = rows_of(machine, feedback)
    start, speed = start_of(log, rows.sensors[ls.Y_GAIN], rows.sensors[ls.Y_OFFSET])
    out = np.empty((ls.N_OUTPUTS, log.n))
    nothing = np.zeros(log.n)
    ls.run_leg(
        rows.leg,
        rows.supply,
        rows.load,
        rows.control,
        rows.sensors,
        log.setpoint[0] if log.setpoint is not None else nothing,
        log.volts[0] if log.volts is not None else nothing,
        log.position[0],
        np.zeros(0) if supply is None else supply,
        start,
        speed,
        log.rate,
        substeps([rows], log.rate),
        log.near_rest,
        out,
    )
    return out
