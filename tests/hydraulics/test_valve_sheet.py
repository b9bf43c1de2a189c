"""A valve declared from its data sheet: what the sheet says comes back from the test stand."""

import json
import math

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.hydraulics import leg, parameters
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.studies.valve_test import valve_test

CURVE = {"signal": [0.0, 2.0, 40.0, 100.0], "flow": [0.0, 0.0, 10.0, 38.0]}
SHEET = {
    "valve.overlap_m": None,
    "valve.flow_curve": CURVE,
    "valve.hysteresis_percent": 2.0,
    "valve.null_shift_percent": 0.5,
    "valve.spool_frequency_Hz": 0.0,
    "valve.small_signal_minus_90deg_Hz": 100.0,
    "valve.small_signal_minus_3dB_Hz": 90.0,
    "valve.large_signal_minus_3dB_Hz": 35.0,
    "valve.edge_rounding_m": 0.0,
}


@pytest.fixture(scope="module")
def machine():
    """The servo bench with a valve from a sheet: inflected flow, hysteresis, null shift, two amplitudes."""
    return changed(load_machine("servo_bench"), SHEET)


@pytest.fixture(scope="module")
def test(machine):
    """Its test stand."""
    return valve_test(machine)


def test_the_sheet_comes_back(test):
    """38 l/min less the hysteresis at full signal, 2 %, 0.5 %; small-signal frequencies to 1 %, the large one to 5 %.

    The large signal's slew rate is that of a triangle; the spool's own lag takes the rest.
    """
    figures = test.figures
    slope = 28.0 / 60.0  # [l/min / %] of the last stretch; null 0.5 % and half the loop, 1 %, are lost at the end
    assert figures["rated_flow_l_min"] == pytest.approx(38.0 - 0.5 * slope, rel=1e-3)
    assert figures["hysteresis_percent"] == pytest.approx(2.0, abs=0.01)
    assert figures["null_percent"] == pytest.approx(0.5, abs=0.1)
    assert figures["dead_band_percent"] == pytest.approx(4.0, abs=0.5)
    assert figures["null_leakage_l_min"] < 1e-4  # the stand's own seal
    for amplitude in ("5", "25"):
        small = figures["dynamics"][amplitude]
        assert small["minus_90deg_Hz"] == pytest.approx(100.0, rel=0.01)
        assert small["minus_3dB_Hz"] == pytest.approx(90.0, rel=0.01)
    assert figures["dynamics"]["100"]["minus_3dB_Hz"] == pytest.approx(35.0, rel=0.05)


@pytest.mark.parametrize("sign", [1, -1])
def test_flow_curve_at_its_points_and_between(machine, sign):
    """The row's opening is flow over rated flow times travel: at the points, between them, mirrored."""
    row, travel = parameters.declared_rows(machine)[0], 5e-4
    for percent, flow in ((1.0, 0.0), (2.0, 0.0), (21.0, 5.0), (40.0, 10.0), (70.0, 24.0), (100.0, 38.0)):
        opening = leg.flow_curve(row, sign * percent / 100 * travel)
        assert opening == pytest.approx(sign * flow / 38.0 * travel, rel=1e-6, abs=1e-15)


def test_flow_curve_in_other_units(machine):
    """The same curve in volts and cubic metres a second, or in shares, gives the same points."""
    volts = {
        "signal": [s / 10 for s in CURVE["signal"]],
        "flow": [q / 6e4 for q in CURVE["flow"]],
        "signal_unit": "V",
        "flow_unit": "m3_s",
    }
    shares = {
        "signal": [s / 100 for s in CURVE["signal"]],
        "flow": [q / 38 for q in CURVE["flow"]],
        "signal_unit": "1",
        "flow_unit": "1",
    }
    for other in (volts, shares):
        again = parameters.flow_points(changed(machine, {"valve.flow_curve": other}).valve, 860.0)
        np.testing.assert_allclose(again, parameters.flow_points(machine.valve, 860.0), rtol=1e-7, atol=1e-18)


def test_slew_time_and_lap_in_percent():
    """0 to 100 % in 20 ms is 25 mm/s of 0.5 mm; 3 % of lap is 15 um."""
    machine = changed(
        load_machine("servo_bench"), {"valve.slew_time_s": 0.02, "valve.overlap_m": None, "valve.overlap_percent": 3.0}
    )
    row = parameters.declared_rows(machine)[0]
    assert row[P.SPOOL_RATE] == pytest.approx(0.025)
    assert row[P.OVERLAP_SUPPLY] == row[P.OVERLAP_TANK_TOP] == pytest.approx(15e-6)


def test_rounded_edges_at_null():
    """Matched edges at null: flow gain steepens to the slope, leakage is 2 K s ln 2 sqrt(Ps/2), load pressure 0."""
    machine = load_machine("servo_bench")
    found, p = valve_test(machine), parameters.declared_rows(machine)[0]
    opening = 2e-6 * math.log(2.0)
    edge = p[P.DISCHARGE] * p[P.AREA_GRADIENT_SUPPLY] * opening * math.sqrt(2 / 855.0) * math.sqrt(7.9e6)
    assert found.figures["null_leakage_l_min"] == pytest.approx(2 * edge * 6e4, rel=1e-3)
    assert found.load_pressure_Pa[500] == pytest.approx(0.0, abs=10.0)
    assert found.figures["rated_flow_l_min"] == pytest.approx(38.0, rel=1e-4)


