"""Units of measured files and how they become SI: value_SI = factor * value + offset. Spellings as people write them."""

from __future__ import annotations

import math
import re
import unicodedata
from functools import cache
from typing import NamedTuple

from hexsim.declaration import ATMOSPHERE_Pa
from hexsim.errors import HexsimError


class Exact(NamedTuple):
    """Units that are exact by definition."""

    pound_kg: float = 0.45359237  # exact
    inch_m: float = 0.0254  # exact
    gravity_m_s2: float = 9.80665  # standard
    psi_Pa: float = pound_kg * gravity_m_s2 / inch_m**2  # from the three above
    gallon_m3: float = 231.0 * inch_m**3  # of the United States


EXACT = Exact()

DEGREE = math.pi / 180

# name: (factor, offset, dimension). Gauge pressures are the project's; absolute ones lose one standard atmosphere.
UNITS: dict[str, tuple[float, float, str]] = {
    "1": (1.0, 0.0, "1"),
    "%": (0.01, 0.0, "1"),
    "s": (1.0, 0.0, "s"),
    "ms": (1e-3, 0.0, "s"),
    "us": (1e-6, 0.0, "s"),
    "ns": (1e-9, 0.0, "s"),
    "min": (60.0, 0.0, "s"),
    "h": (3600.0, 0.0, "s"),
    "m": (1.0, 0.0, "m"),
    "mm": (1e-3, 0.0, "m"),
    "um": (1e-6, 0.0, "m"),
    "cm": (1e-2, 0.0, "m"),
    "in": (EXACT.inch_m, 0.0, "m"),
    "ft": (12 * EXACT.inch_m, 0.0, "m"),
    "m_s": (1.0, 0.0, "m_s"),
    "mm_s": (1e-3, 0.0, "m_s"),
    "cm_s": (1e-2, 0.0, "m_s"),
    "in_s": (EXACT.inch_m, 0.0, "m_s"),
    "m_min": (1 / 60, 0.0, "m_s"),
    "ft_s": (12 * EXACT.inch_m, 0.0, "m_s"),
    "m_s2": (1.0, 0.0, "m_s2"),
    "mm_s2": (1e-3, 0.0, "m_s2"),
    "cm_s2": (1e-2, 0.0, "m_s2"),
    "in_s2": (EXACT.inch_m, 0.0, "m_s2"),
    "ft_s2": (12 * EXACT.inch_m, 0.0, "m_s2"),
    "g": (EXACT.gravity_m_s2, 0.0, "m_s2"),
    "mg": (1e-3 * EXACT.gravity_m_s2, 0.0, "m_s2"),
    "rad": (1.0, 0.0, "rad"),
    "mrad": (1e-3, 0.0, "rad"),
    "deg": (DEGREE, 0.0, "rad"),
    "rad_s": (1.0, 0.0, "rad_s"),
    "deg_s": (DEGREE, 0.0, "rad_s"),
    "rpm": (math.pi / 30, 0.0, "rad_s"),
    "rev_s": (2 * math.pi, 0.0, "rad_s"),
    "rad_s2": (1.0, 0.0, "rad_s2"),
    "deg_s2": (DEGREE, 0.0, "rad_s2"),
    "Pa": (1.0, 0.0, "Pa"),
    "hPa": (1e2, 0.0, "Pa"),
    "kPa": (1e3, 0.0, "Pa"),
    "MPa": (1e6, 0.0, "Pa"),
    "bar": (1e5, 0.0, "Pa"),
    "mbar": (1e2, 0.0, "Pa"),
    "bara": (1e5, -ATMOSPHERE_Pa, "Pa"),
    "psi": (EXACT.psi_Pa, 0.0, "Pa"),
    "psia": (EXACT.psi_Pa, -ATMOSPHERE_Pa, "Pa"),
    "ksi": (1e3 * EXACT.psi_Pa, 0.0, "Pa"),
    "atm": (ATMOSPHERE_Pa, 0.0, "Pa"),
    "kgf_cm2": (1e4 * EXACT.gravity_m_s2, 0.0, "Pa"),
    "V": (1.0, 0.0, "V"),
    "mV": (1e-3, 0.0, "V"),
    "A": (1.0, 0.0, "A"),
    "mA": (1e-3, 0.0, "A"),
    "N": (1.0, 0.0, "N"),
    "kN": (1e3, 0.0, "N"),
    "lbf": (EXACT.pound_kg * EXACT.gravity_m_s2, 0.0, "N"),
    "kgf": (EXACT.gravity_m_s2, 0.0, "N"),
    "daN": (10.0, 0.0, "N"),
    "kg_s": (1.0, 0.0, "kg_s"),
    "kg_min": (1 / 60, 0.0, "kg_s"),
    "kg_h": (1 / 3600, 0.0, "kg_s"),
    "g_s": (1e-3, 0.0, "kg_s"),
    "kg": (1.0, 0.0, "kg"),
    "lb": (EXACT.pound_kg, 0.0, "kg"),
    "m3_s": (1.0, 0.0, "m3_s"),
    "m3_h": (1 / 3600, 0.0, "m3_s"),
    "m3_min": (1 / 60, 0.0, "m3_s"),
    "l_min": (1e-3 / 60, 0.0, "m3_s"),
    "l_s": (1e-3, 0.0, "m3_s"),
    "l_h": (1e-3 / 3600, 0.0, "m3_s"),
    "ml_min": (1e-6 / 60, 0.0, "m3_s"),
    "ml_s": (1e-6, 0.0, "m3_s"),
    "cm3_min": (1e-6 / 60, 0.0, "m3_s"),
    "cm3_s": (1e-6, 0.0, "m3_s"),
    "mm3_s": (1e-9, 0.0, "m3_s"),
    "gpm": (EXACT.gallon_m3 / 60, 0.0, "m3_s"),
    "in3_s": (EXACT.inch_m**3, 0.0, "m3_s"),
    "Hz": (1.0, 0.0, "Hz"),
    "kHz": (1e3, 0.0, "Hz"),
    "W": (1.0, 0.0, "W"),
    "kW": (1e3, 0.0, "W"),
    "J": (1.0, 0.0, "J"),
    "m3": (1.0, 0.0, "m3"),
    "l": (1e-3, 0.0, "m3"),
    "K": (1.0, -273.15, "degC"),
    "degC": (1.0, 0.0, "degC"),
    "degF": (5 / 9, -160 / 9, "degC"),
}
# Other names, in small letters after `normalised`.
NAMES = {
    "s": "sec secs second seconds",
    "ms": "msec millisecond milliseconds",
    "us": "usec microsecond microseconds",
    "min": "minute minutes",
    "h": "hr hour hours",
    "m": "meter meters metre metres",
    "mm": "millimeter millimeters millimetre millimetres",
    "um": "micron microns micrometer micrometers micrometre micrometres",
    "cm": "centimeter centimetre",
    "in": 'inch inches "',
    "ft": "foot feet",
    "m_s": "mps",
    "mm_s": "mmps",
    "in_s": "ips inch_s",
    "m_s2": "mps2",
    "g": "gn g0",
    "deg": "degree degrees",
    "deg_s": "dps degree_s degrees_s",
    "rad": "radian radians",
    "rpm": "1_min rev_min r_min u_min turns_min",
    "rev_s": "rps 1_s r_s",
    "Pa": "pascal",
    "bar": "barg bar_g bar_gauge",
    "bara": "bar_a bar_abs",
    "MPa": "n_mm2 mpag",
    "kPa": "kpag",
    "psi": "psig psi_g lb_in2 lbf_in2",
    "psia": "psi_a",
    "kgf_cm2": "kg_cm2 kp_cm2",
    "V": "volt volts",
    "mV": "millivolt millivolts",
    "A": "amp amps ampere amperes",
    "mA": "milliamp milliamps",
    "N": "newton newtons",
    "lbf": "pound_force",
    "kg": "kilogram kilograms",
    "lb": "lbs pound pounds",
    "l_min": "lpm liter_min litre_min liters_min litres_min dm3_min ltr_min",
    "l_s": "lps liter_s litre_s dm3_s",
    "l_h": "lph",
    "ml_min": "cc_min",
    "ml_s": "cc_s",
    "gpm": "gal_min usgpm",
    "in3_s": "cu_in_s",
    "degC": "c celsius deg_c",
    "degF": "f fahrenheit deg_f",
    "K": "kelvin",
    "1": "- none ratio",
    "%": "percent pct",
}
MEGA_OR_MILLI = ("mPa", "mpa", "MV", "MA", "MG")  # told apart by their capital alone: no spelling of MPa, mV, mA, mg


