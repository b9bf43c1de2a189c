"""A machine that cannot be built is an infinitely bad candidate, wherever one is evaluated; of the declared one the user is told."""

from dataclasses import replace

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.machine import load_machine, save_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.tracing import balances
from hexsim.tracing.design import motions
from hexsim.tracing.fitting import fit, parameters, screening, selection
from hexsim.tracing.problems import balance as balance_problem
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import logs as logs_step
from hexsim.tracing.steps.experiments import separation

OUT_OF_REACH = {"x_m": 0.2, "y_m": 0.2, "z_m": -0.2}


def heave_log(machine):
    """A second of heave as the machine would write it, noise apart."""
    tables = {
        "name": "heave", "mode": "dof", "machine_name": machine.name, "duration_s": 1.5,
        "axes": {"z": {"kind": "sine", "amplitude": 0.02, "frequency_Hz": 1.0}},
    }  # fmt: skip
    bare = SimulatedProblem(logs=(motions.setpoint_log(machine, tables),), noise=machine_noise(machine))
    return bare.simulated(machine, 0)


def machine_noise(machine):
    return channels.noise_of(machine, [])


@pytest.fixture(scope="module")
def hexapod():
    """A hexapod's log, as a simulated problem and as one of its balances."""
    machine = load_machine("micro_motion_system")
    log = heave_log(machine)
    simulated = SimulatedProblem(logs=(log,), noise=machine_noise(machine))
    held = [
        balance
        for balance in balances.library()
        if balance.name in ("platform", "sensor") and balance.wants(log, machine)
    ]
    parts = [
        balance_problem.BalanceRows(
            balance=one, sigma=np.ones(len(one.places(log))), rows=tuple(range(len(one.places(log))))
        )
        for one in held
    ]
    return (
        machine,
        parameters.priors(machine),
        simulated,
        balance_problem.BalanceProblem(logs=(log,), parts=tuple(parts)),
    )


@pytest.mark.parametrize("kind", ["simulated", "balances"])
def test_joints_out_of_reach_are_an_infinite_misfit(hexapod, kind):
    """Evaluated, as a neighbour, as a column of a screening and as a start: infinite, no column, no rival; never an error."""
    machine, own, simulated, balances = hexapod
    problem = simulated if kind == "simulated" else balances
    base = fit.start_fit(machine, own[:2], problem)
    candidate = parameters.named("base_joint_offset", "leg 3")
    far = fit.evaluate(replace(base, candidates=(candidate,), values=(OUT_OF_REACH,)), problem)
    assert np.isfinite(base.chi2) and far.chi2 == np.inf
    assert far.misfit[0].shape == base.misfit[0].shape and not selection.residual_at_noise_level(far.misfit)
    beside = replace(
        base, candidates=(candidate,), values=(OUT_OF_REACH,)
    )  # a good fit whose neighbours are out of reach
    assert not np.any(fit.effect_columns(beside, problem)[0])
    size = replace(candidate.effect.parameters[0], typical=40.0, bounds=(-100.0, 100.0))
    wild = replace(candidate, effect=replace(candidate.effect, parameters=(size, *candidate.effect.parameters[1:])))
    assert not np.isfinite(screening.columns_of(base, [wild], problem)[0][0]).any()
    assert screening.screen(fit.parameter_columns(base, problem), [wild], problem) == []
    assert selection.try_candidate(base, wild, 1.0, problem, 1) is None


def test_a_round_in_which_nothing_simulates_has_no_rival(hexapod, monkeypatch):
    """A column that promises enough, and no size of its effect that simulates: the round ends without a rival."""
    machine, own, simulated, _ = hexapod
    base = fit.start_fit(machine, own[:2], simulated)
    monkeypatch.setattr(selection, "shortlist", lambda lines, *limits: lines)
    monkeypatch.setattr(selection, "try_candidate", lambda *given: None)
    stage = selection.advance(base, [parameters.named("base_joint_offset", "leg 3")], simulated, lambda step: None, 0.0)
    assert len(stage.lines) == 1 and stage.rivals == []


def test_a_number_that_no_machine_may_have_is_an_infinite_misfit(hexapod):
    """A declared parameter whose uncertainty reaches below zero: its column is zero, the refit ends and the machine stands."""
    machine, _, simulated, _ = hexapod
    mass = machine.load.carried_mass_kg
    wide = parameters.Prior(
        key=machine.load.mass_key, dotted=f"load.{machine.load.mass_key}", declared=mass, half_width=150.0
    )
    base = fit.start_fit(machine, (wide,), simulated)
    gone = replace(base, deviations=np.array([-2.0]))
    assert gone.built() is None and fit.evaluate(gone, simulated).chi2 == np.inf
    with pytest.raises((HexsimError, ValueError)):
        gone.fitted_machine()
    fitted = fit.refine(replace(base, deviations=np.array([0.0])), simulated, steps=1)
    assert np.isfinite(fitted.chi2) and fitted.chi2 <= base.chi2


def test_a_motion_that_one_of_two_cannot_take_separates_nothing(hexapod):
    """An experiment with a load that cannot be declared: no separation, no error."""
    machine, _, simulated, _ = hexapod
    tables = {
        "name": "separate", "mode": "dof", "machine_name": machine.name, "duration_s": 0.5,
        "axes": {"z": {"kind": "sine", "amplitude": 0.01, "frequency_Hz": 1.0}},
        "machine": {f"load.{machine.load.mass_key}": -1.0},
    }  # fmt: skip
    assert separation(machine, machine, simulated.noise, tables) == 0.0


def test_the_user_is_told_why_the_declared_machine_cannot_be_built(hexapod, monkeypatch, tmp_path):
    """Joints out of reach in the machine file itself: the sentence of the check, not a divergence."""
    machine, _, simulated, _ = hexapod
    bad = changed(machine, {"effects.base_joint_offset": OUT_OF_REACH | {"where": "leg 3"}})
    save_machine(bad, tmp_path / "machine.toml")
    for name in ("fit", "validate"):
        (tmp_path / f"{name}.csv").write_text("time_s\n0\n")
    monkeypatch.setattr(logs_step, "read_runs", lambda *given: ([simulated.logs[0]], {}))
    with pytest.raises(HexsimError, match="leg 3"):
        logs_step.begin(tmp_path, ["fit"], ["validate"])
