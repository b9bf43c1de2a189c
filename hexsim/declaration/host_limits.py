"""The table [host_limits]: what a host may ask of the machine, as legs and as platform."""

from __future__ import annotations

from hexsim.declaration.section import Section, between


class HostLimits(Section):
    """Largest setpoints of a host. The defaults are assumed values for people on board, well inside the machine's flow.

    Jerk: a sine of the largest acceleration at 15 Hz, the fastest tone of a designed motion, has 2 pi 15 Hz 3 m/s2 =
    283 m/s3; the same of 150 deg/s2.
    """

    stroke_share: float = between(
        0.01, 1.0, "share of the way from neutral to 5 mm before the cushions that may be used [-]", default=1.0
    )
    step_share: float = between(1e-3, 1.0, "largest size of a designed step over the stroke [-]", default=0.05)
    velocity_m_s: float = between(1e-3, 10.0, "of a leg, and of the platform along x, y and z [m/s]", default=0.3)
    acceleration_m_s2: float = between(1e-2, 100.0, "the same [m/s2]", default=3.0)
    jerk_m_s3: float = between(0.1, 1e5, "the same [m/s3]", default=300.0)
    angular_velocity_deg_s: float = between(0.1, 1e3, "of roll, pitch and yaw [deg/s]", default=20.0)
    angular_acceleration_deg_s2: float = between(1.0, 1e4, "the same [deg/s2]", default=150.0)
    angular_jerk_deg_s3: float = between(10.0, 1e7, "the same [deg/s3]", default=15_000.0)
