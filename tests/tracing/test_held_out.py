"""No name stands where a held-out channel grows; the force balance without an accelerometer."""

from dataclasses import replace

import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.signals.log import Log
from hexsim.tracing import balances, held_out
from hexsim.tracing.balances import null
from hexsim.tracing.design import motions
from hexsim.tracing.fitting import fit, parameters
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import logs

RATE = 1000.0
LEAK = {"conductance_m3_s_Pa": 1.0e-12}
MULTISINE = {"kind": "multisine", "amplitudes": [0.01, 0.006, 0.003], "frequencies_Hz": [0.3, 0.9, 2.1], "seed": 3}


@pytest.mark.parametrize("seed", range(3))
def test_growth_is_seen_and_chance_is_not(seed):
    """20 s at 1 kHz with a rest of correlated noise: 5 % more of it is growth in every block and is seen; another draw of the same
    noise, and less of it, are not. Both ways of a sign."""
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.standard_normal(20_200), np.ones(200) / np.sqrt(200.0), "valid")[:20_000]
    other = np.convolve(rng.standard_normal(20_200), np.ones(200) / np.sqrt(200.0), "valid")[:20_000]
    assert held_out.grown(slow, 1.05 * slow, RATE, 4) and held_out.grown(slow, -1.05 * slow, RATE, 4)
    assert not held_out.grown(slow, 0.95 * slow, RATE, 4) and not held_out.grown(slow, other, RATE, 4)
    assert not held_out.grown(slow, slow, RATE, 4) and held_out.grown(slow, np.full(20_000, np.inf), RATE, 4)


def test_what_two_implementations_differ_by_is_no_growth():
    """A thousandth more in every block is sure, and says nothing about an effect."""
    assert not held_out.grown(np.ones(20_000), np.sqrt(1.001) * np.ones(20_000), RATE, 4)
    assert held_out.grown(np.ones(20_000), np.sqrt(1.01) * np.ones(20_000), RATE, 4)


@pytest.fixture(scope="module")
def bench():
    """A bench that leaks, its held-out run of 16 s with noise, and the declared machine."""
    machine = load_machine("bench")
    leaks = changed(machine, {"effects.leakage_supply_to_chamber": LEAK})
    tables = {
        "name": "held out",
        "mode": "actuator",
        "machine_name": machine.name,
        "duration_s": 16.0,
        "fade_s": 1.0,
        "fade": "smooth",
    }
    tables |= {"axes": {"leg_1": MULTISINE}}
    noise = channels.noise_of(machine, [])
    quiet = SimulatedProblem(logs=(motions.setpoint_log(machine, tables),), noise=noise).simulated(leaks, 0)
    log = null.with_noise(quiet, noise, machine.sensors.position_resolution_m, np.random.default_rng(0))
    return machine, leaks, SimulatedProblem(logs=(log,), noise=noise), quiet


def test_the_right_effect_passes_and_a_wrong_one_is_refused(bench):
    """The leak that is there makes no channel worse. The same leak of the other sense, and the right one with a wrong one
    beside it, do: the wrong one is refused, by the channel that it makes worse."""
    machine, leaks, problem, _ = bench
    assert held_out.growths(problem, machine, leaks) == []
    assert {own.channel for own in held_out.growths(problem, leaks, machine)} >= {"position_m", "pressure_bottom_Pa"}
    base = fit.start_fit(machine, parameters.priors(machine)[:1], problem)
    right, wrong = parameters.named("leakage_supply_to_chamber"), parameters.named("leakage_chamber_to_tank")
    one = fit.evaluate(replace(base, candidates=(right,), values=(LEAK,)), problem)
    assert held_out.refused(one, base, problem) is None
    k, why = held_out.refused(fit.evaluate(replace(base, candidates=(wrong,), values=(LEAK,)), problem), base, problem)
    assert k == 0 and why.startswith("leakage_chamber_to_tank is not named: with it ") and "held-out run" in why
    small = {"conductance_m3_s_Pa": 3.0e-13}
    both = fit.evaluate(replace(base, candidates=(right, wrong), values=(LEAK, small)), problem)
    k, why = held_out.refused(both, base, problem)
    assert k == 1 and "leakage_chamber_to_tank" in why


def test_a_growth_is_said_with_digits_that_show_it():
    """A channel that grows by a thousandth in every block is refused with two sizes that differ."""
    said = held_out.Growth(run="roll", channel="position_3_m", without=3.6412, with_it=3.6434).sentence
    assert said == "position_3_m of held-out run roll goes from 3.641 to 3.643 times its noise"


def test_the_others_keep_their_errors_without_a_refused_effect(bench):
    """Of two effects with errors one is left out: the other's error is the one that it had beside it."""
    machine, _, problem, _ = bench
    base = fit.start_fit(machine, parameters.priors(machine)[:1], problem)
    pair = (parameters.named("leakage_supply_to_chamber"), parameters.named("leakage_chamber_to_tank"))
    both = fit.evaluate(replace(base, candidates=pair, values=(LEAK, LEAK)), problem)
    both = replace(both, covariance=np.diag([1.0, 4.0, 9.0]))
    for k in range(2):
        [error] = fit.without_effect(both, k).standard_errors()
        assert error == both.standard_errors()[1 - k] and error["conductance_m3_s_Pa"] > 0.0


@pytest.mark.parametrize("extra_N", [25.0, -25.0])
def test_force_balance_from_the_position_shows_a_force(bench, extra_N):
    """Without an accelerometer sensors' noise makes less than 3 N of it, and a force that the model lacks stands in it with its
    size and side, beside what the model's own run leaves where friction turns."""
    machine, leaks, problem, quiet = bench
    pushed = changed(leaks, {"effects.constant_force": {"force_N": extra_N}})
    plain = replace(problem, logs=(quiet,))
    of_pushed, noisy = plain.simulated(pushed, 0), problem.logs[0]
    balance = balances.balance_named("force", machine)
    noise, own, lacking = (
        null.used(log, balance.residual(replace(log, acceleration=None), leaks)[0]) for log in (noisy, quiet, of_pushed)
    )
    assert balance.wants(replace(noisy, acceleration=None), machine)
    assert np.sqrt(np.mean((noise - own) ** 2)) < 3.0
    complete = null.used(of_pushed, balance.residual(of_pushed, leaks)[0]) - null.used(
        quiet, balance.residual(quiet, leaks)[0]
    )
    assert abs(np.mean(lacking - own)) == pytest.approx(abs(extra_N), abs=0.5)
    assert np.mean(lacking - own) == pytest.approx(np.mean(complete), abs=0.5)


def test_a_log_slower_than_its_controller_is_said(bench):
    """100 Hz of a 500 Hz loop: one sentence; at 500 Hz and faster none."""
    machine, _, _, quiet = bench
    thin = Log(
        name="slow", kind="bench", time=quiet.time[::10], columns={key: x[::10] for key, x in quiet.columns.items()}
    )
    [found] = logs.slower_than_controller([thin], machine)
    assert "100 Hz" in found.description and "500 Hz" in found.description
    assert logs.slower_than_controller([quiet], machine) == []
