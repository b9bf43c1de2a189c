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

from hexsim.declaration.oil_grades import TELLUS_T46, OilGrade, density, kinematic_viscosity, liquid_bulk_modulus
from hexsim.hydraulics import chamber
from hexsim.hydraulics.parameters import P


def dynamic_viscosity(
    temperature_degC: float, pressure_Pa: float, density_kg_m3: float, grade: OilGrade = TELLUS_T46
) -> float:
    """eta [Pa s] at gauge pressure."""
    thickening = math.exp(grade.viscosity_pressure_1_Pa * pressure_Pa)
    return density_kg_m3 * kinematic_viscosity(temperature_degC, grade) * thickening


def bulk_modulus(
    temperature_degC: float,
    pressure_Pa: float,
    air_fraction: float,
    reference: float,
    reference_degC: float,
    grade: OilGrade = TELLUS_T46,
) -> float:
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
    P.LAMINAR: (-1, 0, 1),  # kinematic viscosity
    P.BULK_MODULUS: (0, 1, 0),
    P.LEAK_SUPPLY_CHAMBER: (0, 0, -1),
    P.LEAK_CHAMBER_TANK: (0, 0, -1),
    P.LEAK_PISTON: (0, 0, -1),
    P.WEAR_CONDUCTANCE: (0, 0, -1),
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
