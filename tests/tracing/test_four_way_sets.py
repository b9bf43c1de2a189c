"""Four-way machines traced: measured sets whose truth is known, and what a log without pressures still says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from four_edge_plant import UNCERTAIN, write_machine
from test_real_machines import MEASURED

import hexsim as hx
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.tracing import balances
from hexsim.tracing.balances import null
from hexsim.tracing.design import motions
from hexsim.tracing.fitting import parameters
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import logs as trace_logs
from hexsim.tracing.steps import violations

servo_logs = pytest.mark.skipif(
    not (MEASURED / "servo_none").is_dir(), reason="no measured servo sets beside the repository"
)


@servo_logs
@pytest.mark.slow
def test_a_servo_actuator_as_declared_lacks_nothing():
    """The measured set without an effect: nothing missing, in all balances of both chambers."""
    result = hx.trace(MEASURED / "servo_none", ["fit", "sweep"])
    assert result.verdict == "nothing missing"
    assert "continuity of the rod side" in {line["name"] for line in result.report["balances"]}


@servo_logs
@pytest.mark.slow
def test_leakage_across_the_piston_is_found_with_its_number():
    """The measured set with 6e-13 m3/s/Pa across the piston: that effect alone, within 2 %."""
    result = hx.trace(MEASURED / "servo_leakage", ["fit", "sweep"])
    truth = json.loads((MEASURED / "servo_leakage" / "truth.json").read_text())["undeclared"]["cross_leak"]
    [effect] = result.report["effects"]
    assert effect["name"] == "leakage_across_piston"
    assert effect["parameters"]["conductance_m3_s_Pa"] == pytest.approx(truth, rel=0.02)


@pytest.fixture(scope="module")
def four_way(tmp_path_factory):
    """A log of a four-way machine, and what is declared of it."""
    folder = tmp_path_factory.mktemp("four_way")
    write_machine(folder, 1, duration_s=9.0)
    machine = load_machine(folder)
    [log], _ = trace_logs.read_runs(folder, ["fit"], machine)
    return log, machine


@pytest.mark.parametrize(
    ("columns", "lost"),
    [
        ((), set()),
        (("pressure_top_Pa",), {"continuity of the rod side", "force"}),
        (("pressure_top_Pa", "pressure_bottom_Pa"), {"continuity", "continuity of the rod side", "force"}),
    ],
    ids=["both pressures", "bottom alone", "none"],
)
def test_what_cannot_be_said_is_said(four_way, columns, lost):
    """A four-way log without pressures: the balances that it does not allow and the channels that they lack, in a sentence."""
    log, machine = four_way
    log = replace(log, **{column.removesuffix("_Pa"): None for column in columns})
    found = violations.lost_balances([log], machine)
    said = " ".join(finding.description for finding in found)
    assert all(name in said for name in (*columns, *lost))
    assert bool(found) == bool(columns)


def test_a_pressure_difference_alone_gives_the_force_balance_of_equal_areas():
    """Without both pressures but with their difference: the same force residual of a spring within 1 %, the two continuities
    are said to be lost, and the simulation answers the difference that is measured."""
    machine = load_machine("servo_bench")
    moved = {"kind": "sine", "amplitude": 0.05, "frequency_Hz": 0.8}
    motion = {"name": "heave", "mode": "actuator", "duration_s": 4.0, "fade_s": 1.0, "axes": {"leg_1": moved}}
    problem = SimulatedProblem(logs=(motions.setpoint_log(machine, motion),), noise=channels.declared_noise(machine))
    both = problem.simulated(changed(machine, {"effects.spring": {"stiffness_N_m": 2e4}}), 0)
    assert both.pressure is not None and both.signal("pressure_top") is not None
    difference = both.pressure - both.signal("pressure_top")
    alone = replace(both, pressure_bottom=None, pressure_top=None, pressure_difference=difference)
    force = balances.balance_named("force", machine)
    assert force.wants(alone, machine)
    whole, part = (null.used(log, force.residual(log, machine)) for log in (both, alone))
    assert np.std(whole) > 100.0
    assert np.std(part - whole) < 0.01 * np.std(whole)
    [said] = violations.lost_balances([alone], machine)
    assert "pressure_bottom_Pa" in said.description and "continuity" in said.description
    assert "force" not in said.description
    answer = replace(problem, logs=(alone,)).simulated(machine, 0)
    assert answer.signal("pressure_top") is None
    assert answer.signal("pressure_difference") is not None


def test_a_start_in_motion_leaves_no_drift(tmp_path):
    """A leaking bench that begins in motion, its true numbers known: from the first 0.4 s on no mean over 0.4 s of a position
    or pressure is off by more than 5 of its standard errors. (Steps that fell short left 23, drifting for 2 s.)"""
    true = write_machine(tmp_path, 100, "cross_leak", duration_s=6.0)
    machine = load_machine(tmp_path)
    logs, _ = trace_logs.read_runs(tmp_path, ["sweep"], machine)
    known = {prior: true[UNCERTAIN[prior.key][0]] / prior.declared - 1.0 for prior in parameters.priors(machine)}
    leak = (parameters.named("leakage_across_piston"), {"conductance_m3_s_Pa": true["cross_leak"]})
    problem = SimulatedProblem(logs=tuple(logs), noise=channels.declared_noise(machine))
    rest = problem.residual(parameters.with_settings(machine, known, [leak]), 0)[:4]
    means = 20.0 * rest[:, : rest.shape[1] // 400 * 400].reshape(4, -1, 400).mean(axis=2)
    assert np.abs(means).max() < 5.0
