"""Units as people write them become the unit that is meant, or are refused."""

import math

import pytest

from hexsim import HexsimError
from hexsim.signals import units

LITRE_A_MINUTE = 1e-3 / 60


@pytest.mark.parametrize(
    ("spellings", "factor"),
    [
        (("L/min", "l/min", "LPM", "lpm", "litres/min", "l·min⁻¹", "dm3/min"), LITRE_A_MINUTE),
        (("l/s", "L/s", "dm³/s"), 1e-3),
        (("m3/h", "m³/h", "m^3/h"), 1 / 3600),
        (("cm3/s", "cm³/s", "cc/s", "mL/s"), 1e-6),
        (("PSI", "Psi", "psi", "psig", "lbf/in²"), units.EXACT.psi_Pa),
        (("Bar", "BAR", "bar", "barg", "bar(g)", "bar g"), 1e5),
        (("hPa", "mbar"), 1e2),
        (("MPa", "MPA", "N/mm2", "N/mm²"), 1e6),
        (("kPa", "KPa", "kpa"), 1e3),
        (("mm/s2", "mm/s²", "mm/s^2", "mm/s/s", "mm s-2", "mm*s^-2"), 1e-3),
        (("°", "deg", "Deg", "degrees"), math.pi / 180),
        (("°/s", "deg/s", "deg s-1", "dps"), math.pi / 180),
        (("1/min", "min-1", "min^-1", "rpm", "RPM", "U/min", "rev/min"), math.pi / 30),
        (("\N{GREEK SMALL LETTER MU}m", "\N{MICRO SIGN}m", "um", "micron"), 1e-6),
        (("\N{GREEK SMALL LETTER MU}s", "\N{MICRO SIGN}s", "us"), 1e-6),
        (("MM", "mm", "[mm]"), 1e-3),
        (("inch", "Inch", "in", '"'), units.EXACT.inch_m),
        (("g", "G"), 9.80665),
        (("kN", "KN"), 1e3),
        (("volts", "Volt", "V"), 1.0),
    ],
)
def test_common_spellings_are_one_unit(spellings, factor):
    """Capitals, powers, signs and slashes in any usual form: value_SI = factor value."""
    for spelling in spellings:
        assert units.unit_to_si(spelling, "here") == pytest.approx((factor, 0.0), rel=1e-12), spelling


@pytest.mark.parametrize("unit", ["mPa", "MV", "MA", "parsec", "mm/bar", ""])
def test_what_is_ambiguous_or_unknown_is_refused(unit):
    """Mega and milli are told apart by their letter alone, so only the exact letter counts there."""
    with pytest.raises(HexsimError, match="is not known; use one of"):
        units.unit_to_si(unit, "here")


def test_absolute_pressures_and_temperatures_have_an_offset():
    """1.01325 bar absolute is 0 bar gauge; 0 degC is 273.15 K and 32 degF."""
    for spelling, reading, value in (
        ("bar(a)", 1.01325, 0.0),
        ("psia", 1.01325e5 / units.EXACT.psi_Pa, 0.0),
        ("K", 273.15, 0.0),
        ("°F", 32.0, 0.0),
        ("°C", 20.0, 20.0),
        ("℃", 20.0, 20.0),
    ):
        factor, offset = units.unit_to_si(spelling, "here")
        assert factor * reading + offset == pytest.approx(value, abs=1e-9), spelling


@pytest.mark.parametrize(
    ("column", "parts"),
    [
        ("pressure_bottom_2_Pa", ("pressure_bottom_2", "Pa")),
        ("position_mm", ("position", "mm")),
        ("Position [mm]", ("Position", "mm")),
        ("Position (mm)", ("Position", "mm")),
        ("flow [L/min]", ("flow", "l_min")),
        ("acceleration_x_m_s2", ("acceleration_x", "m_s2")),
        ("pressure_a", ("pressure_a", "")),
        ("state [on]", ("state [on]", "")),
    ],
)
def test_the_unit_of_a_column_name(column, parts):
    """At the end of the name or in brackets; a name without one has none."""
    assert units.unit_of_name(column) == parts
