"""The equations of the power unit: characteristic points, derivatives, and the energy identity of its rates."""

import numpy as np
import pytest
from scipy.optimize import brentq

from hexsim import HexsimError
from hexsim.hydraulics import chamber, supply
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed

BAR = 1e5
ATMOSPHERE = 101325.0  # [Pa] the standard one


def unit(**changes):
    """The supply's row of the bench with a power unit."""
    tables = {f"power_unit.{key}": value for key, value in changes.items()} or {"power_unit": {}}
    return supply.declared_supply(changed(load_machine("bench"), tables))


def test_without_a_power_unit_the_supply_is_constant():
    """No table: model 0 and no states, the report's supply."""
    row = supply.declared_supply(load_machine("bench"))
    assert (
        row[supply.S.MODEL] == supply.CONSTANT
        and supply.N_STATES[int(row[supply.S.MODEL])] == 0
        and row[supply.S.PRESSURE] == 7e6
    )


@pytest.mark.parametrize(
    ("bar", "litres_min"),
    [(71.0, 0.0), (70.0, 0.0), (69.0, 4.5), (68.0, 9.0), (66.0, 18.0), (50.0, 18.0), (0.0, 18.0)],
)
def test_compensator_characteristic(bar, litres_min):
    """No flow from 70 bar on, 18 l/min 4 bar below, linear between, and no more further down."""
    flow = supply.pump_flow_command(unit(), 1.0, bar * BAR)
    assert flow * 6e4 == pytest.approx(litres_min, abs=1e-9)


def test_motor_never_beyond_its_rating():
    """A pump too large for its motor is held at 2.5 kW: 2500 W at every pressure at which it would take more."""
    row = unit(pump_flow_max_m3_s=1e-3)
    for bar in (30.0, 50.0, 65.0):
        flow = supply.pump_flow_command(row, 1.0, bar * BAR)
        assert supply.motor_power(row, 1.0, flow, bar * BAR) == pytest.approx(2500.0, rel=1e-9)


def test_motor_power_of_the_report_at_full_flow():
    """18 l/min at 66 bar with case drain and friction takes 2.0 to 2.5 kW: motor and flow limit fit each other."""
    row = unit()
    assert 2000.0 < supply.motor_power(row, 1.0, supply.pump_flow_command(row, 1.0, 66 * BAR), 66 * BAR) < 2500.0


@pytest.mark.parametrize(("litres_out", "bar"), [(0.05, 68.7), (0.2, 64.9), (0.5, 58.5)])
def test_accumulator_gives_oil_by_the_gas_law(litres_out, bar):
    """4 l, 0.8 P0, n = 1.3: three points of a table that took gauge for absolute pressure (2 %), rounded (2 ml)."""
    row = unit()
    full = supply.accumulator_oil(row, 70 * BAR)
    assert (full - supply.accumulator_oil(row, bar * BAR)) * 1e3 == pytest.approx(litres_out, rel=0.02, abs=0.002)


def test_accumulator_shut_below_its_precharge():
    """No oil, no energy and only the oil's own capacity below 56 bar."""
    row = unit()
    assert supply.accumulator_oil(row, 55 * BAR) == 0.0
    assert supply.accumulator_energy(row, 55 * BAR) == 0.0
    assert (
        supply.pump_side_capacity(row, 55 * BAR)
        == row[supply.S.PUMP_SIDE_VOLUME] / row[supply.S.BULK_MODULUS] + row[supply.S.HOSE_COMPLIANCE]
    )


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.4])
@pytest.mark.parametrize("bar", [57.0, 65.0, 75.0])
def test_capacity_and_energy_are_the_derivatives_of_the_gas_law(exponent, bar):
    """C_p = dV_oil/dP + V/E and d(energy)/dP = P dV_oil/dP, by central differences (error of order h^2: 1e-6)."""
    row, pressure, h = unit(polytropic_exponent=exponent), bar * BAR, 1e3
    slope = (supply.accumulator_oil(row, pressure + h) - supply.accumulator_oil(row, pressure - h)) / (2 * h)
    oil = row[supply.S.PUMP_SIDE_VOLUME] / row[supply.S.BULK_MODULUS] + row[supply.S.HOSE_COMPLIANCE]
    assert supply.pump_side_capacity(row, pressure) - oil == pytest.approx(slope, rel=1e-6, abs=0.0)
    work = (supply.accumulator_energy(row, pressure + h) - supply.accumulator_energy(row, pressure - h)) / (2 * h)
    assert work == pytest.approx(pressure * slope, rel=1e-6)


def test_relief_valve_opens_at_its_setting():
    """Shut at 80 bar, 18 l/min at 3 bar beyond."""
    row = unit()
    assert supply.relief_flow(row, 80 * BAR) == 0.0
    assert supply.relief_flow(row, 83 * BAR) * 6e4 == pytest.approx(18.0, rel=1e-9)


