"""The noise of the position in the loop: where the logged volts show it, it moves the model as it moved the machine."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from hexsim.machine import load_machine
from hexsim.machine.files import changed, save_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
from hexsim.tracing.steps.logs import begin, shown_share
from hexsim.tracing.trace import trace

NOISE_m = 2.0e-5  # seven times the bench's: a transducer of a longer stroke, or a cheap one
RUNS = {"multisine": 20.0, "heave": 20.0}


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """A folder: the bench with such a transducer, and its logs."""
    folder = tmp_path_factory.mktemp("noisy")
    sensors = {"sensors.position_noise_m": NOISE_m, "sensors.position_resolution_m": NOISE_m}
    machine = changed(load_machine("bench"), sensors)
    save_machine(machine, folder / "machine.toml")
    for seed, (name, seconds) in enumerate(RUNS.items()):
        simulate(machine, load_scenario(name, duration_s=seconds), seed=seed).log.write_parquet(
            folder / f"{name}.parquet"
        )
    return folder


def rests(problem, machine):
    """rms of every channel's residual in its noise, from the second second on: how the oil rings as a log begins is not known."""
    left = problem.residual(machine, 0)[:, int(problem.logs[0].rate) :]
    return dict(zip(problem.channels(0), np.sqrt(np.mean(left**2, axis=1)), strict=True))


def test_the_machine_that_made_the_log_answers_it_to_the_noise(noisy):
    """Acceleration and pressure are left with their sensors' noise, within 6 %; without what the volts show twice as much is left of the
    acceleration. The position, which the model's own loop holds, is the same."""
    state = begin(noisy, ["multisine"], ["heave"])
    assert state.fit_problem.shown == pytest.approx(1.0, abs=0.03)
    without = rests(state.fit_problem, state.machine)
    known = rests(state.fit_problem.with_known_volts(), state.machine)
    assert known["acceleration_m_s2"] < 1.06 and known["pressure_bottom_Pa"] < 1.06
    assert without["acceleration_m_s2"] > 2.0
    assert known["position_m"] == pytest.approx(without["position_m"], rel=0.01)


@pytest.mark.slow
def test_nothing_is_missing_where_the_position_is_noisy(noisy):
    """The declared machine is all there is."""
    assert trace(noisy, fit=["multisine"], validate=["heave"]).report["verdict"] == "nothing missing"


def test_volts_show_the_noise_of_their_own_reading_alone(noisy):
    """None of it where the controller read another sample than the log has; half of it behind a converter whose steps make as much noise
    as half of it is."""
    state = begin(noisy, ["multisine"], ["heave"])
    [log], noise = state.fit_problem.logs, state.fit_problem.noise
    true = pl.read_parquet(noisy / "multisine.parquet")["true_position_m"].to_numpy()[: log.n]
    another = replace(log, position=true + NOISE_m * np.random.default_rng(1).standard_normal(log.n))
    assert shown_share(state.machine, [another], noise) == 0.0
    step_V = np.sqrt(12.0 / 2.0) * state.machine.controller.gain_V_per_m * noise["position_m"]
    rounded = replace(log, volts=np.round(log.volts / step_V) * step_V)
    assert shown_share(state.machine, [rounded], noise) == pytest.approx(0.5, abs=0.1)
