"""Sensors against each other: r_m = d2y/dt2 - a  [m/s2]."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing.balances.balance import Balance, resolved_machine, sensed_leg

Array = np.ndarray


class Sensor(Balance):
    """Position differentiated twice against the accelerometer of a bench."""

    name = "sensor"
    unit = "m/s2"
    caption = "position differentiated twice = acceleration, but for the ripple between the controller's ticks"
    order = 10
    signals = ("position_m", "velocity_m_s", "acceleration_m_s2", "time_s", "pressure_bottom_Pa", "valve_V")
    usual_signal = "acceleration_m_s2"
    spoils_others = True

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return () if machine.is_hexapod else (("acceleration",),)

    def places(self, log: Log) -> list[str]:
        return ["leg 1"]

    def residual(self, log: Log, machine: Machine) -> Array:
        return sensed_leg(log, resolved_machine(machine), 0).disagreement[None]

    def sampling(self, log: Log, machine: Machine) -> Array:
        return sensed_leg(log, resolved_machine(machine), 0).between_ticks[None]


BALANCES = (Sensor(),)