def normalised(text: str) -> str:
    """A unit as `m_s2`: signs and powers of all kinds, 1/s, s-1, s^-1, m/s/s, with one form for each."""
    text = unicodedata.normalize("NFKC", text.strip().strip("[]")).replace("\N{MINUS SIGN}", "-")
    text = text.replace("\N{GREEK SMALL LETTER MU}", "u").replace("°", "deg").replace("**", "").replace("^", "")
    text = re.sub(r"\((.*?)\)", r" \1", text)
    powers: dict[str, int] = {}
    for place, part in enumerate(text.split("/")):
        for token in re.split(r"[\s*·⋅]+", part.strip()):
            base = re.sub(r"-?\d$", "", token)
            if base:
                powers[base] = powers.get(base, 0) + int(token.removeprefix(base) or 1) * (-1 if place else 1)
    above = [f"{base}{power if power > 1 else ''}" for base, power in powers.items() if power > 0]
    below = [f"{base}{-power if power < -1 else ''}" for base, power in powers.items() if power < 0]
    return "_".join([*(above or ["1"]), *below]) if powers else text


@cache
def _spellings() -> dict[str, str]:
    """Names in small letters -> unit."""
    found = {spelling: name for name in UNITS for spelling in NAMES.get(name, "").split()}
    return {name.lower(): name for name in UNITS} | found


