"""The lag of a transducer: its samples, its balances, and its number found again."""

from dataclasses import replace

import numpy as np
import pytest
from other_plant import write_machine

import hexsim as hx
from hexsim import load_scenario
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.sensors.bank import SensorBank
from hexsim.signals import channels
from hexsim.signals.log import Log
from hexsim.simulation import simulate
from hexsim.tracing import balances
from hexsim.tracing.balances import null
from hexsim.tracing.design import motions
from hexsim.tracing.fitting import fit
from hexsim.tracing.problems.simulated import SimulatedProblem

SAMPLE_s = 1e-3
MOTION = {
    "name": "sine", "mode": "actuator", "duration_s": 4.0, "fade_s": 1.0,
    "axes": {"leg_1": {"kind": "sine", "amplitude": 0.02, "frequency_Hz": 1.5}},
}  # fmt: skip


def read_behind(lag_s: float, places: np.ndarray) -> np.ndarray:
    """What a position transducer without noise reads, behind a lag, of the places (n,) at samples of 1 ms."""
    ideal = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0}
    lag = {"effects.position_lag.time_constant_s": lag_s}
    resolved = resolve(changed(load_machine("bench"), ideal | lag))
    return SensorBank(resolved, len(places), SAMPLE_s, 1)["position"].rows(places[:, None])[:, 0]


@pytest.mark.parametrize("lag_s", [1e-4, 4e-3, 0.1])
def test_a_ramp_behind_a_lag(lag_s):
    """f = r (t - tau (1 - exp(-t/tau))) at every sample: straight lines are exact, however long the lag."""
    t = SAMPLE_s * np.arange(200)
    assert read_behind(lag_s, 3.0 * t) == pytest.approx(3.0 * (t - lag_s * (1.0 - np.exp(-t / lag_s))), abs=1e-12)


def test_a_lag_begins_at_none():
    """Without a lag the samples stay as they are; a lag of 1 ns takes its share of the slope from them."""
    s = np.sin(np.arange(300) / 20.0)
    assert np.array_equal(read_behind(0.0, s), s)
    assert (read_behind(1e-9, s) - s)[1:] == pytest.approx(-1e-9 * np.diff(s) / SAMPLE_s, rel=1e-5, abs=1e-15)


@pytest.mark.parametrize(("name", "violated"), [("position_lag", "sensor"), ("pressure_lag", "force")])
def test_a_balance_holds_again_with_the_lag(name, violated):
    """A noise-free log behind a lag of 50 Hz: what it leaves in its balance falls below a fifth with the effect declared."""
    bench = changed(load_machine("bench"), {"sensors": {}})
    built = changed(bench, {f"effects.{name}": {"time_constant_s": 1.0 / (2 * np.pi * 50.0)}})
    problem = SimulatedProblem(logs=(motions.setpoint_log(bench, MOTION),), noise=dict.fromkeys(bench.uncertainty, 1.0))
    usual, log = problem.simulated(bench, 0), problem.simulated(built, 0)
    inner = slice(round(log.rate), -100)
    balance = balances.balance_named(violated, bench)
    floor = balance.residual(usual, bench)[:, inner]
    without, with_it = (balance.residual(log, machine)[:, inner] for machine in (bench, built))
    assert np.linalg.norm(with_it - floor) < 0.2 * np.linalg.norm(without - floor)


def test_declared_filters_are_in_the_fits():
    """A bench whose transducers have low-passes of 60 and 100 Hz, run and logged: the model that knows them answers at the
    noise; without them the position is off ten times as far. In the balances they are delays: the sensors agree again."""
    built = changed(load_machine("bench"), {"sensors.position_filter_Hz": 100.0, "sensors.pressure_filter_Hz": 60.0})
    plain = changed(built, {"sensors.position_filter_Hz": 0.0, "sensors.pressure_filter_Hz": 0.0})
    run = simulate(built, load_scenario("multisine", duration_s=4.0), seed=5)
    log = replace(Log.of_table("multisine", run.log, "bench"), pressure_top=None)
    problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(built, [log]))
    known, ignored = (np.sqrt(np.mean(problem.residual(machine, 0) ** 2, axis=1)) for machine in (built, plain))
    assert problem.channels(0)[:2] == ["position_m", "pressure_bottom_Pa"]
    assert np.all(known[:2] < 1.05)
    assert ignored[0] > 10.0 and ignored[1] > 3.0
    agreed, late = (
        np.std(null.used(log, balances.balance_named("sensor", built).residual(log, machine)))
        for machine in (built, plain)
    )
    assert agreed < 0.3 * late


@pytest.mark.slow
@pytest.mark.parametrize("cut_off_Hz", [20.0, 40.0])
@pytest.mark.parametrize("name", ["position_lag", "pressure_lag"])
def test_a_lag_is_found_with_its_cut_off(tmp_path, name, cut_off_Hz):
    """A bench of the second plant, its parameters off, traced whole: that effect alone, within 10 %."""
    lag_s = 1.0 / (2 * np.pi * cut_off_Hz)
    write_machine(tmp_path, 43, {name: 1e3 * lag_s})
    result = hx.trace(tmp_path, ["fit", "sweep"], ["validate"])
    assert result.verdict == "explained"
    [effect] = result.report["effects"]
    assert effect["name"] == name
    assert effect["parameters"]["time_constant_s"] == pytest.approx(lag_s, rel=0.1)


def test_a_misfit_beyond_all_numbers_is_infinite():
    """1e200 squared is no number: inf without a warning, as for a simulation that diverged."""
    assert fit.chi2_of([np.array([1.0, 1e200])]) == np.inf
    assert fit.chi2_of([np.array([3.0]), np.array([4.0])]) == 25.0
