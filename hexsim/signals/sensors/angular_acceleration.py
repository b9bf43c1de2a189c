"""Angular accelerometer of a platform, in its frame; it is late as the accelerometer is."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(
        stem="angular_acceleration", unit="rad_s2", label="angular acceleration", scope="rotation", measured=True
    ),
    source="true_angular_acceleration",
    noise="angular_acceleration_noise_rad_s2",
    delay="acceleration_delay_s",
)
