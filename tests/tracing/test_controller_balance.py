"""The loop that runs: another gain and a computing delay are read off setpoints, positions and volts."""

import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.signals.log import Log
from hexsim.simulation import simulate
from hexsim.tracing import balances
from hexsim.tracing.balances import controller, null
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import logs, shapes

RUNNING = {"controller_gain": ("relative_change", 0.2), "computing_delay": ("delay_ticks", 1.5)}


@pytest.fixture(scope="module")
def bench():
    return load_machine("bench")


def logged(machine, folder) -> Log:
    """What `hexsim run` writes of a machine, read as a trace reads it."""
    simulate(machine, load_scenario("multisine", duration_s=4.0), seed=3).log.write_parquet(folder / "run.parquet")
    return logs.read_runs(folder, ["run"], load_machine("bench"))[0][0]


@pytest.mark.parametrize("name", RUNNING)
def test_the_loop_that_runs_is_read_off_a_log(bench, tmp_path, name):
    """Gain within 0.1 %, delay within 0.02 ticks; the balance is formed, holds with the effect, and the setpoints drive."""
    key, size = RUNNING[name]
    running = changed(bench, {f"effects.{name}": {key: size}})
    log = logged(running, tmp_path)
    [found] = controller.loops_of(log, bench) or []
    assert found.gain == pytest.approx(1.2 if name == "controller_gain" else 1.0, rel=1e-3)
    assert found.delay_ticks == pytest.approx(1.5 if name == "computing_delay" else 0.0, abs=0.02)
    assert balances.balance_named("controller", bench).wants(log, bench)
    assert logs.feedback_of(bench, [log], channels.declared_noise(bench)) == 0
    without, with_it = (
        float(np.std(null.used(log, balances.balance_named("controller", bench).residual(log, one))))
        for one in (bench, running)
    )
    assert with_it < 0.02 * without
    problem = SimulatedProblem(logs=(log,), noise=channels.declared_noise(bench))
    assert np.sqrt(np.mean(problem.residual(running, 0) ** 2)) < 1.2
    assert np.sqrt(np.mean(problem.residual(bench, 0) ** 2)) > 5.0


def test_of_a_loop_as_declared_no_such_balance_is_formed(bench, tmp_path):
    """The declared loop: nothing to hold against it, so that clean logs are judged as before."""
    log = logged(bench, tmp_path)
    assert controller.loops_of(log, bench) is not None
    assert not balances.balance_named("controller", bench).wants(log, bench)
    assert not {c.effect.name for c in shapes.worth_screening(bench, [], {})} & set(RUNNING)


def test_another_controller_is_no_loop_of_another_gain(bench, tmp_path):
    """Velocity feed-forward in the volts: no gain and delay of a position loop gives them, so that the volts drive."""
    log = logged(changed(bench, {"controller.velocity_feed_forward_V_s_per_m": 3.0}), tmp_path)
    assert controller.loops_of(log, bench) is None
    assert logs.feedback_of(bench, [log], channels.declared_noise(bench)) == 1
