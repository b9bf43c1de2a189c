"""A balance is one file: its name, its words and its signals go with it wherever the balances are used."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_plant import write_machine

from hexsim import readers
from hexsim.hydraulics import leg
from hexsim.machine import load_machine
from hexsim.signals import channels
from hexsim.tracing import balances, rules
from hexsim.tracing.balances import continuity
from hexsim.tracing.fitting import parameters
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import violations as violated
from hexsim.tracing.steps.residuals import unexplained_residuals

DATA = Path(__file__).parents[1] / "data"
LAG = '''
"""The position loop: volts asked for less volts logged [V]."""

import numpy as np

from hexsim.tracing.balances.balance import Balance


class Loop(Balance):
    """u - K (s - y_m) of each leg, with 50 mV that are not there."""

    name, unit, caption, order = "loop", "V", "volts = gain times error", 15
    signals = ("valve_V", "position_m")

    def needs(self, machine):
        return (("setpoint", "valve"),)

    def places(self, log):
        return [f"leg {i + 1}" for i in range(log.n_legs)]

    def residual(self, log, machine):
        asked = machine.controller.gain_V_per_m * (log.setpoint - log.position)
        return log.volts - asked + np.where(log.name == "fit", 0.05, 0.0) * log.volts


BALANCES = (Loop(),)
'''


@pytest.fixture
def a_folder_with_a_balance(tmp_path, monkeypatch) -> Iterator[None]:
    """A file beside the balances of the package."""
    (tmp_path / "loop.py").write_text(LAG)
    monkeypatch.setattr(balances, "__path__", [*balances.__path__, str(tmp_path)])
    balances.library.cache_clear()
    yield
    balances.library.cache_clear()


def test_a_file_in_the_folder_is_a_balance_that_is_traced_and_reported(a_folder_with_a_balance, monkeypatch):
    """It stands in its place of the order, in the violations of a log, in the residuals looked at and in the report's captions."""
    monkeypatch.setattr(rules, "NULL_SEEDS", 2)
    machine = load_machine(DATA / "bench_none")
    log = readers.read_log(readers.log_files(DATA / "bench_none", "fit")).head(4.0)
    problem = SimulatedProblem(logs=(replace(log, name="fit"),), noise=channels.noise_of(machine, [log]))
    names = [balance.name for balance in balances.library()]
    assert names.index("sensor") < names.index("loop") < names.index("supply")
    lines = violated.violations(machine, machine, problem)
    [line] = [line for line in lines if line.name == "loop"]
    assert (line.where, line.unit) == ("leg 1", "V")
    assert np.isfinite(line.violation)
    assert balances.caption_of("loop") == "volts = gain times error"
    [rest] = unexplained_residuals([line], problem)
    assert rest.balance == "loop"
    assert set(rest.dependence.table) >= {"valve_V", "position_m"}


def test_without_the_file_there_is_no_such_balance():
    """The balances of the package, in the order of tracing; valve is a name of continuity."""
    assert [balance.name for balance in balances.library()] == [
        "controller", "sensor", "sensor", "supply", "continuity", "continuity of the rod side", "force", "force", "platform",
    ]  # fmt: skip
    assert balances.family("valve") == "continuity"
    assert all(balance.caption for balance in balances.library())


def test_a_valve_delay_of_a_broken_sample_is_one():
    """Volts that rise by 1 a sample, 2.4 samples late: 2.4 lower everywhere behind the start."""
    late = leg.valve_volts(np.arange(20.0), 0.0, 2.4)
    assert late[3:] == pytest.approx(np.arange(20.0)[3:] - 2.4)
    assert np.all(late[:3] == [0.0, 0.0, 0.0])


def test_what_a_log_keeps_of_machines_asked_before_changes_no_residual(tmp_path):
    """After ten machines that differ in one leg's leak, its supply reading and its IMU, each balance is as on a log that is new."""
    write_machine(tmp_path, 3, {}, "hexapod", runs=("fit",), duration_s=1.0)
    machine, log = load_machine(tmp_path), readers.read_log(readers.log_files(tmp_path, "fit"))
    asked = [
        parameters.with_settings(
            machine, {}, [(candidate, candidate.start() | {candidate.effect.parameters[0].name: size})]
        )
        for candidate, size in (
            *((parameters.named("leakage_supply_to_chamber", f"leg {k}"), 1e-12) for k in range(1, 7)),
            (parameters.named("supply_pressure_gain"), 0.02),
            (parameters.named("pressure_gain", "leg 2"), 0.02),
            (parameters.named("accelerometer_gain"), 0.02),
            (parameters.named("imu_orientation"), 0.02),
        )
    ]
    used = [balance for balance in balances.library() if balance.wants(log, machine)]
    for one in (machine, *asked, machine):
        for balance in used:
            assert np.array_equal(balance.residual(log, one), balance.residual(replace(log), one)), balance.name


@pytest.mark.parametrize("kind", ["bench", "hexapod"])
def test_a_balance_at_some_samples_is_the_one_of_all(tmp_path, kind):
    """What fits ask for, every 20th sample, is what the whole residual has there, to rounding of what it is a difference of."""
    write_machine(tmp_path, 3, {}, kind, runs=("fit",), duration_s=1.0)
    machine, log = load_machine(tmp_path), readers.read_log(readers.log_files(tmp_path, "fit"))
    at = slice(300, log.n - 60, 20)
    used = [balance for balance in balances.library() if balance.wants(log, machine)]
    assert {"supply", "continuity", "sensor", "force"} <= {balance.name for balance in used}
    for balance in [*used, *([continuity.FastContinuity()] if kind == "bench" else [])]:
        whole, some = balance.residual(log, machine), balance.residual_at(log, machine, at)
        assert some == pytest.approx(whole[:, at], rel=0.0, abs=1e-9 * np.max(np.abs(whole)))
