"""The four-way valve and its two chambers, each term written out by hand."""

import math

import numpy as np
import pytest

from hexsim import HexsimError, Machine
from hexsim.hydraulics import leg, parameters, ports, rod_side
from hexsim.hydraulics.parameters import P
from hexsim.machine.files import changed

PS, PT, DENSITY = 16.0e6, 3.0e5, 860.0
A1, A2 = math.pi / 4 * 0.04**2, math.pi / 4 * (0.04**2 - 0.03**2)
RATED, DROP, TRAVEL, OVERLAP = 6.0e-4, 3.5e6, 1.1e-3, 5e-6
FOUR_WAY = {
    "valve.kind": "four_way",
    "cylinder.rod_side": "valve",
    "supply.pressure_Pa": PS,
    "supply.tank_pressure_Pa": PT,
    "valve.spool_diameter_m": None,
    "valve.rated_flow_m3_s": RATED,
    "valve.rated_pressure_drop_Pa": DROP,
    "cylinder.rod_side_volume_m3": 2.0e-5,
}


@pytest.fixture(scope="module")
def servo(bench) -> Machine:
    """The bench's cylinder with both chambers on a four-way valve, 36 l/min at 35 bar an edge."""
    return changed(bench, FOUR_WAY)


@pytest.fixture
def row(servo):
    """A fresh row of the servo's leg."""
    return parameters.declared_rows(servo)[0]


def flows(row, x, P1, P2):
    """(q_A, q_B) into the two chambers [m3/s] at rest."""
    return leg.inflow_bottom(row, 0.1, 0.0, 0.0, x, P1, P2, PS, 0.0), ports.top_inflow(row, x, P1, P2, PS)


def edge(opening, dp):
    """Flow of an edge whose rated flow is that of the full opening, travel less overlap."""
    return RATED * opening / (TRAVEL - OVERLAP) * math.copysign(math.sqrt(abs(dp) / DROP), dp)


@pytest.mark.parametrize("x", [TRAVEL, 3e-4, -3e-4, -TRAVEL])
def test_each_edge_passes_its_flow_in_both_chambers(row, x):
    """x > 0 opens P-A and B-T, x < 0 opens P-B and A-T; rated flow at full travel and rated drop."""
    P1, P2 = 6.0e6, 9.0e6
    opening = abs(x) - OVERLAP
    into_a = edge(opening, PS - P1) if x > 0 else -edge(opening, P1 - PT)
    into_b = -edge(opening, P2 - PT) if x > 0 else edge(opening, PS - P2)
    assert flows(row, x, P1, P2) == pytest.approx((into_a, into_b), rel=1e-5)  # (w/dp)^2/4 of the root: 8e-7


@pytest.mark.parametrize("x", [3e-4, -3e-4])
def test_flows_turn_where_a_chamber_passes_supply_or_tank(row, x):
    """Above Ps an open supply edge lets oil back, below Pt an open tank edge draws oil in: both chambers, both signs."""
    above, below = edge(3e-4 - OVERLAP, 1e6), edge(3e-4 - OVERLAP, 2e5)
    P1, P2 = (PS + 1e6, PT - 2e5) if x > 0 else (PT - 2e5, PS + 1e6)
    by_hand = (-above, below) if x > 0 else (below, -above)
    assert flows(row, x, P1, P2) == pytest.approx(by_hand, rel=1e-3)  # (w/dp)^2/4 of the root: 6e-4


def test_dead_band_of_four_edges_and_of_each_alone(servo):
    """No flow within the overlap; with edges of their own each opens at its own travel."""
    row = parameters.declared_rows(servo)[0]
    for x in np.linspace(-OVERLAP, OVERLAP, 21):
        assert flows(row, x, 6e6, 9e6) == (0.0, 0.0)
    own = (4e-6, 8e-6, 12e-6, -2e-6)  # P-A, A-T, P-B, B-T; the last is an underlap
    row = parameters.declared_rows(changed(servo, {"valve.overlap_m": None, "valve.overlap_edges_m": own}))[0]
    at = [
        lambda x: ports.supply_edge_flow(row, x, 6e6, PS),
        lambda x: ports.tank_edge_flow(row, -x, 6e6),
        lambda x: ports.top_supply_flow(row, -x, 9e6, PS),
        lambda x: ports.top_tank_flow(row, x, 9e6),
    ]
    for flow, overlap in zip(at, own, strict=True):
        assert flow(overlap - 1e-9) == 0.0 < flow(overlap + 1e-9)
    full = [flow(TRAVEL) for flow in at]
    drops = (PS - 6e6, 6e6 - PT, PS - 9e6, 9e6 - PT)
    assert full == pytest.approx([RATED * math.sqrt(dp / DROP) for dp in drops], rel=1e-5)


