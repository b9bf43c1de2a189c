"""Pressure transducer of the supply, on the valve manifold: of the same kind as those of the chambers."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="pressure_supply", unit="Pa", label="supply pressure", scope="machine", measured=True),
    source="true_pressure_supply",
    noise="pressure_noise_Pa",
    resolution="pressure_resolution_Pa",
    gain="supply_pressure_gain",
)
