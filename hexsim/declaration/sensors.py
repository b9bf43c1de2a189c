"""The table [sensors]."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from hexsim.declaration.section import Section, between, zero_or

LATE = "how late it reads [s]"
LAG = "time constant of a first-order lag, 1/(2 pi cut-off); 0 = none [s]"
CUT_OFF, ORDER = "cut-off of its low-pass; 0 = none [Hz]", "order of its low-pass, Butterworth"


Coordinate = Annotated[float, Field(ge=-50.0, le=50.0)]
Place = tuple[Coordinate, Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-180.0, le=180.0)]
Turn = tuple[Angle, Angle, Angle]


class Sensors(Section):
    """Noise as the standard deviation of a reading; 0 = ideal. It is white up to 500 Hz: a faster log or controller reads
    the same value again, so that the noise in the felt band does not depend on their rates."""

    log_rate_Hz: float = between(1.0, 10_000.0, "samples of the log a second [Hz]", default=1000.0)
    position_noise_m: float = between(0.0, 0.1, "noise of the position [m]", default=0.0)
    position_resolution_m: float = zero_or(1e-12, 0.1, "one count of the position [m]")
    position_delay_s: float = between(0.0, 1.0, LATE, default=0.0)
    position_lag_s: float = between(0.0, 1.0, LAG, default=0.0)
    position_filter_Hz: float = zero_or(0.1, 1e5, CUT_OFF)
    position_filter_order: int = Field(default=2, ge=1, le=8, description=ORDER)
    position_gain: float = between(0.01, 100.0, "read over true [-]", default=1.0)
    position_offset_m: float = between(-10.0, 10.0, "read less true [m]", default=0.0)
    pressure_noise_Pa: float = between(0.0, 1e7, "noise of the pressures [Pa]", default=0.0)
    pressure_resolution_Pa: float = zero_or(1e-6, 1e7, "one count of the pressures [Pa]")
    pressure_delay_s: float = between(0.0, 1.0, LATE, default=0.0)
    pressure_lag_s: float = between(0.0, 1.0, LAG, default=0.0)
    pressure_filter_Hz: float = zero_or(0.1, 1e5, CUT_OFF)
    pressure_filter_order: int = Field(default=2, ge=1, le=8, description=ORDER)
    pressure_gain: float = between(0.01, 100.0, "read over true [-]", default=1.0)
    pressure_offset_Pa: float = between(-1e8, 1e8, "read less true [Pa]", default=0.0)
    supply_pressure_gain: float = between(0.01, 100.0, "read over true [-]", default=1.0)
    acceleration_noise_m_s2: float = between(0.0, 1e3, "noise of the accelerations [m/s2]", default=0.0)
    acceleration_resolution_m_s2: float = zero_or(1e-9, 1e3, "one count of the accelerations [m/s2]")
    acceleration_delay_s: float = between(0.0, 1.0, LATE, default=0.0)
    acceleration_filter_Hz: float = zero_or(0.1, 1e5, CUT_OFF)
    acceleration_filter_order: int = Field(default=2, ge=1, le=8, description=ORDER)
    acceleration_gain: float = between(0.01, 100.0, "read over true [-]", default=1.0)
    acceleration_offset_m_s2: float = between(-1e3, 1e3, "read less true [m/s2]", default=0.0)
    imu_position_m: Place = Field(
        default=(0.0, 0.0, 0.0),
        strict=False,
        description="hexapod: accelerometers from the origin of the platform's frame [m]",
    )
    imu_orientation_deg: Turn = Field(
        default=(0.0, 0.0, 0.0),
        strict=False,
        description="hexapod: roll, pitch, yaw of the accelerometers in that frame [deg]",
    )

    @property
    def position_error_m(self) -> float:
        """Standard deviation of a reading: noise, and a count's width over sqrt(12)."""
        return math.hypot(self.position_noise_m, self.position_resolution_m / math.sqrt(12.0))

    @property
    def pressure_error_Pa(self) -> float:
        """The same of a pressure."""
        return math.hypot(self.pressure_noise_Pa, self.pressure_resolution_Pa / math.sqrt(12.0))

    angular_acceleration_noise_rad_s2: float = between(0.0, 1e4, "noise, angular [rad/s2]", default=0.0)
