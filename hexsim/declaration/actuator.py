"""The tables [cylinder] and [friction] of a leg."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from hexsim.declaration.section import Section, between, zero_or


class Cylinder(Section):
    """Differential cylinder, or symmetric with a through rod. `rod_side`: what the annulus is connected to.

    "supply" is the report: the supply line. "chamber": the supply line behind a port. "valve": port B of a four-way
    valve; the rod side is a chamber of its own.
    """

    piston_diameter_m: float = between(1e-3, 2.0, "piston diameter [m]")
    rod_diameter_m: float = between(5e-4, 2.0, "rod diameter [m]")
    stroke_m: float = between(5e-3, 10.0, "stroke [m]")
    through_rod: bool = Field(False, description="the rod passes both ends: both areas are the annulus")
    pipeline_volume_m3: float = between(0.0, 0.1, "oil between valve and chamber [m3]")
    rod_side: Literal["supply", "chamber", "valve"] = Field("supply", description="what the annulus is connected to")
    rod_side_volume_m3: float = between(0.0, 0.1, "dead volume of an annulus that is a chamber [m3]", default=5.0e-7)
    rod_side_conductance_m3_s_sqrtPa: float = between(
        1e-10, 0.1, "port between annulus and supply line [m3/(s sqrt(Pa))]", default=2.0e-6
    )
    cushion_length_m: float = between(1e-5, 2.0, "the soft end stop acts within this of either end [m]", default=0.005)
    cushion_stiffness_N_m: float = between(1e2, 1e11, "stiffness of the end stop [N/m]", default=2.0e7)
    cushion_damping_N_s_m: float = between(0.0, 1e9, "damping of the end stop [N s/m]", default=2.0e4)
    cushion_orifice_m3_s_sqrtPa: float = zero_or(
        1e-12,
        0.1,
        "orifice through which the cushions of both ends empty, beside the spring; 0 = none [m3/(s sqrt(Pa))]",
    )
    piston_leakage_m3_s_Pa: float = between(0.0, 1e-8, "across the piston seal, laminar [m3/(s Pa)]", default=0.0)
    rod_leakage_m3_s_Pa: float = between(
        0.0, 1e-8, "out along the rod, from a chamber on the valve to tank pressure [m3/(s Pa)]", default=0.0
    )

    @property
    def area_bottom_m2(self) -> float:
        """A1 = pi/4 D^2, or the annulus of a through rod."""
        return self.area_top_m2 if self.through_rod else math.pi / 4 * self.piston_diameter_m**2

    @property
    def area_top_m2(self) -> float:
        """A2 = pi/4 (D^2 - d^2)."""
        return math.pi / 4 * (self.piston_diameter_m**2 - self.rod_diameter_m**2)

    def cushion_choke_N_s2_m2(self, area_m2: float) -> float:
        """Force over speed squared of a cushion of this area: A (A v/K)^2."""
        conductance = self.cushion_orifice_m3_s_sqrtPa
        return area_m2**3 / conductance**2 if conductance > 0.0 else 0.0

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
