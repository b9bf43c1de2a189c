"""Metering edges with a laminar range: both limits, both signs, the oil's temperature, the bump, what a sheet says."""

import math

import numpy as np
import pytest

import hexsim as hx
from compensation.adaptive import leg as adaptive_leg
from hexsim import HexsimError, load_scenario, smoothness
from hexsim.hydraulics import leg, oil, ports
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve, warm_oil
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

BENCH, SERVO = load_machine("bench"), load_machine("servo_bench")
PS, OVERLAP, GRADIENT, DISCHARGE, DENSITY = 7e6, 5e-6, math.pi * 1e-2, 0.611, 860.0
COLD = 118.65e-6  # [m2/s] Tellus T46 at 20 degC by ASTM D341
SLOT = 15.0


def row_of(reynolds=SLOT, temperature=20.0, machine=BENCH, **changes):
    """The bench's row with laminar edges in oil of so many degC."""
    keys = {"valve.laminar_reynolds": reynolds, "oil.temperature_degC": temperature} | changes
    return resolve(changed(machine, keys)).rows[0]


def flow(row, opening, drop):
    """Through the supply edge [m3/s]; below no drop the chamber's pressure is above the supply's."""
    return ports.supply_edge_flow(row, OVERLAP + opening, PS - drop, PS)


@pytest.mark.parametrize("drop", [35e5, -35e5])
def test_a_wide_edge_has_the_root_law(drop):
    """Re >> Re_cr: the declared edge without a laminar range, less (p_cr/dp)^2/4 = 1.7e-4 at 100 um; both directions."""
    plain, laminar = (flow(row_of(reynolds), 1e-4, drop) for reynolds in (0.0, SLOT))
    transition = DENSITY / 2 * (SLOT * COLD / (2.0 * DISCHARGE * 1e-4)) ** 2
    assert 1.0 - laminar / plain == pytest.approx((transition / drop) ** 2 / 4.0, rel=2e-3)
    assert plain * drop > 0.0
    assert flow(row_of(0.1), 1e-5, drop) == pytest.approx(flow(row_of(0.0), 1e-5, drop), rel=1e-6)


@pytest.mark.parametrize("drop", [35e5, 5e5, -5e5])
def test_a_narrow_edge_is_laminar(drop):
    """Re << Re_cr: Q = 4 C_d^2/Re_cr g o^2 dp/(rho nu), linear in the drop, square in the opening, over the viscosity."""
    row = row_of()
    for opening in (2e-7, 4e-7):
        expected = 4.0 * DISCHARGE**2 / SLOT * GRADIENT * opening**2 * drop / (DENSITY * COLD)
        assert flow(row, opening, drop) == pytest.approx(expected, rel=2e-3)  # (dp/p_cr)^2/4, and COLD to four digits


def test_its_discharge_coefficient_is_that_of_a_slot():
    """C_d = 0.157 sqrt(Re) of Merritt's sharp slot, Re of mean velocity and twice the opening, where Re_cr = (0.611/0.157)^2."""
    row = row_of((DISCHARGE / 0.157) ** 2)
    for opening, drop in ((1e-6, 35e5), (5e-7, 60e5)):
        q = flow(row, opening, drop)
        reynolds = q / (GRADIENT * opening) * 2.0 * opening / COLD
        coefficient = q / (GRADIENT * opening * math.sqrt(2.0 * drop / DENSITY))
        assert coefficient == pytest.approx(0.157 * math.sqrt(reynolds), rel=5e-3)


