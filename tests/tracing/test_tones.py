"""A tone in the force balance is an outside force only where continuity knows nothing of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.signals.log import Log
from hexsim.tracing import balances
from hexsim.tracing.balances import continuity
from hexsim.tracing.fitting import rest_evidence
from hexsim.tracing.fitting.parameters import named
from hexsim.tracing.problems import balance
from hexsim.tracing.steps import dominant, shapes, violations
from hexsim.tracing.steps import logs as trace_logs

HUM_HZ, SAMPLES = 37.0, 1000
BENCH = load_machine("bench")
BALANCES = (*(balances.balance_named(name, BENCH) for name in ("continuity", "force")), continuity.FastContinuity())
TONE = {"amplitude_N": 75.0, "frequency_Hz": HUM_HZ, "phase_rad": 0.3}
SURE = rest_evidence.Evidence(
    candidate=named("outside_force_tone"), share=0.9, unseen=0.9, own=1.0, restored=(0.9, 0.9), remarkable=2.0, tied=(),
)  # fmt: skip


def with_line(amplitudes, values=TONE, line_Hz=HUM_HZ):
    """Evidence for an effect beside two runs of white rows of the balances, at 100 Hz, with a line in each: a run (3,)."""
    random, t = np.random.default_rng(0), np.arange(SAMPLES) / 100.0
    line = np.sin(2 * np.pi * line_Hz * t + 1.0)
    misfit = [random.standard_normal((3, SAMPLES)) + np.outer(run, line) for run in amplitudes]
    logs = [Log(name=name, kind="bench", time=t, rate=100.0, position=np.zeros((1, SAMPLES))) for name in "ab"]
    parts = tuple(balance.BalanceRows(balance=own, sigma=np.ones(1), rows=(0,)) for own in BALANCES)
    problem = balance.BalanceProblem(logs=tuple(logs), parts=parts)
    return replace(
        SURE, line=rest_evidence.line_in_continuity(SimpleNamespace(values=({}, values), misfit=misfit), problem)
    )


@pytest.mark.parametrize("row", [0, 2])
def test_a_tone_that_stands_in_a_continuity_too_is_no_outside_force(row):
    """A line of half the row, in the usual or in the fast balance of every run."""
    there = with_line(2 * [1.4 * np.eye(3)[row]])
    assert there.line == pytest.approx(0.5, abs=0.06)  # 1.4^2/2 over itself and the noise; 1000 samples know it to 0.03
    assert not rest_evidence.sure(there)


def test_a_tone_of_which_continuity_knows_nothing_stays_an_outside_force():
    """What is left of it in the force balance is no witness, nor a line at another frequency, nor one of a single run."""
    for amplitudes in (np.zeros((2, 3)), [[0.0, 3.0, 0.0]] * 2, [[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]]):
        assert rest_evidence.sure(with_line(amplitudes))
    assert rest_evidence.sure(with_line([[3.0, 0.0, 3.0]] * 2, line_Hz=12.0))


def test_a_payload_that_swings_is_no_tone():
    """Its frequency is its own, and motion there may leave a line where the oil's spring is not known well."""
    assert rest_evidence.sure(
        with_line([[3.0, 0.0, 0.0]] * 2, {"mass_kg": 20.0, "frequency_Hz": HUM_HZ, "damping_ratio": 0.05})
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("injected", "found"), [({"pressure_hum": 6e4}, []), ({"outside_force": 40.0}, ["outside_force_tone"])]
)
def test_a_hum_of_the_pressure_is_named_nothing_and_an_outside_force_is_named(tmp_path, injected, found):
    """Benches of the second plant, its parameters off. The hum of 37 Hz was named an outside force of 75 N."""
    write_machine(tmp_path, 407 if not found else 406, injected)
    state = trace_logs.begin(tmp_path, ["fit", "sweep"], ["validate"])
    for step in (violations.STEP, shapes.STEP):
        state = step.run(state, lambda doing: None)
    assert [own.candidate.effect.name for own in dominant.sure_effects(state, lambda doing: None).named] == found