def test_edge_gains_scale_their_own_edge(servo):
    """Gains (1, 2, 3, 4) of the edges multiply their flows and no other's."""
    plain = parameters.declared_rows(servo)[0]
    row = parameters.declared_rows(changed(servo, {"valve.edge_gains": (1.0, 2.0, 3.0, 4.0)}))[0]
    for x, gains in ((3e-4, (1.0, 4.0)), (-3e-4, (2.0, 3.0))):
        assert np.divide(flows(row, x, 6e6, 9e6), flows(plain, x, 6e6, 9e6)) == pytest.approx(gains, rel=1e-12)


def test_each_edge_has_its_own_rounding(servo):
    """At its corner an edge passes K s ln 2: roundings (1, 2, 3, 4) um give flows in that ratio, four times."""
    sizes = (1e-6, 2e-6, 3e-6, 4e-6)
    p = parameters.declared_rows(changed(servo, {"valve.edge_rounding_m": 0.0, "valve.edge_roundings_m": sizes}))[0]
    dp, full = servo.valve.rated_pressure_drop_Pa, servo.valve.rated_flow_m3_s / servo.valve.spool_travel_max_m
    edges = (ports.edge_PA(p), ports.edge_AT(p), ports.edge_PB(p), ports.edge_BT(p))
    for edge, size, flow in zip(edges, sizes, (ports.supply_edge, ports.tank_edge) * 2, strict=True):
        at_corner = flow(p, edge[0], dp, edge) * (1.0 - edge[0] / servo.valve.spool_travel_max_m)
        assert at_corner == pytest.approx(full * size * math.log(2.0), rel=1e-3)


def test_leakage_across_the_piston_and_along_the_rod(row):
    """Valve shut: G_p (P1 - P2) leaves one chamber for the other, G_r (P2 - Pt) leaves the machine."""
    row[P.LEAK_PISTON], row[P.LEAK_TOP_TANK] = 2e-12, 3e-13
    for P1, P2 in ((6e6, 9e6), (9e6, 6e6)):
        across = 2e-12 * (P1 - P2)
        assert flows(row, 0.0, P1, P2) == pytest.approx((-across, across - 3e-13 * (P2 - PT)), rel=1e-12)


@pytest.mark.parametrize("x", [0.0, 4e-4, -4e-4])
def test_slopes_are_the_derivatives_of_the_flows(row, x):
    """d q_A/dP1 and d q_B/dP2 by central differences, with leaks, clearance and a return line."""
    row[P.LEAK_PISTON], row[P.LEAK_TOP_TANK], row[P.CLEARANCE_CONDUCTANCE] = 2e-12, 3e-12, 4e-13
    for resistance in (0.0, 1e9):
        row[P.RETURN_RESISTANCE] = resistance
        P1, P2, d = 6e6, 9e6, 10.0
        by_a = (flows(row, x, P1 + d, P2)[0] - flows(row, x, P1 - d, P2)[0]) / (2 * d)
        by_b = (flows(row, x, P1, P2 + d)[1] - flows(row, x, P1, P2 - d)[1]) / (2 * d)
        assert ports.flow_slope(row, x, P1, PS) == pytest.approx(by_a, rel=1e-6)
        assert ports.top_slope(row, x, P2, PS) == pytest.approx(by_b, rel=1e-6)