@pytest.mark.parametrize("machine", [BENCH, SERVO], ids=["three_way", "four_way"])
@pytest.mark.parametrize("resistance", [0.0, 2e9])
@pytest.mark.parametrize("x", [6e-6, 2e-5, -6e-6, -2e-5])
def test_slopes_are_those_of_the_flows(machine, resistance, x):
    """What step rule and linearisation ask for: d inflow/dP of both chambers by central difference, with a return line too."""
    row = row_of(machine=machine)
    row[P.RETURN_RESISTANCE] = resistance
    supply, pressure, h = row[P.SUPPLY_PRESSURE], 0.4 * row[P.SUPPLY_PRESSURE], 100.0
    both = [(lambda p: ports.supply_edge_flow(row, x, p, supply) - ports.tank_edge_flow(row, x, p), ports.flow_slope)]
    if machine is SERVO:
        both += [(lambda p: ports.top_supply_flow(row, x, p, supply) - ports.top_tank_flow(row, x, p), ports.top_slope)]
    leaks = row[P.LEAK_PISTON] + row[P.LEAK_SUPPLY_CHAMBER]
    for inflow, slope in both:
        numeric = (inflow(pressure + h) - inflow(pressure - h)) / (2.0 * h) - leaks
        assert slope(row, x, pressure, supply) == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize("opening", [1e-7, 3e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("drop", [40e5, 2e5, -2e5])
def test_a_return_line_takes_its_pressure_first(opening, drop):
    """The flow into a line of R is that of the edge at the drop less R q: narrow, wide and between, both directions."""
    alone, behind = row_of(), row_of()
    behind[P.RETURN_RESISTANCE] = 1e10
    q = ports.tank_edge_flow(behind, -OVERLAP - opening, drop)
    assert q == pytest.approx(ports.tank_edge_flow(alone, -OVERLAP - opening, drop - 1e10 * q), rel=1e-9)
    assert abs(q) < abs(ports.tank_edge_flow(alone, -OVERLAP - opening, drop))


def test_oil_that_warms_opens_the_edge():
    """From 20 to 60 degC viscosity falls from 118.65 to 22.21 mm2/s and a narrow edge passes as much more; as if declared there."""
    machine = changed(BENCH, {"valve.laminar_reynolds": SLOT, "oil.temperature_degC": 20.0})
    made = resolve(machine)
    cold = flow(made.rows[0], 2e-7, 5e5)
    warm_oil(made, 60.0)
    density = made.rows[0, P.DENSITY] / DENSITY
    assert flow(made.rows[0], 2e-7, 5e5) / cold == pytest.approx(118.65 / 22.21 / density, rel=1e-3)
    assert made.rows[0, P.LAMINAR] == pytest.approx(row_of(temperature=60.0)[P.LAMINAR], rel=1e-12)


@pytest.fixture(scope="module")
def runs():
    """Heave of the bench at 20 and 60 degC by Re_cr: what a sharp slot is given in libraries, and ten times that."""
    scenario = load_scenario("heave", duration_s=8.0)
    return {
        (reynolds, degC): simulate(
            changed(BENCH, {"valve.laminar_reynolds": reynolds, "oil.temperature_degC": degC}), scenario
        )
        for reynolds, degC in ((0.0, 20.0), (0.0, 60.0), (12.0, 20.0), (12.0, 60.0), (150.0, 20.0), (150.0, 60.0))
    }


def raw_bump(run):
    return run.summary["axes"]["leg"]["peak_raw_m_s2"]


@pytest.mark.parametrize(("reynolds", "ratio"), [(0.0, 1.0), (12.0, 1.595), (150.0, 1.134)])
def test_temperature_moves_the_raw_bump(runs, reynolds, ratio):
    """From 20 to 60 degC by 60 % at Re_cr = 12 and by 13 % at 150, as an independent integration of the bench has it (RK4
    of 5 us, rest 2 % for another start and window); turbulent edges know no temperature."""
    warm, cold = raw_bump(runs[reynolds, 60.0]), raw_bump(runs[reynolds, 20.0])
    assert warm / cold == pytest.approx(ratio, rel=0.025)


@pytest.mark.slow  # two rides of ten minutes; the equations that it rests on are held above
def test_the_ride_warms_its_oil_and_its_bump_grows():
    """Scenario `warm_up`: 15 to 60 degC within 2 K, never cooler; its edges' bump in 50 Hz is larger in the last tenth than in the
    first, and larger than density and friction make it (turbulent edges)."""
    grown = {}
    for reynolds in (SLOT, 0.0):
        log = hx.run("warm_up", "bench", "none", {"valve.laminar_reynolds": reynolds}).log
        heat = log["oil_temperature_degC"].to_numpy()
        assert abs(heat[0] - 15.0) < 0.1 and abs(heat[-1] - 60.0) < 2.0 and np.diff(heat).min() >= 0.0
        names = ("time_s", "true_acceleration_m_s2", "commanded_velocity_m_s", "commanded_acceleration_m_s2")
        bumps = smoothness.reversal_bumps(*(log[name].to_numpy() for name in names), start_s=6.0)
        sizes = np.array([bump.bump_pp for bump in bumps])
        tenth = len(sizes) // 10
        grown[reynolds] = sizes[-tenth:].mean() / sizes[:tenth].mean()
    assert grown[SLOT] > grown[0.0] > 1.0


def test_oil_is_neither_made_nor_lost(runs):
    """What came through the edges is in the chamber: integral of the flow against volume and compression, 1e-4 of the stroke's."""
    log = runs[150.0, 20.0].log
    time, q, pressure, y = (
        log[name].to_numpy() for name in ("time_s", "flow_m3_s", "true_pressure_bottom_Pa", "true_position_m")
    )
    volume = BENCH.cylinder.area_bottom_m2 * y + BENCH.cylinder.pipeline_volume_m3
    mean = lambda values: 0.5 * (values[1:] + values[:-1])  # noqa: E731
    held = np.cumsum(np.diff(volume) + mean(volume) * np.diff(pressure) / 1.5e9)
    came = np.cumsum(mean(q) * np.diff(time))
    assert np.abs(held - came).max() < 1e-4 * np.ptp(volume)


@pytest.mark.parametrize("degC", [15.0, 60.0])
def test_the_compensator_s_model_has_this_law(degC):
    """With one factor and one transition for the oil its orifice is hexsim's edge at 2 to 100 um and 1 to 60 bar, within 1e-3;
    both roots smooth within 1 Pa."""
    row, found = row_of(temperature=degC), np.zeros(5)
    row[P.PRESSURE_WIDTH] = 1.0
    viscosity = oil.kinematic_viscosity(degC)  # [m2/s]
    laminar = DENSITY / 2 * (SLOT * viscosity / (2.0 * DISCHARGE)) ** 2
    for opening in (2e-6, 1e-5, 1e-4):
        for drop in (1e5, 35e5, -60e5):
            adaptive_leg.orifice(opening, drop, 1.0, laminar, found)
            mine = DISCHARGE * GRADIENT * math.sqrt(2.0 / DENSITY) * found[0]
            assert mine == pytest.approx(flow(row, opening, drop), rel=1e-3)


RATED = {"valve.overlap_m": 5e-6}  # servo bench: 38 l/min at 35 bar and 0.5 mm


@pytest.mark.parametrize("share", [0.6, 0.97])
def test_the_flow_at_10_percent_comes_back(share):
    """A sheet's flow at 10 % signal, measured at 32 mm2/s: the edge passes it there, at the rated drop."""
    opening = 5e-5 - 5e-6
    sheet = share * 38.0 / 60000.0 * opening / (5e-4 - 5e-6)
    row = row_of(0.0, 40.0, SERVO, **RATED, **{"valve.flow_at_10_percent_m3_s": sheet, "oil.grade": "VG 32"})
    row[P.PRESSURE_WIDTH] = 1.0
    found = ports.supply_edge_flow(row, 5e-5, row[P.SUPPLY_PRESSURE] - 35e5, row[P.SUPPLY_PRESSURE])
    assert found == pytest.approx(sheet, rel=1e-9)


def test_a_flow_curve_holds_at_the_viscosity_of_its_sheet():
    """Flow over signal as the sheet draws it comes back at 32 mm2/s and rated drop, laminar edges or not; colder oil passes less."""
    curve = {"signal": [0.0, 2.0, 4.0, 100.0], "flow": [0.0, 0.02, 0.3, 38.0]}
    keys = {"valve.overlap_m": None, "valve.flow_curve": curve, "valve.edge_rounding_m": 0.0, "oil.grade": "VG 32"}
    for reynolds in (0.0, 100.0):
        row = row_of(reynolds, 40.0, SERVO, **keys)
        for signal, litres in ((2.0, 0.02), (4.0, 0.3), (100.0, 38.0)):
            opening = leg.flow_curve(row, signal / 100.0 * 5e-4)
            q = ports.supply_edge_flow(row, opening, row[P.SUPPLY_PRESSURE] - 35e5, row[P.SUPPLY_PRESSURE])
            assert 60000.0 * q == pytest.approx(litres, rel=2e-4)
    assert row[P.LAMINAR] < row_of(100.0, 20.0, SERVO, **keys)[P.LAMINAR]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"valve.laminar_reynolds": 0.01}, "0 or at least 0.1"),
        ({"valve.flow_at_10_percent_m3_s": 1e-4}, "must be below what the rated flow"),
        ({"valve.flow_at_10_percent_m3_s": 1e-5, "valve.laminar_reynolds": 15.0}, "in place of laminar_reynolds"),
        ({"valve.flow_at_10_percent_m3_s": 1e-5, "valve.overlap_m": 6e-5}, "must be below what the rated flow"),
    ],
)
def test_what_no_edge_can_have_is_refused(changes, sentence):
    """One sentence that names the key."""
    with pytest.raises(HexsimError, match=sentence):
        changed(SERVO, RATED | changes)


def test_a_sheet_of_a_diameter_has_no_flow_at_10_percent():
    """It is a share of a rated flow: refused where that is not declared."""
    with pytest.raises(HexsimError, match="needs rated_flow_m3_s"):
        changed(BENCH, {"valve.flow_at_10_percent_m3_s": 1e-6})
