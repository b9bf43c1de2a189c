"""Difference of the chambers' pressures, P1 - P2: one transducer across both ports, of the same kind as those of the chambers."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="pressure_difference", unit="Pa", label="pressure difference", measured=True, held=True),
    source="true_pressure_difference",
    noise="pressure_noise_Pa",
    resolution="pressure_resolution_Pa",
)
