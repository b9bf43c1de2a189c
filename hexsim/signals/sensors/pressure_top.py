"""Pressure transducer of a rod side on the valve: of the same kind as that below the piston."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="pressure_top", unit="Pa", label="rod side pressure", measured=True, held=True),
    source="true_pressure_top",
    noise="pressure_noise_Pa",
    resolution="pressure_resolution_Pa",
    gain="pressure_gain",
    offset="pressure_offset_Pa",
    delay="pressure_delay_s",
    lag="pressure_lag_s",
    filter="pressure_filter",
)
