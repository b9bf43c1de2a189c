"""Oil properties over temperature and pressure, and what they do to a machine's rows."""

import math

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics import chamber, oil, parameters
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve, warm_oil
from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import changed, machine_tables


def test_viscosity_passes_through_both_points_of_the_grade():
    """ASTM D341 gives 46 mm2/s at 40 degC (the definition of ISO VG 46) and 7.9 at 100 degC."""
    assert oil.kinematic_viscosity(40.0) == pytest.approx(46e-6, rel=1e-12)
    assert oil.kinematic_viscosity(100.0) == pytest.approx(7.9e-6, rel=1e-12)


def test_viscosity_lies_on_a_line_in_walther_coordinates():
    """lg lg(nu + 0.7) is linear in lg T: three temperatures, one slope."""
    temperatures = np.array([0.0, 25.0, 70.0])
    height = [math.log10(math.log10(oil.kinematic_viscosity(t) * 1e6 + 0.7)) for t in temperatures]
    place = np.log10(temperatures + 273.15)
    slopes = np.diff(height) / np.diff(place)
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-9)
    assert slopes[0] < -3  # an oil, not water: commonly 3 to 4


def test_density_derivatives_are_expansion_and_compressibility():
    """d rho/dT = -b rho_0 and d rho/dP = rho/E at no pressure."""
    at = lambda temperature, pressure: oil.density(temperature, pressure, 860.0, 35.0, 1.5e9)  # noqa: E731
    assert (at(36.0, 0.0) - at(34.0, 0.0)) / 2 == pytest.approx(-oil.TELLUS_T46.expansion_1_K * 860.0, rel=1e-9)
    assert (at(35.0, 1e4) - at(35.0, -1e4)) / 2e4 == pytest.approx(860.0 / 1.5e9, rel=1e-6)


def test_density_of_the_report_fits_the_class_of_the_oil():
    """860 kg/m3 at 35 degC (report) is 872 at 15 degC, what oils of this class have: within 0.2 kg/m3."""
    assert oil.density(15.0, 0.0, 860.0, 35.0, 1.5e9) == pytest.approx(872.0, abs=0.2)


def test_bulk_modulus_falls_by_hayward_and_rises_with_pressure():
    """20 K take 10.5 % off; 70 bar add 11.2 P = 0.078 GPa."""
    warm = oil.liquid_bulk_modulus(55.0, 0.0, 1.5e9, 35.0)
    assert warm / 1.5e9 == pytest.approx(10 ** (-0.048), rel=1e-12)
    assert oil.liquid_bulk_modulus(35.0, 7e6, 1.5e9, 35.0) - 1.5e9 == pytest.approx(7.84e7, rel=1e-9)


def test_entrained_air_joins_by_the_equation_of_the_chamber():
    """With air the modulus is the chamber's formula of the liquid's; without, the liquid's."""
    liquid = oil.liquid_bulk_modulus(50.0, 2e6, 1.5e9, 35.0)
    assert oil.bulk_modulus(50.0, 2e6, 0.0, 1.5e9, 35.0) == liquid
    assert oil.bulk_modulus(50.0, 2e6, 0.007, 1.5e9, 35.0) == chamber.bulk_modulus(2e6, liquid, 0.007)
    assert oil.bulk_modulus(50.0, 2e6, 0.007, 1.5e9, 35.0) < 0.9 * liquid


def test_rows_do_not_change_at_the_declared_temperature():
    """All factors are exactly 1 when the oil stays where it is."""
    assert np.array_equal(
        oil.row_factors(oil.LEG_POWERS, parameters.N_PARAMETERS, 35.0, 35.0), np.ones(parameters.N_PARAMETERS)
    )


