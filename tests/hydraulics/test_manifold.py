"""The safety manifold's equations: check valves, settling orifice, and the line in series with an edge."""

import math

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics import leg, manifold, parameters, ports
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed

PORT = {"manifold": {"port_flow_m3_s": 3.0e-4, "port_pressure_drop_Pa": 2.0e6, "settling_diameter_m": 1.2e-3}}


@pytest.fixture(params=["bench", "servo_bench"])
def machine(request):
    """Three-way and four-way, with a manifold."""
    return changed(load_machine(request.param), PORT)


@pytest.fixture
def row(machine):
    """A leg's row with its settling orifice open and no pressure width to speak of."""
    row = parameters.declared_rows(changed(machine, {"valve.pressure_width_Pa": 1.0}))[0]
    row[P.SETTLING_GAIN] = machine.manifold.settling_gain_m3_s_sqrtPa(machine.oil.density_kg_m3)
    return row


def test_settling_orifice_by_hand(machine, row):
    """C_d pi d^2/4 sqrt(2 dp/rho) at 40 bar from the chamber to the tank; back when the tank is above; 1e-9."""
    for dp in (4.0e6, -1.0e5):
        speed = math.copysign(math.sqrt(2.0 * abs(dp) / machine.oil.density_kg_m3), dp)
        flow = -0.611 * math.pi / 4 * 1.2e-3**2 * speed
        row[P.CHECK_GAIN] = 0.0
        found = manifold.inflow(row, row[P.TANK_PRESSURE] + dp, row[P.SUPPLY_PRESSURE], 1.0)
        assert found == pytest.approx(flow, rel=1e-9)


def test_taper_lets_the_leg_brake_evenly(row):
    """v = v_s s(y): v dv/dy within the taper is v_s^2/(2 l) at every place; whole above it; never shut."""
    length, y = row[P.SETTLING_TAPER], np.linspace(0.1, 0.9, 9) * row[P.SETTLING_TAPER]
    share = np.array([manifold.taper(row, place) for place in y])
    slope = np.array([(manifold.taper(row, p + 1e-7) - manifold.taper(row, p - 1e-7)) / 2e-7 for p in y])
    np.testing.assert_allclose(share * slope, 1.0 / (2.0 * length), rtol=1e-6)
    assert manifold.taper(row, 1.01 * length) == 1.0 and 0.0 < manifold.taper(row, -0.001) < 0.05


def test_check_valves_open_one_way(row):
    """Nothing between tank and supply pressure; beyond them 500 kPa pass the rated flow, out to the supply and in from the tank."""
    row[P.SETTLING_GAIN] = 0.0
    Ps, Pt = row[P.SUPPLY_PRESSURE], row[P.TANK_PRESSURE]
    assert manifold.inflow(row, 0.5 * (Ps + Pt), Ps, 1.0) == 0.0
    assert manifold.inflow(row, Ps + 5e5, Ps, 1.0) == pytest.approx(-5.0e-4, rel=1e-9)
    assert manifold.inflow(row, Pt - 5e5, Ps, 1.0) == pytest.approx(5.0e-4, rel=1e-9)


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_an_edge_behind_the_port_line(machine, row, share):
    """Two orifices in series: dp = q^2 (1/k^2 + R), for the supply edge and the tank edge; shut lines pass nothing."""
    x, dp = share * row[P.SPOOL_TRAVEL], 3.0e6
    bare = row.copy()
    bare[P.PORT_RESISTANCE] = 0.0
    for flow, edge in ((ports.supply_edge, ports.edge_PA), (ports.tank_edge, ports.edge_AT)):
        alone = flow(bare, x, dp, edge(bare))
        assert flow(row, x, dp, edge(row)) == pytest.approx(
            math.sqrt(dp / (dp / alone**2 + 2.0e6 / 3.0e-4**2)), rel=1e-6
        )
        row[P.PORT_RESISTANCE] *= 1e12
        assert flow(row, x, dp, edge(row)) < 1e-5 * alone
        row[P.PORT_RESISTANCE] /= 1e12


@pytest.mark.parametrize("P1", [-5.0e4, 3.0e6, 1.7e7])
def test_slopes_and_heat_with_a_manifold(row, P1):
    """d q_A/dP1 and d q_B/dP2 by central differences; and Ps q - P1 phi_1 - P2 q_B is the heat of a leg at rest."""
    y, x, Ps = 0.5 * row[P.STROKE], 0.3 * row[P.SPOOL_TRAVEL], row[P.SUPPLY_PRESSURE]
    h = 10.0
    ahead, behind = (leg.inflow(row, y, 0.0, 0.0, x, p, Ps, 0.0) for p in (P1 + h, P1 - h))
    assert ports.flow_slope(row, x, P1, Ps) + row[P.LEAK_PISTON] == pytest.approx((ahead - behind) / (2 * h), rel=1e-3)
    if row[P.ROD_SIDE_CHAMBER] == 2.0:
        ahead, behind = (ports.top_inflow(row, x, 0.0, p, Ps) for p in (P1 + h, P1 - h))
        assert ports.top_slope(row, x, P1, Ps) == pytest.approx((ahead - behind) / (2 * h), rel=1e-3)
    P2 = 4.0e6
    flow = leg.inflow_bottom(row, y, 0.0, 0.0, x, P1, P2, Ps, 0.0)
    demand = leg.supply_demand(row, 0.0, x, P1, P2, Ps)
    top = P2 * ports.top_inflow(row, x, P1, P2, Ps) if row[P.ROD_SIDE_CHAMBER] == 2.0 else 0.0
    assert leg.heat(row, y, 0.0, x, P1, P2, Ps, 0.0, flow, demand) == pytest.approx(Ps * demand - P1 * flow - top)
    assert Ps * demand - P1 * flow - top > 0.0


def test_an_impossible_size_is_refused():
    """One sentence names the key and what is possible."""
    with pytest.raises(HexsimError, match=r"manifold.*settling_diameter_m"):
        changed(load_machine("bench"), {"manifold": {"settling_diameter_m": 0.0}})
