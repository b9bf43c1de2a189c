"""Oil: density, viscosity and bulk modulus over temperature and pressure, and what they do to a machine's numbers.

    rho(T, P) = rho_0 [1 - b (T - T0)] / (1 - P/E)                thermal expansion b, compression
    lg lg(nu + 0.7) = A - B lg(T + 273.15)                        nu in mm2/s, T in degC          ASTM D341 (Walther)
    eta(T, P) = rho nu(T) exp(a P)                                                                Barus
    E(T, P) = E_0 10^[-c (T - T0)] + e P                          liquid, isentropic tangent      Hayward 1970
    E_mix   = `chamber.bulk_modulus` of E(T, P)                   with entrained air

A machine file declares density and bulk modulus at one temperature ([oil] temperature_degC). Only ratios to it are
used here, so nothing changes at that temperature. The legs take E at T without the term e P: a declared bulk modulus is
one at working pressure (e P is 5 % of it at 70 bar).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hexsim.hydraulics import chamber
from hexsim.hydraulics.parameters import P

KELVIN = 273.15


@dataclass(frozen=True, kw_only=True)
class OilGrade:
    """What an oil's grade says beyond the declared density and bulk modulus."""

    name: str
    viscosity_40_mm2_s: float
    viscosity_100_mm2_s: float
    expansion_1_K: float
    viscosity_pressure_1_Pa: float
    modulus_decades_1_K: float
    modulus_pressure: float
    specific_heat_J_kg_K: float


# Shell's sheet of Tellus T46 was not at hand. 46 mm2/s at 40 degC is ISO 3448's definition of the grade; 7.9 mm2/s at
# 100 degC (viscosity index 143) is typical of multigrade oils of this class (ISO 11158 HV), which Tellus T is.
TELLUS_T46 = OilGrade(
    name="Shell Tellus T46",
    viscosity_40_mm2_s=46.0,
    viscosity_100_mm2_s=7.9,
    expansion_1_K=7.0e-4,  # mineral oils, commonly used; 872 kg/m3 at 15 degC of this class against 860 at 35: 6.9e-4
    viscosity_pressure_1_Pa=2.0e-8,  # machine oils: 1.8e-8 .. 2.8e-8 (Stachowiak, Engineering Tribology, table 2.3)
    modulus_decades_1_K=0.0024,  # Hayward 1970: 10^(0.0024 (20 - T))
    modulus_pressure=11.2,  # Hayward 1970: secant modulus rises by 5.6 P, the tangent by twice that
    specific_heat_J_kg_K=1966.0,  # mineral oil (Panther lubricants, technical learning 12)
)


def kinematic_viscosity(temperature_degC: float, grade: OilGrade = TELLUS_T46) -> float:
    """nu [m2/s] by ASTM D341 through the grade's two points; -20..120 degC."""
    at_40, at_100 = (math.log10(math.log10(v + 0.7)) for v in (grade.viscosity_40_mm2_s, grade.viscosity_100_mm2_s))
    low, high, here = (math.log10(t + KELVIN) for t in (40.0, 100.0, temperature_degC))
    level = at_40 + (at_100 - at_40) * (here - low) / (high - low)
    return (10 ** (10**level) - 0.7) * 1e-6


def density(temperature_degC: float, pressure_Pa: float, reference: float, reference_degC: float, modulus_Pa: float,
            grade: OilGrade = TELLUS_T46) -> float:  # fmt: skip
    """rho [kg/m3] from its value `reference` at `reference_degC` and no pressure."""
    warm = reference * (1.0 - grade.expansion_1_K * (temperature_degC - reference_degC))
    return warm / (1.0 - pressure_Pa / modulus_Pa)


def dynamic_viscosity(
    temperature_degC: float, pressure_Pa: float, density_kg_m3: float, grade: OilGrade = TELLUS_T46
) -> float:
    """eta [Pa s] at gauge pressure."""
    thickening = math.exp(grade.viscosity_pressure_1_Pa * pressure_Pa)
    return density_kg_m3 * kinematic_viscosity(temperature_degC, grade) * thickening


def liquid_bulk_modulus(temperature_degC: float, pressure_Pa: float, reference: float, reference_degC: float,
                        grade: OilGrade = TELLUS_T46) -> float:  # fmt: skip
    """E [Pa] of oil without air from its value `reference` at `reference_degC` and no pressure."""
    decades = -grade.modulus_decades_1_K * (temperature_degC - reference_degC)
    return reference * 10**decades + grade.modulus_pressure * pressure_Pa


def bulk_modulus(temperature_degC: float, pressure_Pa: float, air_fraction: float, reference: float,
                 reference_degC: float, grade: OilGrade = TELLUS_T46) -> float:  # fmt: skip
    """E [Pa] of oil with entrained air (volume fraction at atmospheric pressure)."""
    liquid = liquid_bulk_modulus(temperature_degC, pressure_Pa, reference, reference_degC, grade)
    return chamber.bulk_modulus(pressure_Pa, liquid, air_fraction)


@dataclass(frozen=True, kw_only=True)
class OilRatios:
    """Properties at one temperature over those at another, without pressure."""

    density: float
    modulus: float
    viscosity: float  # dynamic


def ratios(from_degC: float, to_degC: float, grade: OilGrade = TELLUS_T46) -> OilRatios:
    """What changes on the way from one temperature to another. All 1 when they are equal."""
    expansion = [density(t, 0.0, 1.0, 35.0, math.inf, grade) for t in (from_degC, to_degC)]
    viscosity = [kinematic_viscosity(t, grade) for t in (from_degC, to_degC)]
    dense = expansion[1] / expansion[0]
    return OilRatios(
        density=dense,
        modulus=liquid_bulk_modulus(to_degC, 0.0, 1.0, from_degC, grade),
        viscosity=dense * viscosity[1] / viscosity[0],
    )


# Powers of (density, modulus, viscosity) with which a place of a leg's row follows the oil. Laminar gaps and lines go
# with the viscosity. Viscous friction of seals goes with its root: inverse hydrodynamic lubrication, film ~
# sqrt(eta v), friction ~ eta v / film (Kanters 1990, On the calculation of leakage and friction of reciprocating elastomeric seals).
LEG_POWERS: dict[P, tuple[float, float, float]] = {
    P.DENSITY: (1, 0, 0),
    P.BULK_MODULUS: (0, 1, 0),
    P.LEAK_SUPPLY_CHAMBER: (0, 0, -1),
    P.LEAK_CHAMBER_TANK: (0, 0, -1),
    P.LEAK_PISTON: (0, 0, -1),
    P.LEAK_TOP_TANK: (0, 0, -1),
    P.CLEARANCE_CONDUCTANCE: (0, 0, -1),
    P.RETURN_RESISTANCE: (0, 0, 1),
    P.VISCOUS_EXTEND: (0, 0, 0.5),
    P.VISCOUS_RETRACT: (0, 0, 0.5),
}


def row_factors(powers: dict, size: int, from_degC: float, to_degC: float, grade: OilGrade = TELLUS_T46) -> np.ndarray:
    """Factors (size,) for a row of parameters when the oil goes from one temperature to another."""
    factors = np.ones(size)
    change = ratios(from_degC, to_degC, grade)
    for place, (of_density, of_modulus, of_viscosity) in powers.items():
        factors[place] = change.density**of_density * change.modulus**of_modulus * change.viscosity**of_viscosity
    return factors
