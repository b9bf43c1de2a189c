"""The table [controller]. Its equations: hexsim/motion_computer/controller.py."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from hexsim.declaration.section import Section, between, zero_or

LONGEST_DELAY_TICKS = 8  # 16 ms at 500 Hz, longer than a position loop can bear


class Controller(Section):
    """Position loop of the motion computer. Gain and rate alone are the proportional loop of report 2.2.4."""

    gain_V_per_m: float = between(1e-3, 1e6, "proportional gain [V/m]")
    rate_Hz: float = between(1.0, 10_000.0, "ticks of the motion computer a second [Hz]", default=500.0)
    structure: Literal["pid", "cascade"] = Field(
        "pid",
        description="one loop, or a velocity loop inside the position loop: it follows the setpoint's velocity too",
    )
    integral_time_s: float = zero_or(1e-3, 1e4, "reset time of the integral action; 0 = none [s]")
    anti_windup_s: float = between(
        1e-3, 1e4, "time in which the integral gives way while the valve is saturated [s]", default=0.1
    )
    velocity_gain_V_s_per_m: float = between(
        0.0, 1e5, "on the measured velocity: derivative action, or gain of the inner loop [V s/m]", default=0.0
    )
    velocity_filter_Hz: float = between(
        0.1, 5e3, "low-pass of the velocity that is got from the position [Hz]", default=60.0
    )
    setpoint_filter_Hz: float = zero_or(0.1, 5e3, "low-pass of second order that smooths the setpoint; 0 = none [Hz]")
    velocity_feed_forward_V_s_per_m: float = between(0.0, 1e5, "on the setpoint's velocity [V s/m]", default=0.0)
    acceleration_feed_forward_V_s2_per_m: float = between(
        -1e4, 1e4, "on the setpoint's acceleration [V s2/m]", default=0.0
    )
    load_feed_forward: bool = Field(
        False, description="what masses and friction ask for is fed forward: oil compression and pressure"
    )
    pressure_feedback_V_per_Pa: float = between(
        0.0, 1.0, "on the high-passed pressure of the chamber, or of both on a four-way valve [V/Pa]", default=0.0
    )
    pressure_high_pass_Hz: float = between(1e-3, 1e3, "corner of the high pass before it [Hz]", default=1.0)
    notch_Hz: float = zero_or(0.1, 5e3, "middle of a notch behind the position controller; 0 = none [Hz]")
    notch_width: float = between(0.01, 10.0, "width of the notch over its frequency [-]", default=1.0)
    notch_depth: float = between(0.0, 1.0, "gain in the middle of the notch [-]", default=0.1)
    computing_delay_ticks: float = between(
        0.0, LONGEST_DELAY_TICKS, "from reading the transducers to the volts; fractions too [ticks]", default=0.0
    )
    setpoint_rate_Hz: float | None = between(
        1.0, 10_000.0, "of poses and leg setpoints, straight lines in between; default: rate_Hz [Hz]", default=None
    )
    host_buffer_s: float = between(
        0.0, 0.5, "latency given away so that less of a host's motion must be predicted [s]", default=0.0
    )

    @model_validator(mode="after")
    def _fits_its_rate(self) -> Controller:
        used = {
            "velocity_filter_Hz": self.velocity_filter_Hz if self.velocity_gain_V_s_per_m else 0.0,
            "pressure_high_pass_Hz": self.pressure_high_pass_Hz if self.pressure_feedback_V_per_Pa else 0.0,
            "notch_Hz": self.notch_Hz,
            "setpoint_filter_Hz": self.setpoint_filter_Hz,
        }
        for key, frequency in used.items():
            if frequency >= 0.5 * self.rate_Hz:
                raise ValueError(f"{key} = {frequency:g} must be below half of rate_Hz = {self.rate_Hz:g}")
        ratio = self.rate_Hz / (self.setpoint_rate_Hz or self.rate_Hz)
        if abs(ratio - round(ratio)) > 1e-6 or ratio < 1.0:
            raise ValueError(f"rate_Hz = {self.rate_Hz:g} must be a whole multiple of setpoint_rate_Hz")
        if self.structure == "cascade" and self.velocity_gain_V_s_per_m == 0.0:
            raise ValueError('structure = "cascade" needs velocity_gain_V_s_per_m')
        return self
