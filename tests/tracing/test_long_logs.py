"""Logs of minutes: what a trace keeps of them, and how it begins."""

import time
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hexsim.tracing import rules
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters
from hexsim.tracing.problems import problem as problems
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import declared_refit
from hexsim.tracing.steps import logs as trace_logs

DATA = Path(__file__).parents[1] / "data" / "bench_leakage"
CHANNELS, N = 4, 50_000


class Slow(problems.FitProblem):
    """A residual that takes as long as a short simulation."""

    logs = (SimpleNamespace(n=N),)

    def residual(self, machine, i):
        time.sleep(0.05)
        return np.full((CHANNELS, N), machine.load.moving_mass_kg)

    def channels(self, i):
        return ["a"] * CHANNELS

    def used(self, i):
        return N


def test_columns_of_declared_parameters_are_held_once():
    """Columns of a long log take their own size and that of a few residuals while they are made, not twice their size."""
    machine = trace_logs.begin(DATA, ["fit"], ["validate"]).machine
    own, problem = parameters.priors(machine), Slow()
    fit = least_squares.Fit(
        machine=machine, priors=own, deviations=np.zeros(len(own)), candidates=(), values=(), chi2=0.0, n=1,
        misfit=[np.full((CHANNELS, N), machine.load.moving_mass_kg)],
    )  # fmt: skip
    size = len(own) * CHANNELS * N * 8
    assert size > 8 * CHANNELS * N * 8  # else a few residuals would hide a copy
    tracemalloc.start()
    try:
        columns = least_squares.parameter_columns(fit, problem).columns
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert columns is not None and columns[0].nbytes == size
    assert peak < 1.8 * size  # a busy computer may take a few results late


@pytest.mark.slow
def test_a_refit_that_begins_with_the_opening_ends_as_one_that_does_not(monkeypatch):
    """The opening seconds only begin: chi2 ends alike, to the share at which a refit stops, with fewer whole simulations."""
    whole_runs, plain = [], SimulatedProblem.residual

    def counted(problem, machine, i):
        whole_runs[-1] += problem.duration_s > 10.0
        return plain(problem, machine, i)

    monkeypatch.setattr(SimulatedProblem, "residual", counted)
    found = []
    for long_s in (5.0, np.inf):
        monkeypatch.setattr(rules, "LONG_S", long_s)
        whole_runs.append(0)
        found.append(declared_refit.refit_declared(trace_logs.begin(DATA, ["fit"], ["validate"]), print).base)
    assert found[0].chi2 - found[1].chi2 == pytest.approx(0.0, abs=rules.BASE_TOLERANCE * (found[1].chi2 - found[1].n))
    assert whole_runs[0] < whole_runs[1]
