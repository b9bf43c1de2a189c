"""The tables [cylinder], [valve] and [friction] of a leg."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from hexsim.declaration.section import Section, between, zero_or


class Cylinder(Section):
    """Differential cylinder. `rod_side` "supply" is the report: the annulus hangs on the supply line."""

    piston_diameter_m: float = between(1e-3, 2.0, "piston diameter [m]")
    rod_diameter_m: float = between(5e-4, 2.0, "rod diameter [m]")
    stroke_m: float = between(5e-3, 10.0, "stroke [m]")
    pipeline_volume_m3: float = between(0.0, 0.1, "oil between valve and chamber [m3]")
    rod_side: Literal["supply", "chamber"] = Field("supply", description="what the annulus hangs on")
    rod_side_volume_m3: float = between(0.0, 0.1, "dead volume of an annulus that is a chamber [m3]", default=5.0e-7)
    rod_side_conductance_m3_s_sqrtPa: float = between(
        1e-10, 0.1, "port between annulus and supply line [m3/(s sqrt(Pa))]", default=2.0e-6
    )
    cushion_length_m: float = between(1e-5, 2.0, "the soft end stop acts within this of either end [m]", default=0.005)
    cushion_stiffness_N_m: float = between(1e2, 1e11, "stiffness of the end stop [N/m]", default=2.0e7)
    cushion_damping_N_s_m: float = between(0.0, 1e9, "damping of the end stop [N s/m]", default=2.0e4)

    @property
    def area_bottom_m2(self) -> float:
        """A1 = pi/4 D^2."""
        return math.pi / 4 * self.piston_diameter_m**2

    @property
    def area_top_m2(self) -> float:
        """A2 = pi/4 (D^2 - d^2)."""
        return math.pi / 4 * (self.piston_diameter_m**2 - self.rod_diameter_m**2)

    @model_validator(mode="after")
    def _rod_fits(self) -> Cylinder:
        if self.rod_diameter_m >= self.piston_diameter_m:
            raise ValueError(
                f"rod_diameter_m = {self.rod_diameter_m:g} must be smaller than "
                f"piston_diameter_m = {self.piston_diameter_m:g}"
            )
        if self.cushion_length_m >= self.stroke_m / 2:
            raise ValueError(
                f"cushion_length_m = {self.cushion_length_m:g} must be shorter than half of "
                f"stroke_m = {self.stroke_m:g}"
            )
        return self


class Valve(Section):
    """Three-way proportional valve, Eq. 3.2-3.4 and 3.11."""

    flow_area: Literal["overlap", "quadratic"] = Field("overlap", description="law of the opening, Eq. 3.3 or 3.11")
    voltage_max_V: float = between(1e-2, 1e3, "command at full spool travel [V]")
    spool_travel_max_m: float = between(1e-5, 0.1, "full spool travel [m]")
    spool_diameter_m: float = between(1e-4, 0.5, "spool diameter [m]")
    overlap_m: float = Field(description="overlap, shorter than the travel; negative: underlap [m]")
    edge_rounding_m: float = zero_or(1e-9, 1e-2, "rounding of the metering edges; 0 = sharp (report) [m]")
    discharge_coefficient: float = between(0.05, 1.0, "discharge coefficient [-]")
    quadratic_gain: float = between(1e-3, 1e7, "gain of a(x) = gain x^2, Eq. 3.11 [-]", default=300.0)
    pressure_width_Pa: float = between(1.0, 1e7, "sqrt(dp) is smooth within this of dp = 0 [Pa]", default=1.0e4)
    spool_frequency_Hz: float = zero_or(0.1, 1e4, "bandwidth of the spool; 0 = it follows at once (report) [Hz]")
    spool_damping: float = between(0.01, 100.0, "damping ratio of the spool [-]", default=0.7)

    @model_validator(mode="after")
    def _overlap_within_travel(self) -> Valve:
        if abs(self.overlap_m) >= self.spool_travel_max_m:
            raise ValueError(
                f"overlap_m = {self.overlap_m:g} must be smaller than spool_travel_max_m = {self.spool_travel_max_m:g}"
            )
        return self


class Friction(Section):
    """Asymmetric Stribeck curve, Eq. 2.4 ("sharp") or Eq. 3.9 as printed ("report")."""

    form: Literal["sharp", "report"] = Field("sharp", description="Eq. 2.4, or Eq. 3.9 as printed")
    viscous_extend_N_s_m: float = between(0.0, 1e8, "viscous friction, extending [N s/m]")
    viscous_retract_N_s_m: float = between(0.0, 1e8, "viscous friction, retracting [N s/m]")
    coulomb_extend_N: float = between(0.0, 1e7, "Coulomb friction, extending [N]")
    coulomb_retract_N: float = between(0.0, 1e7, "Coulomb friction, retracting [N]")
    static_extend_N: float = between(0.0, 1e7, "static friction above Coulomb's, extending [N]")
    static_retract_N: float = between(0.0, 1e7, "static friction above Coulomb's, retracting [N]")
    stribeck_velocity_m_s: float = between(1e-6, 10.0, "the static part fades with this speed [m/s]")
    sharpness_m_s: float = between(1e-7, 1.0, "sharp: sign(v) stands as tanh(v / sharpness) [m/s]", default=2.0e-4)
    arctan_slope_s_m: float = between(1e-2, 1e7, "report: sign(v) stands as arctan(slope v) [s/m]", default=100.0)
