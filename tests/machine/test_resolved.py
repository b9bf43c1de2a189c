"""The machine as the plant builds it: declared values with effects, power unit and oil temperature."""

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics import parameters
from hexsim.hydraulics import supply as supplies
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve, warm_oil
from hexsim.machine.files import changed


@pytest.mark.parametrize("name", ["bench", "hexapod"])
def test_without_effects_everything_is_as_declared(name, request):
    """Rows, constant supply, load, sensors and gravity of the file; no payload mode."""
    machine = request.getfixturevalue(name)
    made = resolve(machine)
    np.testing.assert_array_equal(made.rows, parameters.declared_rows(machine))
    assert made.supply[supplies.S.MODEL] == supplies.CONSTANT and made.supply[supplies.S.PRESSURE] == 7.0e6
    assert made.load == machine.load and made.sensors == machine.sensors
    np.testing.assert_array_equal(made.gravity_m_s2, [0, 0, -9.8])
    assert made.payload_modes == []
    assert {n: v.shape for n, v in made.leg_sensors.items()} == dict.fromkeys(made.leg_sensors, (machine.n_legs,))


def test_resolving_twice_is_the_same(hexapod):
    """The machine is not changed by resolving, and two resolved machines share no array."""
    machine = changed(hexapod, {"effects.null_offset.offset_V": 0.1})
    first, second = resolve(machine), resolve(machine)
    np.testing.assert_array_equal(first.rows, second.rows)
    first.rows[:] = 0.0
    assert second.rows[0, P.NULL_OFFSET] == 0.1


def test_mass_change_reaches_the_load(bench, hexapod):
    """4 kg more: on the bench's mass, or on the platform's with its inertia as declared."""
    assert resolve(changed(bench, {"effects.mass_change.mass_kg": 4.0})).load.moving_mass_kg == 44.0
    load = resolve(changed(hexapod, {"effects.mass_change.mass_kg": 4.0})).load
    assert load.platform_mass_kg == 604.0 and load.platform_inertia_kg_m2 == hexapod.load.platform_inertia_kg_m2


def test_incline_tilts_gravity_and_keeps_its_size(hexapod):
    """An inclined machine feels gravity from another side, 9.8 m/s2 as before."""
    gravity = resolve(changed(hexapod, {"effects.incline": {"angle_rad": 0.3}})).gravity_m_s2
    assert np.linalg.norm(gravity) == pytest.approx(9.8, rel=1e-12)
    assert gravity[2] == pytest.approx(-9.8 * np.cos(0.3), rel=1e-12)


def test_spool_lags_add_up(bench):
    """A lag of 60 Hz on a spool of 60 Hz, damping 0.7 both: delays 2 zeta/w add, so 30 Hz."""
    machine = changed(bench, {"valve.spool_frequency_Hz": 60.0, "effects.spool_lag.frequency_Hz": 60.0})
    assert resolve(machine).rows[0, P.SPOOL_OMEGA] / (2 * np.pi) == pytest.approx(30.0, rel=1e-12)


def test_power_unit_gives_the_supply_its_states(hexapod):
    """A [power_unit] is the supply, with oil as cold as it says; at 35 degC the rows are as declared."""
    made = resolve(changed(hexapod, {"power_unit.oil_temperature_degC": 35.0}))
    assert made.supply[supplies.S.MODEL] == supplies.POWER_UNIT
    np.testing.assert_allclose(made.rows, parameters.declared_rows(hexapod), rtol=1e-14)
    cold = resolve(changed(hexapod, {"power_unit.oil_temperature_degC": 10.0}))
    assert cold.oil_temperature_degC == 10.0
    assert np.all(cold.rows[:, P.VISCOUS_EXTEND] > 1.2 * made.rows[:, P.VISCOUS_EXTEND])


def test_power_unit_and_droop_exclude_each_other(hexapod):
    """Two models of one supply are refused by name."""
    droop = {"line_resistance_Pa_s_m3": 2.4e9}
    with pytest.raises(HexsimError, match=r"has a \[power_unit\] and an effect that replaces it"):
        resolve(changed(hexapod, {"power_unit.motor_power_W": 2500.0, "effects.supply_droop": droop}))


def test_warming_and_cooling_is_a_round_trip(hexapod):
    """35 -> 60 -> 35 degC brings rows and supply back to 1e-12; zeros (neutral effects) stay zero on the way."""
    made = resolve(changed(hexapod, {"power_unit.oil_temperature_degC": 35.0}))
    rows, supply = made.rows.copy(), made.supply.copy()
    warm_oil(made, 60.0)
    softer = 10 ** (-0.0024 * 25)  # Hayward 1970: 13 % over 25 K
    np.testing.assert_allclose(made.rows[:, P.BULK_MODULUS], softer * rows[:, P.BULK_MODULUS], rtol=1e-12)
    assert made.supply[supplies.S.BULK_MODULUS] == pytest.approx(softer * supply[supplies.S.BULK_MODULUS], rel=1e-12)
    np.testing.assert_allclose(made.rows[:, P.DENSITY], 860 * (1 - 7e-4 * 25), rtol=1e-12)
    np.testing.assert_array_equal(made.rows[rows == 0.0], 0.0)
    warm_oil(made, 35.0)
    # density, modulus and viscosity are not exact inverses of themselves: thermal expansion is linear in T
    np.testing.assert_allclose(made.rows, rows, rtol=1e-12)
    np.testing.assert_allclose(made.supply, supply, rtol=1e-12)
