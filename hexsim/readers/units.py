"""Units of measured files and how they become SI: value_SI = factor * value + offset."""

from __future__ import annotations

import math

from hexsim.errors import HexsimError

POUND_kg = 0.45359237
INCH_m = 0.0254
STANDARD_GRAVITY = 9.80665
PSI_Pa = POUND_kg * STANDARD_GRAVITY / INCH_m**2
ATMOSPHERE_Pa = 1.01325e5

# name: (factor, offset, dimension). Gauge pressures are the project's; absolute ones lose one standard atmosphere.
UNITS: dict[str, tuple[float, float, str]] = {
    "1": (1.0, 0.0, "1"), "%": (0.01, 0.0, "1"),
    "s": (1.0, 0.0, "s"), "ms": (1e-3, 0.0, "s"), "us": (1e-6, 0.0, "s"), "ns": (1e-9, 0.0, "s"),
    "min": (60.0, 0.0, "s"),
    "m": (1.0, 0.0, "m"), "mm": (1e-3, 0.0, "m"), "um": (1e-6, 0.0, "m"), "cm": (1e-2, 0.0, "m"),
    "in": (INCH_m, 0.0, "m"), "inch": (INCH_m, 0.0, "m"), "ft": (12 * INCH_m, 0.0, "m"),
    "m_s": (1.0, 0.0, "m_s"), "mm_s": (1e-3, 0.0, "m_s"), "in_s": (INCH_m, 0.0, "m_s"),
    "m_s2": (1.0, 0.0, "m_s2"), "mm_s2": (1e-3, 0.0, "m_s2"), "g": (STANDARD_GRAVITY, 0.0, "m_s2"),
    "mg": (1e-3 * STANDARD_GRAVITY, 0.0, "m_s2"),
    "rad": (1.0, 0.0, "rad"), "deg": (math.pi / 180, 0.0, "rad"),
    "rad_s": (1.0, 0.0, "rad_s"), "deg_s": (math.pi / 180, 0.0, "rad_s"), "rpm": (math.pi / 30, 0.0, "rad_s"),
    "rad_s2": (1.0, 0.0, "rad_s2"), "deg_s2": (math.pi / 180, 0.0, "rad_s2"),
    "Pa": (1.0, 0.0, "Pa"), "kPa": (1e3, 0.0, "Pa"), "MPa": (1e6, 0.0, "Pa"), "bar": (1e5, 0.0, "Pa"),
    "mbar": (1e2, 0.0, "Pa"), "psi": (PSI_Pa, 0.0, "Pa"), "psig": (PSI_Pa, 0.0, "Pa"),
    "psia": (PSI_Pa, -ATMOSPHERE_Pa, "Pa"), "bara": (1e5, -ATMOSPHERE_Pa, "Pa"),
    "V": (1.0, 0.0, "V"), "mV": (1e-3, 0.0, "V"), "A": (1.0, 0.0, "A"), "mA": (1e-3, 0.0, "A"),
    "N": (1.0, 0.0, "N"), "kN": (1e3, 0.0, "N"), "lbf": (POUND_kg * STANDARD_GRAVITY, 0.0, "N"),
    "kg": (1.0, 0.0, "kg"), "lb": (POUND_kg, 0.0, "kg"),
    "m3_s": (1.0, 0.0, "m3_s"), "l_min": (1e-3 / 60, 0.0, "m3_s"), "gpm": (3.785411784e-3 / 60, 0.0, "m3_s"),
    "K": (1.0, -273.15, "degC"), "degC": (1.0, 0.0, "degC"), "degF": (5 / 9, -160 / 9, "degC"),
}  # fmt: skip
SPELLINGS = {
    "m/s": "m_s", "m/s2": "m_s2", "m/s^2": "m_s2", "m/s²": "m_s2", "mm/s": "mm_s", "in/s": "in_s", "rad/s": "rad_s",
    "rad/s2": "rad_s2", "rad/s^2": "rad_s2", "deg/s": "deg_s", "deg/s2": "deg_s2", "deg/s^2": "deg_s2", "°": "deg",
    "l/min": "l_min", "m3/s": "m3_s", "°C": "degC", "µm": "um", "µs": "us", "sec": "s", "volt": "V", "-": "1",
}  # fmt: skip


def unit_to_si(unit: str, where: str, wanted: str | None = None) -> tuple[float, float]:
    """(factor, offset) of a unit. `wanted`: SI unit that the column has; HexsimError when the kinds differ."""
    name = SPELLINGS.get(unit.strip(), unit.strip())
    if name not in UNITS:
        raise HexsimError(f"{where}: unit {unit!r} is not known; use one of {', '.join(UNITS)}, or factor and offset")
    factor, offset, dimension = UNITS[name]
    if wanted is not None and UNITS.get(wanted, (1, 0, wanted))[2] != dimension:
        raise HexsimError(f"{where}: unit {unit!r} cannot become {wanted!r}; name a unit of the same kind")
    return factor, offset


def unit_of_name(column: str) -> tuple[str, str]:
    """(stem, unit) of a column name with its unit at the end: ("pressure_bottom_2", "Pa"); ("name", "") without one."""
    parts = column.split("_")
    for size in (2, 1):
        if len(parts) > size and "_".join(parts[-size:]) in UNITS:
            return "_".join(parts[:-size]), "_".join(parts[-size:])
    return column, ""
