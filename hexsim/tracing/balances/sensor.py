"""Sensors against each other: r_m = d2y/dt2 - a  [m/s2]."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import MeasuredLog
from hexsim.tracing.balances.balance import resolved_machine, sensed_leg

Array = np.ndarray


class Sensor:
    """Position differentiated twice against the accelerometer of a bench."""

    name = "sensor"
    unit = "m/s2"

    def wants(self, log: MeasuredLog) -> bool:
        return log.n_legs == 1 and log.acceleration is not None

    def places(self, log: MeasuredLog) -> list[str]:
        return ["leg 1"]

    def residual(self, log: MeasuredLog, machine: Machine) -> Array:
        return sensed_leg(log, resolved_machine(machine), 0).disagreement[None]