def test_line_loses_what_its_parts_lose():
    """At 18 l/min: hose 0.3, filter 0.5 and fittings 0.9 bar (laminar ones by Hagen-Poiseuille), odd in the flow."""
    row = unit()
    total = supply.line_drop(row, 3e-4) / BAR
    viscosity = 860.0 * 57.3e-6 * 1.15  # [Pa s] at 35 degC and 70 bar: 57.3 mm2/s, exp(2e-8 7e6) = 1.15
    hose = 128 * viscosity * 3.0 / (np.pi * 0.016**4) * 3e-4 / BAR
    assert total == pytest.approx(hose + 0.51 + 0.9, rel=0.01)
    assert supply.line_drop(row, -3e-4) == -supply.line_drop(row, 3e-4)


def random_states(count=50, seed=3):
    random = np.random.default_rng(seed)
    low = np.array([0.0, 0.0, -1e-4, 40 * BAR, 10.0, 30 * BAR])
    high = np.array([1.0, 4e-4, 5e-4, 85 * BAR, 70.0, 85 * BAR])
    return random.uniform(low, high, (count, len(supply.U)))


def test_energy_identity_of_the_rates():
    """At any state: motor power = power to the legs + heat + what accumulator, oil and line take up, to rounding."""
    row = unit()
    row[supply.S.BURST] = 1e-8
    for state in random_states():
        speed, flow, line_flow, pump_pressure, _, pressure = state
        demand = 2e-4
        rate = supply.power_unit_rates(row, tuple(state), 1.0, demand, 0.0)
        given = supply.motor_power(row, speed, flow, pump_pressure)
        heat = supply.power_unit_heat(row, speed, line_flow, pump_pressure, pressure)
        stored = pump_pressure * supply.pump_side_capacity(row, pump_pressure) * rate[supply.U.PUMP_PRESSURE]
        stored += row[supply.S.LINE_INERTANCE] * line_flow * rate[supply.U.LINE_FLOW]
        stored += pressure * supply.manifold_capacity(row, pressure) * rate[supply.U.PRESSURE]
        assert given == pytest.approx(pressure * demand + heat + stored, abs=1e-8 * max(given, abs(stored), 1.0))


def test_reservoir_temperature_settles_where_cooling_takes_the_heat():
    """dT/dt turns its sign at ambient + heat/k; without cooling 1 kW warms 50 l by 0.71 K a minute."""
    row = unit(cooling_W_K=0.0)
    state = tuple(np.where(np.arange(6) == supply.U.TEMPERATURE, 35.0, 0.0))
    rate = supply.power_unit_rates(row, state, 0.0, 0.0, 1000.0)[supply.U.TEMPERATURE]
    assert rate * 60 == pytest.approx(60e3 / (860 * 1966 * 0.05), rel=1e-9)
    cooled = unit(cooling_W_K=40.0)
    for temperature, sign in ((44.0, 1), (46.0, -1)):
        state = tuple(np.where(np.arange(6) == supply.U.TEMPERATURE, temperature, 0.0))
        assert np.sign(supply.power_unit_rates(cooled, state, 0.0, 0.0, 1000.0)[supply.U.TEMPERATURE]) == sign


def test_start_is_at_rest():
    """At the starting state nothing moves but the temperature (case drain and friction warm the oil)."""
    row = unit()
    rate = np.array(supply.power_unit_rates(row, tuple(supply.power_unit_start(row)), 1.0, 0.0, 0.0))
    assert rate[supply.U.TEMPERATURE] * row[supply.S.HEAT_CAPACITY] == pytest.approx(
        150 + 2.4e-12 * 7e6**2 - 40 * (35 - 20), rel=1e-9
    )
    rate[supply.U.TEMPERATURE] = 0.0
    assert np.array_equal(rate, np.zeros(len(supply.U)))


def test_check_valve_holds_the_pressure_of_a_stopped_pump():
    """Motor off and at rest, no demand: neither pressure changes."""
    row = unit()
    state = supply.power_unit_start(row)
    state[supply.U.SPEED] = 0.0
    rate = supply.power_unit_rates(row, tuple(state), 0.0, 0.0, 0.0)
    assert rate[supply.U.PUMP_PRESSURE] == 0.0 and rate[supply.U.PRESSURE] == 0.0


def test_precharge_is_absolute():
    """0.8 of 70 bar gauge is 57.01 bar from vacuum."""
    assert unit()[supply.S.PRECHARGE] == 0.8 * 70 * BAR + ATMOSPHERE


