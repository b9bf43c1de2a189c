"""Sensors against each other: r_m = d2y/dt2 - a  [m/s2]."""

from __future__ import annotations

import numpy as np

from hexsim.machine.declaration import Machine
from hexsim.tracing.balances.balance import advanced, measured_point, resolved_machine
from hexsim.tracing.log import MeasuredLog
from hexsim.tracing.weak_form import Window

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
        resolved, window = resolved_machine(machine), Window(log.rate, 0.03)
        point, sensors = measured_point(log, machine, resolved, 0), resolved.sensors
        assert log.acceleration is not None
        shown = (log.acceleration[0] - sensors.acceleration_offset_m_s2) / sensors.acceleration_gain
        shown = advanced(shown, sensors.acceleration_delay_s * log.rate)
        return (window.second_rate(point.y) - window.mean(shown))[None]
