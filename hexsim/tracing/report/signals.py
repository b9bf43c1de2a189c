"""What signals are called in reports, and the units that they are shown in."""

from __future__ import annotations

from hexsim.recording.quantity import split_key
from hexsim.signals.channels import kind_of

# kind of channel: (name, scale and unit of the signal, scale and unit of what is left of it)
SCALE = {
    "position_m": ("position", 1e3, "mm", 1e6, "µm"),
    "pressure_bottom_Pa": ("chamber pressure", 1e-5, "bar", 1e-5, "bar"),
    "pressure_top_Pa": ("rod side pressure", 1e-5, "bar", 1e-5, "bar"),
    "pressure_difference_Pa": ("pressure difference", 1e-5, "bar", 1e-5, "bar"),
    "pressure_supply_Pa": ("supply pressure", 1e-5, "bar", 1e-5, "bar"),
    "acceleration_m_s2": ("acceleration, 50 Hz band", 1.0, "m/s²", 1.0, "m/s²"),
    "angular_acceleration_rad_s2": ("angular acceleration, 50 Hz band", 1.0, "rad/s²", 1.0, "rad/s²"),
}
SIGNALS = {
    "position_m": ("position", 1e3, "mm"),
    "velocity_m_s": ("velocity", 1e3, "mm/s"),
    "speed_m_s": ("speed", 1e3, "mm/s"),
    "valve_V": ("valve voltage", 1.0, "V"),
    "time_s": ("time", 1.0, "s"),
    "pressure_bottom_Pa": ("chamber pressure", 1e-5, "bar"),
    "pressure_top_Pa": ("rod side pressure", 1e-5, "bar"),
    "pressure_difference_Pa": ("pressure difference", 1e-5, "bar"),
    "pressure_supply_Pa": ("supply pressure", 1e-5, "bar"),
    "acceleration_m_s2": ("acceleration", 1.0, "m/s²"),
}
NOISE_BAND = "#CBE0F0"


def channel_words(channel: str) -> str:
    """pressure_bottom_3_Pa -> chamber pressure of leg 3."""
    kind = kind_of(channel)
    name, place = SIGNALS.get(kind, (split_key(kind)[0],))[0], split_key(channel)[0].split()[-1]
    if place.isdigit():
        return f"{name} of leg {place}"
    return f"{name} {place}" if place in ("x", "y", "z") else name
