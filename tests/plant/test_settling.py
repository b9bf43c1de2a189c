"""A leg that is shut off from its valve and lowered through its settling orifice: speed and energy by hand."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import leg, manifold
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant, readout

TICKS, TICK_S = 4000, 1.0e-3


@pytest.fixture(scope="module")
def lowered():
    """(plant, signals) of the bench with its blocking valve shut and its settling valve open from the start."""
    machine = changed(load_machine("bench"), {"manifold": {"settling_diameter_m": 1.0e-3}})
    plant = Plant(machine)
    plant.change_row(0, P.PORT_RESISTANCE, 1e30)
    plant.change_row(0, P.SETTLING_GAIN, machine.manifold.settling_gain_m3_s_sqrtPa(machine.oil.density_kg_m3))
    plant.prepare(1.0 / TICK_S, TICKS)
    for _ in range(TICKS):
        plant.tick(np.zeros(1))
    record, time = plant.record, np.arange(TICKS) * TICK_S
    return plant, readout.leg_signals(plant, time, record.qpos, record.qvel, record.act, record.spool_volts)


def test_lowering_speed_by_hand(lowered):
    """v = K_s sqrt(P1 - Pt)/A1 with P1 A1 = m g + Ps A2 - friction, where the leg sinks evenly; 1e-4."""
    plant, s = lowered
    p, machine = plant.rows[0], plant.machine
    k = 800
    assert s.position[k, 0] > 1.5 * p[P.SETTLING_TAPER]
    friction = abs(leg.friction_force(p, s.position[k, 0], s.velocity[k, 0], s.pressure_bottom[k, 0], 0.0))
    load = machine.load.moving_mass_kg * machine.machine.gravity_m_s2
    held = (load + p[P.SUPPLY_PRESSURE] * p[P.AREA_TOP] - friction) / p[P.AREA_BOTTOM]
    speed = p[P.SETTLING_GAIN] * math.sqrt(held - p[P.TANK_PRESSURE]) / p[P.AREA_BOTTOM]
    assert -s.velocity[k, 0] == pytest.approx(speed, rel=1e-4)


def test_energy_of_the_way_down(lowered):
    """Weight and rod side give m g h + Ps A2 h; orifice and friction turn it into heat, to 1e-3 over 0.5 s of sinking."""
    plant, s = lowered
    p, machine = plant.rows[0], plant.machine
    span = slice(300, 801)
    y, v, P1 = s.position[span, 0], s.velocity[span, 0], s.pressure_bottom[span, 0]
    through = np.array(
        [-manifold.inflow(p, a, p[P.SUPPLY_PRESSURE], manifold.taper(p, b)) for a, b in zip(P1, y, strict=True)]
    )
    heat = np.trapezoid((P1 - p[P.TANK_PRESSURE]) * through + s.friction[span, 0] * v, dx=TICK_S)
    height = y[0] - y[-1]
    given = height * (machine.load.moving_mass_kg * machine.machine.gravity_m_s2 + p[P.SUPPLY_PRESSURE] * p[P.AREA_TOP])
    assert height > 0.01 and heat == pytest.approx(given, rel=1e-3)


def test_the_leg_comes_to_its_stop_softly(lowered):
    """In the taper the leg slows from v_s towards nothing: at its end stop it is below a fifth of v_s."""
    _, s = lowered
    fastest = -s.velocity[:, 0].min()
    at_stop = s.position[:, 0] < 1.05 * s.position[-1, 0]
    assert at_stop.any() and np.abs(s.velocity[at_stop, 0]).max() < 0.2 * fastest