def test_two_closed_edges_leave_the_three_way_leg(servo, bench):
    """With P-B and B-T shut off and the rod side on the supply all rates are those of the three-way leg, to the bit."""
    three = changed(bench, {k: v for k, v in FOUR_WAY.items() if k not in ("valve.kind", "cylinder.rod_side")})
    four = parameters.declared_rows(changed(servo, {"valve.edge_gains": (1.0, 1.0, 0.0, 0.0)}))[0]
    four[P.ROD_SIDE_CHAMBER] = parameters.ROD_SIDE_SUPPLY
    for x in (-3e-4, 0.0, 3e-4):
        state = (6e6, PS, x, 0.01, 0.0)
        instant = (0.1, 0.05, 2.0, 0.0, PS, state, 1e-4)
        assert leg.leg_derivatives(four, *instant) == leg.leg_derivatives(parameters.declared_rows(three)[0], *instant)


def test_pressure_rate_of_the_rod_side(row):
    """dP2/dt = E/V2 (q_B + A2 v), V2 = V_0 + A2 (stroke - y); slower than exact where the step is coarse, never faster."""
    P1, P2, y, v, x = 6e6, 9e6, 0.05, 0.1, 3e-4
    state = (P1, P2, x, 0.0, 0.0)
    exact = leg.leg_derivatives(row, y, v, 0.0, 0.0, PS, state, 0.0)[0][1]
    volume = 2e-5 + A2 * (0.2 - y)
    assert exact == pytest.approx(1.5e9 / volume * (flows(row, x, P1, P2)[1] + A2 * v), rel=1e-9)
    slowed = leg.leg_derivatives(row, y, v, 0.0, 0.0, PS, state, 0.1)[0][1]
    assert 0.0 < slowed / exact < 1.0


@pytest.mark.parametrize(("speed", "which"), [(5.0, 0), (-5.0, 1)])
def test_a_void_grows_by_what_the_piston_leaves_and_the_valve_does_not_bring(row, speed, which):
    """Both chambers: W = (P_v - s) C, dW/dt = A |v| - q at any depth, the valve's flow that of the vapour's pressure."""
    y, h, vapour, x = 0.05, 1e-7, 10.0 - 1.01325e5, 3e-4
    flow = flows(row, x, *((vapour, 9e6) if which == 0 else (6e6, vapour)))[which]
    area, volume = ((A1, lambda y: 5e-7 + A1 * y), (A2, lambda y: 2e-5 + A2 * (0.2 - y)))[which]
    for depth in (1e3, 5e8):
        state = [6e6, 9e6, x, 0.0, 0.0]
        state[which] = vapour - depth
        rates = leg.leg_derivatives(row, y, speed, 0.0, 0.0, PS, tuple(state), 0.0)[0]
        void = [
            (vapour - s) * volume(at) / 1.5e9
            for s, at in ((state[which], y), (state[which] + h * rates[which], y + h * speed))
        ]
        assert (void[1] - void[0]) / h == pytest.approx(area * abs(speed) - flow, rel=1e-5)


@pytest.mark.parametrize(("x", "v"), [(3e-4, 0.1), (-3e-4, -0.1), (0.0, 0.02)])
def test_power_balance_of_a_leg(row, x, v):
    """Ps q = oil work in both chambers + heat - friction's share: throttling is counted once, at four edges and leaks."""
    row[P.LEAK_PISTON], row[P.LEAK_TOP_TANK], row[P.TANK_PRESSURE] = 2e-12, 3e-13, 0.0
    P1, P2 = 6e6, 9e6
    into_a = flows(row, x, P1, P2)[0]
    demand = leg.supply_demand(row, v, x, P1, P2, PS)
    assert demand == leg.supply_demand_in_step(row, 0.1, v, x, P1, P2, PS, 1e-4)
    edges = ports.supply_edge_flow(row, x, P1, PS) + ports.top_supply_flow(row, x, P2, PS)
    assert demand == pytest.approx(edges, rel=1e-12)
    by_hand = (
        ports.supply_edge_flow(row, x, P1, PS) * (PS - P1)
        + ports.top_supply_flow(row, x, P2, PS) * (PS - P2)
        + ports.tank_edge_flow(row, x, P1) * P1
        + ports.top_tank_flow(row, x, P2) * P2
        + 2e-12 * (P1 - P2) ** 2
        + 3e-13 * P2**2
        + leg.friction_force(row, 0.1, v, P1, 0.0) * v
    )
    assert leg.heat(row, 0.1, v, x, P1, P2, PS, 0.0, into_a, demand) == pytest.approx(by_hand, rel=1e-9)


