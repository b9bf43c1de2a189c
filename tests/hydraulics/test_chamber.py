"""Volume, compressibility and pressure rate, against Eq. 3.5-3.7 and an oil-air mixture compressed by hand."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import chamber

A1, DEAD, OIL = math.pi / 4 * 0.04**2, 5e-7, 1.5e9
ATMOSPHERE = 1.01325e5


def test_volume_grows_with_the_piston_down_to_its_floor():
    """y A1 + V_pl: 126.2 cm3 at half stroke; 1 cm3 and no less when the piston is at or behind its end."""
    assert chamber.volume(0.1, A1, DEAD) == pytest.approx(0.1 * A1 + DEAD, rel=1e-12)
    assert chamber.volume(0.1, A1, DEAD) == pytest.approx(126.2e-6, abs=0.1e-6)
    for y in (0.0, -0.01, -1.0):
        assert chamber.volume(y, A1, DEAD) == 1e-6
    just_above = (1e-6 - DEAD) / A1 * 1.001
    assert 1e-6 < chamber.volume(just_above, A1, DEAD) < 1.001e-6


def test_oil_without_air_keeps_its_modulus():
    """Air 0: the declared modulus at every pressure."""
    assert [chamber.bulk_modulus(p, OIL, 0.0) for p in (-1e5, 0.0, 7e6)] == [OIL] * 3


@pytest.mark.parametrize("air", [0.001, 0.007, 0.05])
@pytest.mark.parametrize("pressure", [0.0, 5e5, 2e6, 7e6])
def test_modulus_is_that_of_a_compressed_mixture(pressure, air):
    """-V/(dV/dP) of 1 m3 oil that compresses by exp(-dP/E) and `air` m3 gas, brought to the pressure by Boyle and rippling
    about it adiabatically, by a central difference.

    The formula takes the oil's own volume as 1 m3 at all pressures: off by P/E = 0.5 % of the air's share at 70 bar.
    """
    mean = pressure + ATMOSPHERE

    def mixture(gauge):
        return math.exp(-gauge / OIL) + air * ATMOSPHERE / mean * (mean / (gauge + ATMOSPHERE)) ** (1 / 1.4)

    h = 1e-4 * (pressure + ATMOSPHERE)
    numeric = -mixture(pressure) * 2 * h / (mixture(pressure + h) - mixture(pressure - h))
    assert chamber.bulk_modulus(pressure, OIL, air) == pytest.approx(numeric, rel=0.005)


@pytest.mark.parametrize(("bar", "ratio"), [(11.0, 1.98), (35.0, 2.75), (70.0, 3.35)])
def test_air_of_the_oils_temperature_softens_less_than_air_compressed_without_heat(bar, ratio):
    """Against air that went adiabatically from 1 atm to the pressure: (P/P0)^(1 - 1/1.4) times less of it, 2 to 3.4."""
    absolute, air = bar * 1e5, 1e-3
    added = 1.0 / chamber.bulk_modulus(absolute - ATMOSPHERE, OIL, air) - 1.0 / OIL
    adiabatic = air * (ATMOSPHERE / absolute) ** (1 / 1.4) / (1.4 * absolute)
    assert adiabatic / added == pytest.approx(ratio, rel=0.01)


def test_modulus_rises_with_pressure_towards_the_oil():
    """Monotone in pressure, below the oil's own, within 1 % of it at 1000 bar."""
    moduli = [chamber.bulk_modulus(p, OIL, 0.01) for p in np.geomspace(1e4, 1e8, 50)]
    assert np.all(np.diff(moduli) > 0)
    assert 0.99 * OIL < moduli[-1] < OIL


def test_capacity_adds_hose_to_oil():
    """V/E + C_hose, so that both take up volume under the same pressure."""
    assert chamber.capacity(1e-4, 3e6, OIL, 0.0, 2e-14) == pytest.approx(1e-4 / OIL + 2e-14, rel=1e-12, abs=0)


@pytest.mark.parametrize("flow", [1e-4, -1e-4])
def test_pressure_rate_is_flow_over_capacity(flow):
    """Eq. 3.7, both signs: 1e-4 m3/s into 126 cm3 raises the pressure by 1.19 GPa/s."""
    volume = 0.1 * A1 + DEAD
    rate = chamber.state_rate(3e6, flow, volume / OIL)
    assert rate == pytest.approx(flow * OIL / volume, rel=1e-12)
    assert abs(rate) == pytest.approx(1.19e9, rel=0.005)


def test_pressure_never_falls_below_that_of_vapour():
    """Drawn on without end: -1.01315 bar, 10 Pa from absolute zero, and the pressure itself above that."""
    assert chamber.pressure(-1e12) == chamber.pressure(chamber.VAPOUR) == pytest.approx(10.0 - ATMOSPHERE)
    assert chamber.pressure(-1e5) == -1e5


@pytest.mark.parametrize("air", [0.0, 1e-3, 0.02])
@pytest.mark.parametrize("hose", [0.0, 3e-14])
def test_a_cycle_of_volume_and_flow_through_the_void_brings_the_state_back(air, hose):
    """The oil in a chamber decides its state: a piston that pulls a void, oil that leaves meanwhile and comes back at another
    place, in every order: the same pressure, within what RK4 leaves (1e-5 of its own height)."""

    def rate(y, s, v, q):
        room = chamber.capacity(chamber.volume(y, A1, DEAD), chamber.pressure(s), OIL, air, hose)
        growth = (room - hose) * A1 * v / chamber.volume(y, A1, DEAD) if s < chamber.VAPOUR else 0.0
        return chamber.state_rate(s, q - A1 * v, room, growth)

    y, s, h, largest = 0.1, 3e6, 2e-5, 0.0
    legs = [(0.2, 0.0), (0.0, -2e-5), (0.1, 1e-5), (0.0, 1e-5), (-0.3, 0.0)]  # 0.1 s each: speed, flow
    for v, q in legs:
        for _ in range(round(0.1 / h)):
            k1 = rate(y, s, v, q)
            k2 = rate(y + h / 2 * v, s + h / 2 * k1, v, q)
            k3 = rate(y + h / 2 * v, s + h / 2 * k2, v, q)
            k4 = rate(y + h * v, s + h * k3, v, q)
            y, s = y + h * v, s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            room = chamber.capacity(chamber.volume(y, A1, DEAD), chamber.VAPOUR, OIL, air, hose)
            largest = max(largest, chamber.void(s, room))
    assert largest > 2e-5
    assert y == pytest.approx(0.1, abs=1e-12)
    assert s == pytest.approx(3e6, rel=1e-3)


def test_what_closes_a_void_counts_in_full():
    """A stiff chamber's flow is divided in a coarse step; the flow that only fills the void is not, either sign."""
    room, h, slower = 1e-13, 1e-4, 50.0
    state = chamber.VAPOUR - 1e6  # a void of 1e-7 m3: 1e-3 m3/s close it in the step
    assert chamber.void(state, room) == pytest.approx(1e-7)
    assert [chamber.slowed(q, state, room, slower, h) for q in (-1e-3, 5e-4)] == [-1e-3, 5e-4]
    assert chamber.slowed(3e-3, state, room, slower, h) == pytest.approx(1e-3 + 2e-3 / slower)
    assert chamber.slowed(3e-3, 1e6, room, slower, h) == pytest.approx(3e-3 / slower)
    assert chamber.slowed(3e-3, 1e6, room, 1.0, h) == 3e-3