def canonical(text: str) -> str | None:
    """The unit of UNITS that is meant, in capitals or small letters; None for one that is not known."""
    for name in (text.strip(), normalised(text)):
        if name in UNITS:
            return name
        if name not in MEGA_OR_MILLI and (found := _spellings().get(name.lower())):
            return found
    return None


def unit_to_si(unit: str, where: str, target: str | None = None) -> tuple[float, float]:
    """(factor, offset) of a unit. `target`: SI unit that the column has; HexsimError when the kinds differ."""
    name = canonical(unit)
    if name is None:
        raise HexsimError(f"{where}: unit {unit!r} is not known; use one of {', '.join(UNITS)}, or factor and offset")
    factor, offset, dimension = UNITS[name]
    if target is not None and UNITS.get(target, (1, 0, target))[2] != dimension:
        raise HexsimError(f"{where}: unit {unit!r} cannot become {target!r}; name a unit of the same kind")
    return factor, offset


def unit_of_name(column: str) -> tuple[str, str]:
    """(stem, unit) of a column name with its unit at the end or in brackets: ("pressure_bottom_2", "Pa"), ("name", "").

    position_mm, "position [mm]" and "Position (mm)" are alike.
    """
    bracket = re.fullmatch(r"(.*?)[\s_]*[\[(](.+)[\])]", column.strip())
    if bracket and not bracket[2].strip().isdigit() and (unit := canonical(bracket[2])):  # u[1] is a place
        return bracket[1], unit
    parts = column.split("_")
    for size in (2, 1):
        ending = "_".join(parts[-size:])
        if len(parts) > size and (ending in UNITS or (len(ending) > 1 and canonical(ending))):
            return "_".join(parts[:-size]), canonical(ending) or ending
    return column, ""
