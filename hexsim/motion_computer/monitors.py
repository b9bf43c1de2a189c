"""Monitors of the motion computer: what each tick checks, and when it is an error.

Each leg is compared with a model of the position loop from the data sheet,

    y_m' = K_v sat(Kp (s - y_m)),   K_v velocity gain [m/s/V],

so that the ordinary lag of the loop is no error: a piston must stay between model and setpoint, within a tolerance.
The same model replaces a lost transducer, corrected by the mean model error of the other legs.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import allocating
from hexsim.declaration import Machine
from hexsim.motion_computer.errors import Error, Finding

Array = NDArray[np.float64]


class Reading(IntEnum):
    """What a tick finds wrong with a leg."""

    OK = 0
    LOST = 1
    OUT_OF_RANGE = 2
    JUMP = 3
    FROZEN = 4
    LEG_ERROR = 5
    LEG_PRESSURE = 6


LEG_FINDINGS = {
    Reading.LOST: (Error.SENSOR, "leg {leg}: position signal lost"),
    Reading.OUT_OF_RANGE: (Error.SENSOR, "leg {leg}: position outside the stroke"),
    Reading.JUMP: (Error.SENSOR, "leg {leg}: position jumps"),
    Reading.FROZEN: (Error.SENSOR, "leg {leg}: position stands still while the leg is driven"),
    Reading.LEG_ERROR: (Error.LEG_ERROR, "leg {leg} does not follow its setpoint"),
    Reading.LEG_PRESSURE: (Error.PRESSURE_LOW, "leg {leg}: bottom pressure lost"),
}


class Count(IntEnum):
    """How often in a row: rows of the counters."""

    LEG_ERROR = 0
    BAD = 1  # readings
    EQUAL = 2  # readings while driven
    PRESSURE = 3  # too low


class LegLimits(NamedTuple):
    """Numbers of the legs' monitor, SI; arrays (n_legs,); times in control ticks."""

    tick_s: float
    velocity_gain: Array  # K_v [m/s/V]
    position_gain: Array  # Kp [V/m]
    volts_max: Array
    stroke: Array
    leg_error: float
    leg_error_share: float
    leg_error_ticks: float
    range: float
    jump: float
    bad_readings: float
    frozen_ticks: float
    frozen_velocity: float
    leg_pressure: float
    leg_pressure_ticks: float
    clear_of_stops: Array  # a leg on its stop needs no pressure


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """Thresholds of the monitors. Each value is assumed; docs/faults.md shows the detection that follows."""

    leg_error_m: float = 0.012  # outside the band between model and setpoint
    leg_error_share: float = 0.35  # of the band's width, for a velocity gain that depends on load and direction
    leg_error_s: float = 0.010
    range_m: float = 0.004  # readings this far outside the stroke are no positions
    jump_m_s: float = 2.0  # no leg is faster
    bad_readings: int = 3  # in a row; the model bridges a single bad reading
    frozen_s: float = 0.1  # equal readings while the model moves faster than:
    frozen_velocity_m_s: float = 0.005
    supply_low: float = 0.8  # of nominal; the precharge of a usual accumulator
    supply_low_s: float = 0.02
    leg_pressure_low: float = 0.07  # of the nominal supply
    leg_pressure_s: float = 0.01
    oil_hot_degC: float = 65.0
    host_timeout_s: float = 0.25
    load_shift_m: float = 0.04  # of the centre of mass
    load_change: float = 0.10  # of the weight
    load_filter_s: float = 0.8
    load_learn_s: float = 2.0


def velocity_gain(machine: Machine) -> Array:
    """K_v (n_legs,) [m/s/V] of the loop model: the valve at half the supply pressure over the bottom area, both ways alike.

    C_d pi d (x_max/u_max) sqrt(P_s / rho) / A1; measured machines are within a third of it, which the tolerance allows.
    """
    density, gains = machine.oil.density_kg_m3, []
    head = machine.supply.pressure_Pa - machine.supply.tank_pressure_Pa
    for leg in machine.legs:
        valve = leg.valve
        gradient = valve.area_gradients_m(density)[0] * valve.spool_travel_max_m / valve.voltage_max_V
        flow = valve.discharge_coefficient * gradient * np.sqrt(head / density)
        gains.append(float(flow / leg.cylinder.area_bottom_m2))
    return np.array(gains)


