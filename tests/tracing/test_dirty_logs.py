"""Dirt in a log has no say in what the tracer finds. The whole table: benchmarks/tracing_dirt.py."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import hexsim as hx
from hexsim import readers
from hexsim.machine import load_machine
from hexsim.tracing import balances
from hexsim.tracing.problems import balance as balance_problem
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.simulation import simulator
from hexsim.tracing.steps import logs

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from dirt import CASES  # noqa: E402

LEAKING = HERE.parent / "data" / "bench_leakage"
NOISE = {
    "position_m": 3e-6, "pressure_bottom_Pa": 4e3, "pressure_supply_Pa": 4e3, "acceleration_m_s2": 0.02,
    "angular_acceleration_rad_s2": 1.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def machine():
    return load_machine(LEAKING)


@pytest.fixture(scope="module")
def log():
    return readers.read_log(LEAKING / "fit.csv.gz").head(4.0)


def folder_with(case: str, folder: Path, seed: int = 1, names: tuple[str, ...] = ("fit", "sweep", "validate")) -> Path:
    (folder / "machine.toml").write_text((LEAKING / "machine.toml").read_text())
    rng = np.random.default_rng(seed)
    for name in names:
        CASES[case](pl.read_csv(LEAKING / f"{name}.csv.gz"), rng).write_csv(folder / f"{name}.csv")
    return folder


def test_filled_samples_weigh_nothing(machine, log):
    """Whatever stands in a filled stretch, residuals of simulation and balances are the same, and noise keeps its size."""
    marks = np.zeros(log.n, dtype=bool)
    marks[2000:2007] = True
    columns = dict(log.columns)
    columns["acceleration_m_s2"] = np.where(marks, 50.0, columns["acceleration_m_s2"])
    repaired = {"acceleration_m_s2": marks}
    found = []
    for one in (replace(log, repaired=repaired), replace(log, repaired=repaired, columns=columns)):
        own = {"acceleration_m_s2": one.columns["acceleration_m_s2"]}
        simulated = SimulatedProblem(logs=(replace(log, repaired=repaired, columns=log.columns | own),), noise=NOISE)
        rows = balance_problem.BalanceRows(
            balance=balances.balance_named("force", machine), sigma=np.ones(1), rows=(0,)
        )
        balance = balance_problem.BalanceProblem(logs=(one,), parts=(rows,)).residual(machine, 0)
        found.append((simulated.residual(machine, 0), balance))
    np.testing.assert_array_equal(found[0][0][:, :], found[1][0])
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-9)
    plain = SimulatedProblem(logs=(log,), noise=NOISE).residual(machine, 0)
    assert np.sum(found[0][0] ** 2) == pytest.approx(np.sum(plain**2), rel=2e-3)


def test_a_gap_makes_two_runs_with_states_of_their_own(tmp_path):
    """300 rows missing: both stretches are fitted, each named by when it begins."""
    folder = folder_with("300 missing rows", tmp_path, names=("fit", "validate"))
    state = logs.begin(folder, ["fit"], ["validate"])
    longer, shorter = state.fit_problem.logs
    assert longer.name == "fit" and shorter.name == f"fit from {shorter.offset_s:.1f} s"
    assert longer.n + shorter.n == 19700
    assert any("the rest lies beyond missing values" in f.description for f in state.findings[longer.name])


def test_a_slow_log_is_simulated_with_every_tick_of_its_controller(machine, log):
    """100 Hz of a 500 Hz loop: the answer is that of 1 kHz at the same instants, within a tenth of the sensors' noise."""
    fast = simulator.simulate_log(machine, log, 0, {})
    columns = {name: np.ascontiguousarray(x[::10]) for name, x in log.columns.items()}
    slow = simulator.simulate_log(machine, replace(log, columns=columns, time=log.time[::10], rate=100.0), 0, {})
    kinds = {"position": 3e-6, "pressure_bottom": 4e3, "acceleration": 0.02}
    for name, noise in kinds.items():
        off = slow[name][0, 30:-20] - fast[name][0, ::10][30:-20]
        assert np.sqrt(np.mean(off**2)) < 0.3 * noise, name


def test_the_controller_ticks_where_the_volts_change(machine, log):
    """A log that begins with the second sample of a tick: the same answer but for its first tenths of a second."""
    whole = simulator.simulate_log(machine, log, 0, {})
    later = simulator.simulate_log(machine, log.part(slice(1, None)), 0, {})
    off = later["position"][0, 500:] - whole["position"][0, 501:]
    assert np.max(np.abs(off)) < 1e-6


@pytest.mark.slow
def test_jitter_and_lost_rows_leave_the_leak_as_it_is(tmp_path):
    """Stamps 0.4 ms off and 7 rows lost in each log: the leak within 0.5 %, and every repair is in the report."""
    folder = folder_with("stamps off by 0.4 ms and 7 missing rows", tmp_path)
    result = hx.trace(folder, fit=["fit", "sweep"], validate=["validate"])
    assert result.verdict == "explained"
    (effect,) = result.report["effects"]
    assert effect["name"] == "leakage_supply_to_chamber"
    assert effect["parameters"]["conductance_m3_s_Pa"] == pytest.approx(1.8e-12, rel=5e-3)
    said = [found["description"] for found in result.report["findings"]["fit"]]
    assert any("rows counted instead" in one for one in said) and any("7 samples filled" in one for one in said)
