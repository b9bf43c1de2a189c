"""Pressure transducer of the chamber below the piston."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="pressure_bottom", unit="Pa", label="chamber pressure", measured=True),
    source="true_pressure_bottom",
    noise="pressure_noise_Pa",
    resolution="pressure_resolution_Pa",
    gain="pressure_gain",
    offset="pressure_offset_Pa",
    delay="pressure_delay_s",
    lag="pressure_lag_s",
    filter="pressure_filter",
)
