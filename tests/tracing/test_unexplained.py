"""Effects of the second plant that no library has: the balance that stays violated, and what its rest depends on."""

from pathlib import Path

import numpy as np
import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.signals.channels import noise_of
from hexsim.tracing import rules
from hexsim.tracing.dependence import FORMS
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.report import page as report_page
from hexsim.tracing.report.balance_figure import fitted_curves
from hexsim.tracing.steps.logs import read_runs
from hexsim.tracing.steps.residuals import unexplained_residuals
from hexsim.tracing.steps.violations import violations


@pytest.mark.parametrize(
    ("effect", "balance", "signal", "form"),
    [
        ("position_backlash", "sensor", "position_m", "play"),
        ("controller_jitter", "valve", "valve_V", "late"),
        ("friction_memory", "force", "velocity_m_s", "memory"),
        ("sliding_payload", "force", "acceleration_m_s2", "size"),
        ("flow_gain_of_position", "continuity", "position_m", "product"),
    ],
)
def test_what_a_rest_depends_on(tmp_path, monkeypatch, effect, balance, signal, form):
    """The worst balance, its signal and the form: play of a sensor, a late valve, a memory, impacts (only their size), a gain."""
    monkeypatch.setattr(rules, "NULL_SEEDS", 3)
    write_machine(tmp_path, 12, {effect: None}, "bench", duration_s=20.0)
    machine = load_machine(tmp_path)
    logs, _ = read_runs(Path(tmp_path), ["fit", "sweep"], machine)
    problem = SimulatedProblem(logs=tuple(logs), noise=noise_of(machine, logs))
    worst = unexplained_residuals(violations(machine, machine, problem), problem)[0]
    assert (worst.balance, worst.dependence.signal, worst.dependence.form) == (balance, signal, form)


@pytest.mark.parametrize("form", [*FORMS, "size", "tone"])
def test_every_form_of_a_dependence_has_a_drawing_and_words(form):
    """The report draws one curve or two of as many values as knots, and says the form in words that name the signal."""
    rng = np.random.default_rng(0)
    x, v = rng.uniform(0.0, 1.0, 500), rng.standard_normal(500)
    curves = fitted_curves(form, x, v * x, v)
    assert 1 <= len(curves) <= 2
    for _, knots, curve in curves:
        assert knots.shape == curve.shape and np.all(np.isfinite(curve))
    assert form == "tone" or "{}" in report_page.FORMS[form]
