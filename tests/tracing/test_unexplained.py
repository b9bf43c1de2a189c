"""Effects of the second plant that no library has: the balance that stays violated, and what its rest depends on."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.signals import channels
from hexsim.tracing import dependence, rules
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.report import page as report_page
from hexsim.tracing.report import tables
from hexsim.tracing.report.balance_figure import fitted_curves
from hexsim.tracing.steps import logs as trace_logs
from hexsim.tracing.steps import violations as violated
from hexsim.tracing.steps.residuals import unexplained_residuals


@pytest.mark.parametrize(
    ("effect", "balance", "signal", "form"),
    [
        ("position_backlash", "sensor", "position_m", "play"),
        pytest.param("controller_jitter", "valve", "valve_V", "late", marks=pytest.mark.slow),
        pytest.param("friction_memory", "force", "velocity_m_s", "memory", marks=pytest.mark.slow),
        pytest.param("sliding_payload", "force", "acceleration_m_s2", "size", marks=pytest.mark.slow),
        pytest.param("flow_gain_of_position", "continuity", "position_m", "product", marks=pytest.mark.slow),
    ],
)
def test_what_a_rest_depends_on(tmp_path, monkeypatch, effect, balance, signal, form):
    """The worst balance, its signal and the form: play of a sensor, a late valve, a memory, impacts (only their size), a gain."""
    monkeypatch.setattr(rules, "NULL_SEEDS", 3)
    write_machine(tmp_path, 12, {effect: None}, "bench", duration_s=20.0)
    machine = load_machine(tmp_path)
    logs, _ = trace_logs.read_runs(Path(tmp_path), ["fit", "sweep"], machine)
    problem = SimulatedProblem(logs=tuple(logs), noise=channels.noise_of(machine, logs))
    worst = unexplained_residuals(violated.violations(machine, machine, problem), problem)[0]
    assert (worst.balance, worst.dependence.signal, worst.dependence.form) == (balance, signal, form)


@pytest.mark.parametrize("form", [*dependence.FORMS, "size", "tone"])
def test_every_form_of_a_dependence_has_a_drawing_and_words(form):
    """The report draws one curve or two of as many values as knots, and says the form in words that name the signal."""
    rng = np.random.default_rng(0)
    x, v = rng.uniform(0.0, 1.0, 500), rng.standard_normal(500)
    curves = fitted_curves(form, x, v * x, v)
    assert 1 <= len(curves) <= 2
    for _, knots, curve in curves:
        assert knots.shape == curve.shape and np.all(np.isfinite(curve))
    assert form == "tone" or "{}" in tables.FORMS[form]


def test_the_sentence_says_which_signal_is_the_worst_before_and_after():
    """Of a machine with a sure effect another leg may be the worst afterwards: each error stands with its own signal, and what is
    left with its place."""
    errors = {
        f"position_{leg}_m": {"noise": 1.0, "declared": 9.0, "refit": before, "with_effect": after}
        for leg, before, after in ((3, 423.0, 8.5), (4, 42.0, 45.7))
    }
    rest = {"balance": "continuity", "where": "leg 4", "depends_on": "time_s", "form": "plain", "frequency_Hz": None}
    report = {"error": {"roll": errors}, "unexplained": [rest | {"memory_s": 1.5, "r2_of_signals": {}}]}
    effect = SimpleNamespace(apart=(), share=0.9, gain_cv=0.8)
    said = report_page.sentence(SimpleNamespace(report=report, verdict="partly", effects=[effect]))
    assert "from 423 (position of leg 3) to 45.7 (position of leg 4) times its sensor's noise" in said
    assert "in the continuity balance of leg 4: a curve over the time behind a low-pass of 1.5 s." in said