@allocating
def _check_legs(setpoint, forward, measured, pressures, model, last, counts, usable, p):
    """Update model, last good readings and counters; return a code for each leg. counts: (4, n), rows as `Count`."""
    n = setpoint.shape[0]
    codes = np.zeros(n, np.int64)
    for i in range(n):
        volts = p.position_gain[i] * (setpoint[i] - model[i]) + forward[i]
        speed = p.velocity_gain[i] * min(max(volts, -p.volts_max[i]), p.volts_max[i])
        model[i] += p.tick_s * speed
        counts[Count.PRESSURE, i] = (
            counts[Count.PRESSURE, i] + 1 if pressures[i] < p.leg_pressure and measured[i] > p.clear_of_stops[i] else 0
        )
        if counts[Count.PRESSURE, i] >= p.leg_pressure_ticks:
            codes[i] = Reading.LEG_PRESSURE
        if not usable[i]:
            continue
        reading = measured[i]
        bad = Reading.OK
        if not np.isfinite(reading):
            bad = Reading.LOST
        elif reading < -p.range or reading > p.stroke[i] + p.range:
            bad = Reading.OUT_OF_RANGE
        elif abs(reading - last[i]) > p.tick_s * (p.jump + counts[Count.BAD, i] * abs(speed)):
            bad = Reading.JUMP
        if bad != Reading.OK:
            counts[Count.BAD, i] += 1
            if counts[Count.BAD, i] >= p.bad_readings:
                codes[i] = bad
            continue
        counts[Count.BAD, i] = 0
        driven = abs(speed) > p.frozen_velocity and p.clear_of_stops[i] < reading < p.stroke[i] - p.clear_of_stops[i]
        counts[Count.EQUAL, i] = counts[Count.EQUAL, i] + 1 if reading == last[i] and driven else 0
        last[i] = reading
        if counts[Count.EQUAL, i] >= p.frozen_ticks:
            codes[i] = Reading.FROZEN
        beyond = max(min(model[i], setpoint[i]) - reading, reading - max(model[i], setpoint[i]))
        counts[Count.LEG_ERROR, i] = (
            counts[Count.LEG_ERROR, i] + 1
            if beyond > p.leg_error + p.leg_error_share * abs(setpoint[i] - model[i])
            else 0
        )
        if counts[Count.LEG_ERROR, i] >= p.leg_error_ticks:
            codes[i] = Reading.LEG_ERROR
    return codes


class LegMonitor:
    """Position transducers, leg errors and bottom pressures of all legs.

    model: (n,) positions of the loop model; usable: (n,) which transducers are still used.
    """

    def __init__(self, machine: Machine, tolerances: Tolerances) -> None:
        n, tick = machine.n_legs, 1.0 / machine.controller.rate_Hz
        t = tolerances
        ticks = lambda seconds: max(1.0, np.ceil(seconds / tick))  # noqa: E731
        self._limits = LegLimits(
            tick_s=tick,
            velocity_gain=velocity_gain(machine),
            position_gain=machine.of_legs("controller", "gain_V_per_m"),
            volts_max=machine.of_legs("valve", "voltage_max_V"),
            stroke=machine.of_legs("cylinder", "stroke_m"),
            leg_error=t.leg_error_m,
            leg_error_share=t.leg_error_share,
            leg_error_ticks=ticks(t.leg_error_s),
            range=t.range_m,
            jump=t.jump_m_s,
            bad_readings=float(t.bad_readings),
            frozen_ticks=ticks(t.frozen_s),
            frozen_velocity=t.frozen_velocity_m_s,
            leg_pressure=t.leg_pressure_low * machine.supply.pressure_Pa,
            leg_pressure_ticks=ticks(t.leg_pressure_s),
            clear_of_stops=2.0 * machine.of_legs("cylinder", "cushion_length_m"),
        )
        self.model = np.zeros(n)
        self.usable = np.ones(n, dtype=bool)
        self._last = np.zeros(n)
        self._counts = np.zeros((4, n), dtype=np.int64)
        self._started = False

    def start(self, positions: Array) -> None:
        """Start with model and last readings at `positions`."""
        stroke = self._limits.stroke
        self.model[:] = np.where(np.isfinite(positions), positions, 0.5 * stroke)
        self._last[:] = self.model
        self._counts[:] = 0
        self.usable[:] = True
        self._started = True

    def tick(
        self, setpoint: Array, forward: Array, measured: Array, pressures: Array | None
    ) -> tuple[Array, list[Finding]]:
        """(positions for the position loop, findings). Call at each control tick. forward: volts fed forward (n_legs,)."""
        if not self._started:
            self.start(measured)
        known = np.full(len(setpoint), np.nan) if pressures is None else pressures
        codes = _check_legs(
            setpoint, forward, measured, known, self.model, self._last, self._counts, self.usable, self._limits
        )
        findings = []
        for i in np.flatnonzero(codes):
            error, text = LEG_FINDINGS[Reading(codes[i])]
            findings.append(Finding(error=error, leg=int(i) + 1, detail=text.format(leg=i + 1)))
            if error == Error.SENSOR:
                self.usable[i] = False
        valid = self.usable & (self._counts[Count.BAD] == 0)
        if valid.all():
            return measured, findings
        off = float(np.mean((measured - self.model)[valid])) if valid.any() else 0.0
        return np.where(valid, measured, self.model + off), findings


class SupplyMonitor:
    """Supply pressure below a share of nominal for a while; a lost transducer."""

    def __init__(self, machine: Machine, tolerances: Tolerances) -> None:
        self.nominal = machine.supply.pressure_Pa
        self.low = tolerances.supply_low * self.nominal
        self._needed = max(1, round(tolerances.supply_low_s * machine.controller.rate_Hz))
        self._count = 0

    def tick(self, supply_Pa: float) -> list[Finding]:
        if not np.isfinite(supply_Pa):
            return [Finding(error=Error.SENSOR, detail="supply pressure signal lost")]
        self._count = self._count + 1 if supply_Pa < self.low else 0
        if self._count < self._needed:
            return []
        return [
            Finding(
                error=Error.PRESSURE_LOW,
                detail=f"supply at {supply_Pa / 1e5:.1f} bar, needed {self.low / 1e5:.1f}",
            )
        ]
