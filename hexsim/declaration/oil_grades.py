"""Oils by grade: viscosity and density over temperature, and the bulk modulus of the liquid.

rho(T, P) = rho_0 [1 - b (T - T0)] / (1 - P/E)                thermal expansion b, compression
lg lg(nu + 0.7) = A - B lg(T + 273.15)                        nu in mm2/s, T in degC          ASTM D341 (Walther)
E(T, P) = E_0 10^[-c (T - T0)] + e P                          liquid, isentropic tangent      Hayward 1970
E_0     = 1e9 (1.57 + 0.15 lg nu(20 degC))                    liquid at 20 degC, no pressure  Hayward 1970
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class OilGrade:
    """What an oil's grade says beyond the declared density and bulk modulus."""

    name: str
    viscosity_40_mm2_s: float
    viscosity_100_mm2_s: float
    density_15_kg_m3: float
    expansion_1_K: float
    viscosity_pressure_1_Pa: float
    modulus_decades_1_K: float
    modulus_pressure: float
    specific_heat_J_kg_K: float


# Shell's sheet of Tellus T46 was not available. 46 mm2/s at 40 degC is ISO 3448's definition of the grade; 7.9 mm2/s at
# 100 degC (viscosity index 143) is typical of multigrade oils of this class (ISO 11158 HV), which Tellus T is.
TELLUS_T46 = OilGrade(
    name="Shell Tellus T46",
    viscosity_40_mm2_s=46.0,
    viscosity_100_mm2_s=7.9,
    density_15_kg_m3=872.0,
    expansion_1_K=7.0e-4,  # mineral oils, commonly used; 872 kg/m3 at 15 degC of this class against 860 at 35: 6.9e-4
    viscosity_pressure_1_Pa=2.0e-8,  # machine oils: 1.8e-8 .. 2.8e-8 (Stachowiak, Engineering Tribology, table 2.3)
    modulus_decades_1_K=0.0024,  # Hayward 1970: 10^(0.0024 (20 - T))
    modulus_pressure=11.2,  # Hayward 1970: secant modulus rises by 5.6 P, the tangent by twice that
    specific_heat_J_kg_K=1966.0,  # mineral oil (Panther lubricants, technical learning 12)
)


def _mineral(grade: int, viscosity_100_mm2_s: float, density_15_kg_m3: float) -> OilGrade:
    return replace(
        TELLUS_T46,
        name=f"VG {grade}",
        viscosity_40_mm2_s=float(grade),
        viscosity_100_mm2_s=viscosity_100_mm2_s,
        density_15_kg_m3=density_15_kg_m3,
    )


# Mineral hydraulic oils (ISO 11158 HM). ISO 3448 defines the viscosity at 40 degC. Estimates, no sheet's numbers: at
# 100 degC of a viscosity index of 100 (ISO 2909), density as such oils usually have it. Your oil's sheet has both.
GRADES = {
    oil.name: oil
    for oil in (_mineral(22, 4.3, 866.0), _mineral(32, 5.4, 872.0), _mineral(46, 6.8, 879.0), _mineral(68, 8.7, 886.0))
}


def kinematic_viscosity(temperature_degC: float, grade: OilGrade = TELLUS_T46) -> float:
    """nu [m2/s] by ASTM D341 through the grade's two points; -20..120 degC."""
    at_40, at_100 = (math.log10(math.log10(v + 0.7)) for v in (grade.viscosity_40_mm2_s, grade.viscosity_100_mm2_s))
    low, high, here = (math.log10(t + 273.15) for t in (40.0, 100.0, temperature_degC))
    level = at_40 + (at_100 - at_40) * (here - low) / (high - low)
    return (10 ** (10**level) - 0.7) * 1e-6


def density(
    temperature_degC: float,
    pressure_Pa: float,
    reference: float,
    reference_degC: float,
    modulus_Pa: float,
    grade: OilGrade = TELLUS_T46,
) -> float:
    """rho [kg/m3] from its value `reference` at `reference_degC` and no pressure."""
    warm = reference * (1.0 - grade.expansion_1_K * (temperature_degC - reference_degC))
    return warm / (1.0 - pressure_Pa / modulus_Pa)


def liquid_bulk_modulus(
    temperature_degC: float, pressure_Pa: float, reference: float, reference_degC: float, grade: OilGrade = TELLUS_T46
) -> float:
    """E [Pa] of oil without air from its value `reference` at `reference_degC` and no pressure."""
    decades = -grade.modulus_decades_1_K * (temperature_degC - reference_degC)
    return reference * 10**decades + grade.modulus_pressure * pressure_Pa


def declared_of(grade: OilGrade, temperature_degC: float) -> dict[str, float]:
    """Keys of [oil] that a grade gives at a temperature, without pressure and air."""
    at_20 = 1e9 * (1.57 + 0.15 * math.log10(1e6 * kinematic_viscosity(20.0, grade)))
    return {
        "density_kg_m3": density(temperature_degC, 0.0, grade.density_15_kg_m3, 15.0, math.inf, grade),
        "bulk_modulus_Pa": liquid_bulk_modulus(temperature_degC, 0.0, at_20, 20.0, grade),
    }