def test_rows_there_and_back_are_the_same():
    """Warming and cooling again undo each other to rounding."""
    there = oil.row_factors(oil.LEG_POWERS, parameters.N_PARAMETERS, 20.0, 60.0)
    back = oil.row_factors(oil.LEG_POWERS, parameters.N_PARAMETERS, 60.0, 20.0)
    assert np.abs(there * back - 1).max() < 1e-12
    assert np.abs(there - 1).max() > 0.5  # and it is no small change


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        (P.DENSITY, lambda r: r.density),
        (P.BULK_MODULUS, lambda r: r.modulus),
        (P.LEAK_SUPPLY_CHAMBER, lambda r: 1 / r.viscosity),
        (P.VISCOUS_EXTEND, lambda r: math.sqrt(r.viscosity)),
        (P.COULOMB_EXTEND, lambda r: 1.0),
        (P.STROKE, lambda r: 1.0),
    ],
)
def test_a_cold_start_changes_what_hangs_on_the_oil(place, expected):
    """A power unit that starts at 20 degC: each place of the legs' rows goes with its property, the rest stays."""
    machine = changed(
        load_machine("bench"), {"effects.leakage_supply_to_chamber": {"conductance_m3_s_Pa": 1e-12}, "power_unit": {}}
    )
    cold = changed(machine, {"power_unit.oil_temperature_degC": 20.0})
    factor = resolve(cold).rows[0, place] / resolve(machine).rows[0, place]
    assert factor == pytest.approx(expected(oil.ratios(35.0, 20.0)), rel=1e-12)


def test_viscosity_doubles_on_a_cold_morning():
    """From 35 to 20 degC the oil of this grade becomes about twice as thick (ISO VG 46: 57 to 117 mm2/s)."""
    assert 1.9 < oil.ratios(35.0, 20.0).viscosity < 2.3


@pytest.mark.parametrize(("grade", "viscosity"), [("VG 22", 22.0), ("VG 32", 32.0), ("VG 46", 46.0), ("VG 68", 68.0)])
def test_grade_gives_what_is_not_declared(bench, grade, viscosity):
    """Viscosity at 40 degC is the grade's number; density and modulus fall with temperature; what is declared stays."""
    tables = machine_tables(bench)
    tables["oil"] = {"grade": grade, "temperature_degC": 45.0}
    machine = machine_from_dict(tables)
    assert oil.kinematic_viscosity(40.0, machine.oil.properties) == pytest.approx(viscosity * 1e-6, rel=1e-12)
    assert 840.0 < machine.oil.density_kg_m3 < 880.0
    assert 1.4e9 < machine.oil.bulk_modulus_Pa < 1.8e9
    warm = changed(machine, {"oil.temperature_degC": 65.0})
    assert warm.oil.density_kg_m3 / machine.oil.density_kg_m3 == pytest.approx(1 - 7e-4 * 20, rel=1e-3)
    assert warm.oil.bulk_modulus_Pa / machine.oil.bulk_modulus_Pa == pytest.approx(10 ** (-0.0024 * 20), rel=1e-9)
    own = changed(machine, {"oil.bulk_modulus_Pa": 1.1e9, "oil.viscosity_mm2_s": (30.0, 6.0)})
    assert changed(own, {"oil.temperature_degC": 65.0}).oil.bulk_modulus_Pa == 1.1e9
    assert oil.kinematic_viscosity(100.0, own.oil.properties) == pytest.approx(6e-6, rel=1e-12)


def test_own_viscosities_must_fall(bench):
    """An oil that thickens when warm has its two numbers swapped."""
    with pytest.raises(HexsimError, match="must fall"):
        changed(bench, {"oil.viscosity_mm2_s": (6.0, 30.0)})


def test_power_unit_warms_the_grade(hexapod):
    """A thinner oil loses less viscosity on the way to 60 degC: the leg's rows follow the declared grade."""
    ratio = []
    for grade in ("VG 22", "VG 68"):
        made = resolve(
            changed(
                hexapod,
                {"oil.grade": grade, "power_unit": {}, "effects.leakage_chamber_to_tank.conductance_m3_s_Pa": 2e-12},
            )
        )
        cold = made.rows[0, P.LEAK_CHAMBER_TANK]
        warm_oil(made, 60.0)
        ratio.append(made.rows[0, P.LEAK_CHAMBER_TANK] / cold)
    assert 1.0 < ratio[0] < ratio[1]