@pytest.mark.parametrize("bar", [70.0, 45.0])
def test_gas_accumulator_behind_a_line_is_a_polytropic_gas(bar):
    """The effect's gas: the volume asked for at 70 bar, V P^(1/n) constant (absolute), and C = -dV/dP by difference."""
    numbers = {"gas_volume_m3": 4e-4, "line_resistance_Pa_s_m3": 5e9, "polytropic_exponent": 1.2}
    row = resolve(changed(load_machine("bench"), {"effects.gas_accumulator": numbers})).supply
    pressure, step = bar * BAR, 10.0
    expected = 4e-4 * ((70 * BAR + ATMOSPHERE) / (pressure + ATMOSPHERE)) ** (1 / 1.2)
    assert supply.gas_volume(row, pressure) == pytest.approx(expected, rel=1e-12)
    slope = (supply.gas_volume(row, pressure - step) - supply.gas_volume(row, pressure + step)) / (2 * step)
    assert supply.line_capacity(row, pressure) == pytest.approx(slope, rel=1e-6)


def test_an_effect_that_replaces_the_power_unit_is_refused():
    """supply_droop beside [power_unit] ends in a sentence that says what to do."""
    machine = changed(
        load_machine("bench"), {"power_unit": {}, "effects.supply_droop": {"line_resistance_Pa_s_m3": 2.4e9}}
    )
    with pytest.raises(HexsimError, match=r"has a \[power_unit\] and an effect that replaces it .* keep one of them"):
        resolve(machine)


def test_a_power_unit_refuses_a_motor_that_cannot_turn_it():
    """Friction above the motor's rating is refused with both numbers."""
    with pytest.raises(HexsimError, match=r"pump_friction_W = 3000 must be below motor_power_W = 2500"):
        unit(pump_friction_W=3000.0)


def test_model_number_of_a_power_unit():
    """The row carries six states, Ps last."""
    row = unit()
    assert (
        row[supply.S.MODEL] == supply.POWER_UNIT
        and supply.N_STATES[int(row[supply.S.MODEL])] == 6
        and max(supply.U) == supply.U.PRESSURE
    )


def test_the_line_rings_as_a_distributed_one_does():
    """First mode of a line on an accumulator with the manifold at its end, x tan x = C_hose/C_manifold with c = sqrt(E_h/rho):
    half of the hose at either end comes within 8.1 %, all of it at the manifold would be 27 % low.
    """
    machine = changed(load_machine("micro_motion_system"), {"power_unit": {}})
    row, parts = supply.declared_supply(machine), machine.power_unit
    bore = np.pi / 4 * parts.line_diameter_m**2
    hose = bore * parts.line_length_m / parts.hose_modulus_Pa
    oil = row[supply.S.MANIFOLD_VOLUME] / row[supply.S.BULK_MODULUS]
    x = brentq(lambda x: x * np.tan(x) - hose / oil, 1e-3, np.pi / 2 - 1e-6)
    distributed = x * np.sqrt(parts.hose_modulus_Pa / machine.oil.density_kg_m3) / parts.line_length_m
    inertance = machine.oil.density_kg_m3 * parts.line_length_m / bore
    assert row[supply.S.LINE_INERTANCE] == pytest.approx(inertance)
    lumped = 1 / np.sqrt(inertance * supply.manifold_capacity(row, row[supply.S.PRESSURE]))
    assert 0.915 < lumped / distributed < 1.0
    assert supply.manifold_capacity(row, 0.0) - oil == pytest.approx(hose / 2)


def test_a_manifold_without_oil_keeps_the_vapour_pressure_and_its_void():
    """Below vapour pressure neither line nor pump feels more than 1.01 bar below the atmosphere, and the void grows by what the
    legs take beyond what comes.
    """
    row = unit()
    deep = supply.power_unit_start(row)
    deep[supply.U.PRESSURE] = chamber.VAPOUR - 5e8
    at = deep.copy()
    at[supply.U.PRESSURE] = chamber.VAPOUR
    rates = [np.array(supply.power_unit_rates(row, tuple(state), 1.0, 4e-4, 0.0)) for state in (deep, at)]
    np.testing.assert_array_equal(*rates)
    assert rates[0][supply.U.PRESSURE] * supply.manifold_capacity(row, chamber.VAPOUR) == pytest.approx(-4e-4)
    line = np.zeros(supply.N_SUPPLY)
    line[supply.S.PRESSURE], line[supply.S.RESISTANCE], line[supply.S.CAPACITY] = 7e6, 2e10, 6e-12
    for h in (0.0, 1e-4):
        rate = supply.line_rate(line, chamber.VAPOUR - 1e7, 1e-3, 7e6, h)
        assert rate == pytest.approx(((7e6 - chamber.VAPOUR) / 2e10 - 1e-3) / 6e-12)
