"""Effects of the second plant that no library has: the balance that stays violated, and what its rest depends on."""

from pathlib import Path

import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.tracing import rules
from hexsim.tracing.answer import Question
from hexsim.tracing.channels import noise_of
from hexsim.tracing.localise import violations
from hexsim.tracing.trace import read_runs
from hexsim.tracing.unexplained import what_is_left


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
    logs, _, _ = read_runs(Path(tmp_path), ["fit", "sweep"], machine)
    question = Question(logs=tuple(logs), noise=noise_of(machine, logs))
    worst = what_is_left(violations(machine, machine, question), question)[0]
    assert (worst.balance, worst.dependence.signal, worst.dependence.form) == (balance, signal, form)
