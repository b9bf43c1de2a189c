"""The rod side as a chamber of its own: a port far faster than the time step neither rings nor invents oil."""

import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.hydraulics import parameters, ports, rod_side
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant, readout
from hexsim.simulation import simulate

CHAMBER = {"cylinder.rod_side": "chamber"}
WIDE, NARROW = 2.0e-6, 2.0e-7  # [m3/s/sqrt(Pa)] 9 and 3 mm: fills the annulus in 2 and 18 us at dp = 0


def heave(machine, duration_s, **options):
    result = simulate(machine, load_scenario("heave", duration_s=duration_s), **options)
    assert result.complete, result.reason
    return {name: result.log[name].to_numpy() for name in result.log.columns}


@pytest.mark.parametrize("conductance", [WIDE, pytest.param(NARROW, marks=pytest.mark.slow)])
def test_ten_times_smaller_steps_change_nothing(conductance):
    """100 us against 10 us: acceleration to 0.01 m/s2 and P2 to 0.01 bar, with a port of 2 us and with one of 18 us."""
    machine = changed(load_machine("bench"), {**CHAMBER, "cylinder.rod_side_conductance_m3_s_sqrtPa": conductance})
    coarse, fine = heave(machine, 1.2, timestep=1e-4), heave(machine, 1.2, timestep=1e-5)
    assert np.abs(coarse["true_acceleration_m_s2"] - fine["true_acceleration_m_s2"]).max() < 0.01
    assert np.abs(coarse["pressure_top_Pa"] - fine["pressure_top_Pa"]).max() < 1e3


def test_a_wide_port_is_the_report_s_annulus():
    """With 9 mm of port the machine moves as with its annulus on the supply line: 0.01 m/s2 rms."""
    plain, wide = heave(load_machine("bench"), 3.0), heave(changed(load_machine("bench"), CHAMBER), 3.0)
    difference = plain["true_acceleration_m_s2"] - wide["true_acceleration_m_s2"]
    assert np.sqrt(np.mean(difference**2)) < 0.01


@pytest.mark.parametrize("timestep", [1e-4, None])
def test_energy_closes_with_a_wide_port_and_a_power_unit(timestep):
    """No work appears at the port: in - work - heat - stored within 0.3 % of the motor's energy, step chosen or 100 us."""
    machine = changed(load_machine("bench"), {**CHAMBER, "power_unit": {}})
    log = heave(machine, 3.0, timestep=timestep)
    energy = {name: np.trapezoid(log[name], log["time_s"]) for name in ("motor_power_W", "heat_W", "platform_power_W")}
    stored = log["accumulator_energy_J"][-1] - log["accumulator_energy_J"][0]
    rest = energy["motor_power_W"] - energy["heat_W"] - energy["platform_power_W"] - stored
    assert abs(rest) < 3e-3 * energy["motor_power_W"]


def test_intake_is_the_port_where_the_port_is_slow():
    """Without a time step, or with a port slower than it, the intake is the orifice's flow to the bit."""
    row = parameters.declared_rows(changed(load_machine("bench"), CHAMBER))[0]
    for step, P2 in ((0.0, 6.99e6), (1e-7, 6.99e6), (1e-4, 1.0e6)):
        row[P.ROD_SIDE_CONDUCTANCE] = WIDE if step < 1e-4 else 1e-8
        assert rod_side.intake(row, 0.1, 0.1, 3e6, P2, 7e6, step) == rod_side.port_flow(row, P2, 7e6)


def test_a_fast_port_reaches_the_same_balance():
    """The slowed flow vanishes where the port's does: with port flow -A2 v the pressure rate is 0."""
    row = parameters.declared_rows(changed(load_machine("bench"), CHAMBER))[0]
    speed = -rod_side.port_flow(row, 6.999e6, 7e6) / row[P.AREA_TOP]
    assert rod_side.intake(row, 0.1, 0.5 * speed, 3e6, 6.999e6, 7e6, 1e-4) != rod_side.port_flow(row, 6.999e6, 7e6)
    assert rod_side.port_rate(row, 0.1, speed, 3e6, 6.999e6, 7e6, 1e-4) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("volts", [2.0, -2.0])
