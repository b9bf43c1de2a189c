"""Tracing of measured benches: the verdict, the numbers within 10 % of the truth, files that run; slow ones marked."""

import json
from pathlib import Path

import numpy as np
import pytest

import hexsim as hx
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import declared_refit, logs

DATA = Path(__file__).parents[1] / "data"
SHARED = Path(__file__).parents[3] / "shared" / "measured"


def test_hysteresis_is_found(tmp_path):
    """bench_hysteresis: explained, by the spool's backlash alone, half width within 10 % of 0.04 V, and nothing worse
    than 1.3 times the noise (position 2 times) on the held-out sine. report.json and machine.toml are there and valid."""
    steps = []
    result = hx.trace(DATA / "bench_hysteresis", ["fit"], progress=lambda step, share: steps.append((share, step)))
    out = result.to_folder(tmp_path / "out")
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "explained"
    (effect,) = report["effects"]
    assert (effect["name"], effect["balance"], effect["where"]) == ("valve_hysteresis", "valve", "leg 1")
    assert effect["parameters"]["half_width_V"] == pytest.approx(0.04, rel=0.1)
    assert effect["evidence"]["dBIC"] < -10
    for name, row in report["error"]["validate"].items():
        assert row["with_effect"] < (2.0 if name == "position_m" else 1.3) * row["noise"]
        assert row["with_effect"] < row["declared"]
    assert [b["name"] for b in report["balances"] if b["violated"]] == ["valve"]
    assert hx.load_machine(out).effects["valve_hysteresis"]["half_width_V"] == effect["parameters"]["half_width_V"]
    assert "<img" in (out / "report.html").read_text() and "http" not in (out / "report.html").read_text()[:2000]
    shares = [share for share, _ in steps]
    assert shares[0] == 0.0 and shares[-1] == 1.0 and shares == sorted(shares)
    assert next(share for share, step in steps if "the balances ask for valve_hysteresis" in step) < 1.0 / 3.0


def test_a_machine_that_diverges_along_its_logs_ends_in_a_sentence(monkeypatch):
    """Volts that are no valve's: no traceback of the linear algebra, but what to check."""
    state = logs.begin(DATA / "bench_none", ["fit"], ["validate"])
    monkeypatch.setattr(SimulatedProblem, "residual", lambda self, machine, i: np.full((1, 10), np.nan))
    with pytest.raises(hx.HexsimError, match=r"cannot be simulated along fit: its answer diverges\. valve_V must be"):
        declared_refit.refit_declared(state, lambda doing: None)


def test_a_parameter_whose_neighbour_diverges_gets_no_column(monkeypatch):
    """Its column is 0, so that a refit leaves it where it is; the others keep theirs."""
    state = logs.begin(DATA / "bench_none", ["fit"], ["validate"])
    declared = state.machine.oil.bulk_modulus_Pa

    def residual(self, machine, i):
        off = machine.oil.bulk_modulus_Pa != declared
        return np.full((1, 10), np.nan if off else machine.valve.discharge_coefficient)

    monkeypatch.setattr(SimulatedProblem, "residual", residual)
    fit = least_squares.parameter_columns(
        least_squares.start_fit(state.machine, state.base.priors, state.fit_problem), state.fit_problem
    )
    moved = {prior.key for prior, column in zip(fit.priors, fit.columns[0], strict=True) if np.any(column)}
    assert moved == {"discharge_coefficient"}


@pytest.mark.slow
def test_nothing_missing():
    """bench_none: the declared machine with its parameters refitted is enough, and detectable sizes stand for the rest."""
    result = hx.trace(DATA / "bench_none")
    assert result.report["verdict"] == "nothing missing"
    assert result.report["effects"] == [] and result.report["unexplained"] == []
    assert not any(balance["violated"] for balance in result.report["balances"])
    assert result.report["detectable"]["leakage_supply_to_chamber"]["theta_min"] < 1.8e-13  # a tenth of a typical leak


TRUTH = {
    "bench_supply": ("supply_droop", "line_resistance_Pa_s_m3", 2.4e9),
    "bench_leakage": ("leakage_supply_to_chamber", "conductance_m3_s_Pa", 1.8e-12),
    "bench_overlap": ("overlap_change", "overlap_m", 8e-6),
    "bench_incline": ("incline", "angle_rad", 0.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("folder", TRUTH)
def test_measured_benches(folder):
    """The other measured benches: the right name first, its number within 10 %; an incline is tied with a constant force."""
    if not SHARED.is_dir():
        pytest.skip(f"the measured logs are not at {SHARED}")
    result = hx.trace(SHARED / folder, ["fit", "sweep"])
    name, parameter, value = TRUTH[folder]
    assert [e["name"] for e in result.report["effects"]] == [name]
    assert result.report["effects"][0]["parameters"][parameter] == pytest.approx(value, rel=0.1)
    assert ("constant_force" in result.report["effects"][0]["tied_with"]) == (name == "incline")


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "verdict"), [("hexapod_none", "nothing missing"), ("hexapod_leakage", "explained")])
def test_measured_hexapods(folder, verdict):
    """The hexapods: nothing, and the leak of leg 2 within 10 %."""
    if not SHARED.is_dir():
        pytest.skip(f"the measured logs are not at {SHARED}")
    report = hx.trace(SHARED / folder, ["fit"], ["validate_heave", "validate_roll"]).report
    assert report["verdict"] == verdict
    if verdict == "explained":
        (effect,) = report["effects"]
        assert (effect["name"], effect["where"]) == ("leakage_supply_to_chamber", "leg 2")
        assert effect["parameters"]["conductance_m3_s_Pa"] == pytest.approx(3e-12, rel=0.1)