def test_pressure_gain_at_null():
    """Rounded edges without lap: dP_L/dx = (Ps - Pt)/(s ln 2), from P_A = (r^2 Ps + Pt)/(1 + r^2), r = o(x)/o(-x)."""
    machine = load_machine("servo_bench")
    p, travel = parameters.declared_rows(machine)[0], machine.valve.spool_travel_max_m
    by_hand = (p[P.SUPPLY_PRESSURE] - p[P.TANK_PRESSURE]) / (p[P.ROUNDING_SUPPLY] * math.log(2.0)) * travel
    found = valve_test(machine).figures["pressure_gain_percent"] * p[P.SUPPLY_PRESSURE]
    assert p[P.OVERLAP_SUPPLY] == 0.0 and found == pytest.approx(by_hand, rel=2e-3)  # steps of 0.01 % of the signal


REFUSED = [
    ({"valve.small_signal_minus_90deg_Hz": 50.0}, "spool_frequency_Hz or small_signal_minus_90deg_Hz"),
    ({"valve.small_signal_minus_3dB_Hz": 200.0}, "no second-order spool"),
    ({"valve.slew_time_s": 0.01, "valve.large_signal_minus_3dB_Hz": 40.0}, "slew_time_s"),
    ({"valve.flow_curve": CURVE, "valve.overlap_m": 5e-6}, "flow_curve needs"),
    ({"valve.hysteresis_percent": 1.0, "valve.threshold_percent": 1.5}, "threshold_percent = 1.5 must not exceed"),
    ({"valve.flow_curve": {**CURVE, "flow": [0.0, 3.0, 2.0, 38.0]}, "valve.overlap_m": None}, "must not fall"),
    ({"valve.flow_curve": {**CURVE, "signal": [1.0, 2.0, 40.0, 100.0]}, "valve.overlap_m": None}, "begins at signal 0"),
]


@pytest.mark.parametrize(("changes", "says"), REFUSED, ids=[says for _, says in REFUSED])
def test_sheets_that_contradict_themselves_are_refused(changes, says):
    """One sentence that names the key."""
    with pytest.raises(HexsimError) as caught:
        changed(load_machine("servo_bench"), changes)
    assert says in str(caught.value)


@pytest.mark.parametrize("name", ["bench", "servo_bench"])
def test_command_draws_three_and_four_way_valves(name, tmp_path):
    """`hexsim test valve` writes its page, figures and figures as JSON."""
    from typer.testing import CliRunner

    result = CliRunner().invoke(app, ["test", "valve", name, "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "valve.json").read_text())
    assert found["figures"]["rated_flow_l_min"] > 10.0
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png") == 2


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("threshold", "hysteresis"), [(0.5, 2.0), (2.0, 2.0), (0.0, 1.0)])
def test_threshold_is_the_smallest_reversal_that_moves_the_flow(threshold, hysteresis, sign):
    """After a rise to 50 % a reversal below the threshold leaves the flow as it is to the bit, one beyond it moves it; a full
    cycle's loop is as wide as the hysteresis; both again on the way back."""
    sheet = {"valve.hysteresis_percent": hysteresis, "valve.threshold_percent": threshold}
    row = parameters.declared_rows(changed(load_machine("servo_bench"), sheet))[0]
    at = np.concatenate(
        [np.linspace(0, 50, 501), [50 - max(threshold - 1e-9, 0.0), 50 - threshold - 1e-3], np.linspace(50, -100, 1501)]
    )
    percent = sign * np.concatenate([at, np.linspace(-100, 50, 1501)])
    held = leg.valve_volts(percent / 10, row[P.HYSTERESIS], 0.0, row[P.HYSTERESIS_SPREAD]) * 10
    assert held[501] == pytest.approx(held[500], abs=1e-12)
    assert 2e-4 < sign * (held[500] - held[502]) < 1.1e-3
    falling, rising = held[503:2004], held[2004:]
    assert falling[500] - rising[1000] == pytest.approx(sign * hysteresis, abs=1e-9)  # both at signal 0
    if threshold == hysteresis:
        plain = leg.valve_volts(percent / 10, row[P.HYSTERESIS], 0.0) * 10
        assert np.array_equal(held, plain)


def test_threshold_comes_back_from_the_stand():
    """0.5 % of 2 % declared: the stand reads both, to a step of its reversal (0.01 %)."""
    sheet = {"valve.hysteresis_percent": 2.0, "valve.threshold_percent": 0.5}
    figures = valve_test(changed(load_machine("servo_bench"), sheet)).figures
    assert figures["threshold_percent"] == pytest.approx(0.5, abs=0.011)
    assert figures["hysteresis_percent"] == pytest.approx(2.0, abs=0.01)
    assert valve_test(load_machine("servo_bench")).figures["threshold_percent"] == 0.0