@pytest.mark.parametrize("worn", [{}, {"worn_bore": {"conductance_m3_s_Pa": 5e-12, "place_m": 0.1, "width_m": 0.05}}])
def test_what_leaks_past_the_piston_comes_from_the_rod_side(volts, worn):
    """A small port holds P2 off Ps: port + A2 v + G (P1 - P2) = C2 dP2/dt, and the bottom chamber loses the same leak."""
    leak = 5e-12
    machine = changed(
        load_machine("bench"),
        {
            **CHAMBER,
            "cylinder.rod_side_conductance_m3_s_sqrtPa": 3e-8,
            "cylinder.piston_leakage_m3_s_Pa": leak,
            "effects": worn,
        },
    )
    plant = Plant(machine)
    plant.prepare(1e3, 120)
    for _ in range(120):
        plant.tick(np.array([volts]))
    r, time = plant.record, np.arange(120) * 1e-3
    legs = readout.leg_signals(plant, time, r.qpos, r.qvel, r.act, r.spool_volts)
    P1, P2, y, v = (rows[:, 0] for rows in (legs.pressure_bottom, legs.pressure_top, legs.position, legs.velocity))
    assert abs(P2[-1] - 7e6) > 2e5
    row, across = plant.rows[0], leak + (5e-12 * np.exp(-(((y - 0.1) / 0.05) ** 2)) if worn else 0.0)
    port = 3e-8 * (7e6 - P2) / ((7e6 - P2) ** 2 + row[P.PRESSURE_WIDTH] ** 2) ** 0.25
    net = port + row[P.AREA_TOP] * v + across * (P1 - P2)
    oil = (row[P.AREA_TOP] * (row[P.STROKE] - y) + row[P.ROD_SIDE_VOLUME]) / row[P.BULK_MODULUS]
    taken_up = np.trapezoid(oil, P2)
    assert np.trapezoid(net, time) == pytest.approx(taken_up, abs=0.02 * np.trapezoid(np.abs(across * (P1 - P2)), time))
    x = legs.spool[-1, 0]
    wanted = ports.supply_edge_flow(row, x, P1[-1], 7e6) - ports.tank_edge_flow(row, x, P1[-1])
    assert legs.flow[-1, 0] == pytest.approx(wanted - (across * (P1 - P2) * np.ones(120))[-1], rel=1e-9)


@pytest.fixture(scope="module")
def behind_a_port():
    """Heave of the bench with its power unit, the rod side behind 3 mm: the settled periods of the log."""
    port = {"cylinder.rod_side_conductance_m3_s_sqrtPa": NARROW, "power_unit.oil_temperature_degC": 35.0}
    log = heave(changed(load_machine("bench"), CHAMBER | port), 8.0)
    return {name: values[4000:] for name, values in log.items()}


def harmonic(log, name, order):
    """Complex amplitude at `order` times 0.5 Hz."""
    return 2.0 * np.mean((log[name] - log[name].mean()) * np.exp(-2j * np.pi * 0.5 * order * log["time_s"]))


def test_behind_a_port_the_upper_pressure_follows_the_motion(behind_a_port):
    """Report 2.3.2: the pressure in the upper chamber sinks while the cylinder moves down fast, and varies with the reference.
    First harmonic -8/(3 pi) (A2 v/K)^2 of a speed v, beside a supply that swings mostly at twice the frequency: within 5 %."""
    log, area = behind_a_port, np.pi / 4 * (0.04**2 - 0.03**2)
    speed = harmonic(log, "velocity_m_s", 1)
    dropped = harmonic(log, "pressure_top_Pa", 1) - harmonic(log, "true_pressure_supply_Pa", 1)
    expected = 8 / (3 * np.pi) * (area * abs(speed) / NARROW) ** 2 * speed / abs(speed)
    assert abs(dropped - expected) < 0.05 * abs(expected)
    assert abs(harmonic(log, "pressure_top_Pa", 1)) > 3 * abs(harmonic(log, "pressure_top_Pa", 2))
    assert abs(harmonic(log, "true_pressure_supply_Pa", 1)) < abs(harmonic(log, "true_pressure_supply_Pa", 2))


def test_a_piston_that_runs_into_a_choked_cushion_keeps_its_steps():
    """Into the end at 0.73 m/s, a cushion of 20 mm that empties through 1.5 mm: the chosen step against 10 us, 1e-6 m all the way.
    At 14 mm of depth the orifice holds what pushes: Ps A2 + M g less spring and friction = 0.7 A (A v/K)^2, within 5 %."""
    choke = {"cylinder.cushion_orifice_m3_s_sqrtPa": 5e-8, "cylinder.cushion_damping_N_s_m": 0.0}
    soft = {"cylinder.cushion_length_m": 0.02, "cylinder.cushion_stiffness_N_m": 1e5}

    def positions(timestep):
        plant = Plant(changed(load_machine("bench"), choke | soft), timestep=timestep)
        plant.prepare(1000.0, 300)
        for _ in range(300):
            plant.sense()
            plant.tick(np.array([-6.0]))
        return plant.record.positions[:300, 0]

    chosen, fine = positions(None), positions(1e-5)
    assert np.abs(chosen - fine).max() < 1e-6
    speed = -1e3 * np.diff(chosen)[np.argmax(chosen < 0.006)]
    area, top = np.pi / 4 * 0.04**2, np.pi / 4 * (0.04**2 - 0.03**2)
    pushed = 7e6 * top + 40.0 * 9.8 - 1e5 * 0.014**2 / 0.02 - (60.0 + 1800.0 * speed)
    assert 0.7 * area * (area * speed / 5e-8) ** 2 == pytest.approx(pushed, rel=0.05)
