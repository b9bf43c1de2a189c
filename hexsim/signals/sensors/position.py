"""Position transducer of a piston, 0 at full retraction."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="position", unit="m", label="position", measured=True),
    source="true_position",
    noise="position_noise_m",
    resolution="position_resolution_m",
    gain="position_gain",
    offset="position_offset_m",
    delay="position_delay_s",
    lag="position_lag_s",
    filter="position_filter",
    ripple="position_ripple",
)
