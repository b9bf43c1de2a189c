"""Accelerometer: along the leg of a bench; three axes in the frame of a platform, at the centre of its joints.

It samples the instant, as one without a filter does.
"""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="acceleration", unit="m_s2", label="acceleration", scope="translation", measured=True),
    source="true_acceleration",
    noise="acceleration_noise_m_s2",
    resolution="acceleration_resolution_m_s2",
    gain="acceleration_gain",
    offset="acceleration_offset_m_s2",
    delay="acceleration_delay_s",
    filter="acceleration_filter",
)