def test_a_worn_bore_leaks_from_chamber_to_chamber(row):
    """What leaves the one enters the other, G (P1 - P2) at the place, and all of its power is heat; the supply gives none."""
    row[P.WEAR_CONDUCTANCE], row[P.WEAR_PLACE], row[P.WEAR_WIDTH] = 1e-12, 0.1, 0.008
    sound, P1, P2 = declared_like(row), 6e6, 9e6
    into_a, into_b = (
        [leg.inflow_bottom(p, 0.1, 0.0, 0.0, 0.0, P1, P2, PS, 0.0) for p in (sound, row)],
        [rod_side.valve_inflow(p, 0.1, 0.0, P1, P2, PS) for p in (sound, row)],
    )
    assert np.diff(into_a) == pytest.approx(3e-6, rel=1e-9)
    assert np.diff(into_b) == pytest.approx(-3e-6, rel=1e-9)
    demands = [leg.supply_demand_in_step(p, 0.1, 0.0, 0.0, P1, P2, PS) for p in (sound, row)]
    assert demands[0] == demands[1]
    heats = [
        leg.heat(p, 0.1, 0.0, 0.0, P1, P2, PS, 0.0, q, demands[0]) for p, q in zip((sound, row), into_a, strict=True)
    ]
    assert np.diff(heats) == pytest.approx(1e-12 * (P1 - P2) ** 2, rel=1e-6)


def declared_like(row):
    """The row with a bore as new."""
    sound = row.copy()
    sound[P.WEAR_CONDUCTANCE] = 0.0
    return sound


REFUSED = [
    ({"cylinder.rod_side": "supply"}, "four-way valve needs rod_side"),
    ({"valve.spool_diameter_m": 0.01}, "not both"),
    ({"valve.rated_pressure_drop_Pa": None}, "rated_pressure_drop_Pa"),
    ({"valve.overlap_edges_m": (0.0, 0.0, 0.0, 0.0)}, "overlap_edges_m = [PA, AT, PB, BT]"),
    ({"valve.overlap_m": None, "valve.overlap_edges_m": (0.0, 0.0, 2e-3, 0.0)}, "overlap_edges_m of PB"),
    ({"valve.flow_area": "quadratic"}, "spool_diameter_m"),
]


@pytest.mark.parametrize(("changes", "says"), REFUSED, ids=[says for _, says in REFUSED])
def test_what_does_not_go_together_is_refused_by_name(servo, changes, says):
    """One sentence that names the key and what to give."""
    with pytest.raises(HexsimError, match=r".*") as caught:
        changed(servo, changes)
    assert says in str(caught.value)


def test_rod_leakage_needs_a_chamber(bench):
    """An annulus on the supply line has no leakage of its own to declare."""
    with pytest.raises(HexsimError, match="rod_leakage_m3_s_Pa"):
        changed(bench, {"cylinder.rod_leakage_m3_s_Pa": 1e-13})


def test_piston_leakage_of_the_report_machine_comes_from_the_supply(bench):
    """With the annulus at supply pressure the piston seal leaks from the supply into the bottom chamber."""
    row = parameters.declared_rows(changed(bench, {"cylinder.piston_leakage_m3_s_Pa": 2e-12}))[0]
    assert row[P.LEAK_SUPPLY_CHAMBER] == 2e-12
    assert row[P.LEAK_PISTON] == 0.0


def test_through_rod_has_equal_areas(servo):
    """Both sides are the annulus, and external leakage leaves both chambers."""
    row = parameters.declared_rows(
        changed(servo, {"cylinder.through_rod": True, "cylinder.rod_leakage_m3_s_Pa": 1e-13})
    )[0]
    assert row[P.AREA_BOTTOM] == row[P.AREA_TOP] == pytest.approx(A2, rel=1e-12)
    assert row[P.LEAK_CHAMBER_TANK] == row[P.LEAK_TOP_TANK] == 1e-13
