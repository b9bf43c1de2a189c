"""The next measurement: motions inside the machine's limits, information that adds up, hypotheses that stay apart."""

import dataclasses
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.motion_computer.limits import leg_limits
from hexsim.readers import read_log
from hexsim.scenarios.scenario import scenario_from_dict
from hexsim.signals.channels import noise_of
from hexsim.tracing.design import next_measurement
from hexsim.tracing.design.information import Hypothesis, hypothesis, promise, shrunk
from hexsim.tracing.design.motions import KINDS, STEP_SHARE, MotionFamily
from hexsim.tracing.design.next_measurement import surviving
from hexsim.tracing.fitting.fit import refine, start_fit
from hexsim.tracing.fitting.parameters import named, priors
from hexsim.tracing.fitting.selection import with_candidate
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps.experiments import setpoint_log

DATA = Path(__file__).parents[1] / "data"
LEAK = 2.5e-12


@pytest.fixture(scope="module")
def bench():
    machine = load_machine(DATA / "bench_leakage")
    log = read_log(DATA / "bench_leakage" / "validate.csv.gz").head(5.0)
    return machine, log, SimulatedProblem(logs=(log,), noise=noise_of(machine, [log]))


@pytest.fixture(scope="module")
def leaking(bench):
    """The declared bench with its leak, refitted to 5 s."""
    machine, _, problem = bench
    leak = named("leakage_supply_to_chamber")
    start = with_candidate(start_fit(machine, priors(machine), problem), leak, 0.5, problem)
    return refine(start, problem, steps=6)


@pytest.mark.parametrize("name", ["bench", "micro_motion_system"])
def test_every_motion_stays_inside_the_limits(name):
    """Legs stay clear of the cushions, below 0.3 m/s and 3 m/s2; a step stays below its share of the stroke."""
    machine = load_machine(name)
    family, limits = MotionFamily(machine, 20.0), leg_limits(machine)
    low, high = np.transpose(family.bounds)
    made = set()
    for point in np.random.default_rng(3).uniform(low, high, (30, len(low))):
        tables = family.scenario(point)
        if tables is None:
            continue
        kind = next(iter(tables["axes"].values()))["kind"]
        made.add(kind)
        scenario_from_dict(tables)
        legs = setpoint_log(machine, tables, 500.0).setpoint
        excursion = np.abs(legs - 0.5 * machine.cylinder.stroke_m).max()
        if kind == "block":
            assert excursion <= STEP_SHARE * machine.cylinder.stroke_m
            continue
        assert excursion <= limits.excursion[0]
        assert np.abs(np.diff(legs)).max() * 500.0 <= 1.01 * limits.velocity[0]  # differences of samples
        assert np.abs(np.diff(legs, 2)).max() * 500.0**2 <= 1.05 * limits.acceleration[0]
    assert made == set(KINDS)


def test_a_hypothesis_is_not_apart_from_itself(bench, leaking):
    """The separation of two equal machines is nothing."""
    _, log, problem = bench
    one = hypothesis("one", leaking, problem)
    found = promise([one, dataclasses.replace(one, label="other")], log, problem.noise)
    assert found.separations["one", "other"] == pytest.approx(0.0, abs=1e-6)


def test_what_a_declared_parameter_takes_up_separates_nothing(bench, leaking):
    """A machine whose discharge coefficient is 0.05 % off is apart by chi2 in the hundreds of the plain difference, and by
    less than a hundredth of it where that parameter is free."""
    _, log, problem = bench
    place = [prior.key for prior in leaking.priors].index("discharge_coefficient")
    off = leaking.deviations.copy()
    off[place] += 5e-4 * np.sign(-off[place])
    moved = dataclasses.replace(leaking, deviations=off)
    pair = [hypothesis("one", leaking, problem), hypothesis("other", moved, problem)]
    unknown = [dataclasses.replace(one, known=1e-6 * one.known) for one in pair]
    known = [dataclasses.replace(one, known=1e9 * one.known) for one in pair]
    plain = promise(known, log, problem.noise).separations["one", "other"]
    assert plain > 100
    assert promise(unknown, log, problem.noise).separations["one", "other"] < 0.01 * plain


def test_the_same_run_again_halves_the_variance(bench, leaking):
    """A is X X' of the run and a prior that weighs little: the run once more makes the leak's error smaller by the root of 2."""
    _, log, problem = bench
    calm = [hypothesis("leak", leaking, problem)]
    found = promise(calm, dataclasses.replace(log, position=log.setpoint), problem.noise)
    assert found.errors[0] == pytest.approx(calm[0].numbers[0].standard_error / np.sqrt(2.0), rel=0.03)


def test_small_realities_are_not_asked_for(bench, leaking):
    """Of a machine with a leak and a small delay beside it the leak alone is to be sharpened, at its own coordinate."""
    _, _, problem = bench
    beside = dataclasses.replace(with_candidate(leaking, named("position_delay"), 0.1, problem), covariance=None)
    beside = dataclasses.replace(beside, candidates=beside.candidates[::-1], values=beside.values[::-1])
    k = len(beside.priors)
    asked = Hypothesis(label="", fit=beside, known=np.eye(k + 2), named=frozenset({"leakage_supply_to_chamber"}))
    assert [(number.effect, number.place) for number in asked.numbers] == [("leakage_supply_to_chamber", k + 1)]


def test_a_tie_is_answered_by_a_scenario_file(bench, leaking):
    """For two hypotheses the file says which it separates and how far, and `hexsim run` can read it."""
    machine, _, problem = bench
    base = refine(start_fit(machine, leaking.priors, problem), problem, steps=3)
    rival = refine(with_candidate(base, named("dead_volume"), 0.3, problem), problem, steps=3)
    trace = SimpleNamespace(
        machine=machine, fit_problem=problem, final=leaking, ties=[{"dead_volume": rival}], verdict="explained",
        effects=[], unexplained=[], search=SimpleNamespace(stages=[]),
    )  # fmt: skip
    found = next_measurement(trace, duration_s=5.0, first=8, rounds=0)
    text = found.text()
    assert text.startswith("# to separate leakage_supply_to_chamber, dead_volume")
    assert found.promise.separations["leakage_supply_to_chamber", "dead_volume"] > 100
    assert scenario_from_dict(tomllib.loads(text)).duration_s == 5.0
    assert found.numbers[0].value == pytest.approx(LEAK, rel=0.05)


def test_an_error_that_ends_at_a_bound_is_not_made_small_by_it(leaking):
    """A leak known to +-1e6 coordinates is reported to its bound; a thousandth of that is still beyond the bound, and is
    promised as such."""
    loose = dataclasses.replace(leaking, covariance=1e12 * np.eye(len(leaking.priors) + 1))
    one = Hypothesis(label="", fit=loose, known=np.eye(len(leaking.priors) + 1))
    share = np.full(len(leaking.priors) + 1, 1e-3)
    assert shrunk(one, share)[0] == pytest.approx(one.numbers[0].standard_error)
    calm = dataclasses.replace(one, fit=leaking)
    assert shrunk(calm, share)[0] == pytest.approx(1e-3 * calm.numbers[0].standard_error)


def test_a_tie_of_a_partly_explained_machine_is_asked_about(bench, leaking):
    """The balances tie the leak with a leak to tank: its hypothesis stands in the leak's place, refitted, and is no better."""
    machine, _, problem = bench
    effect = SimpleNamespace(candidate=leaking.candidates[0], tied_with=("leakage_chamber_to_tank",))
    trace = SimpleNamespace(
        machine=machine, fit_problem=problem, final=leaking, ties=[{}], verdict="partly", effects=[effect],
        candidates=[named("leakage_supply_to_chamber"), named("leakage_chamber_to_tank")],
    )  # fmt: skip
    (first, own), (second, rival) = surviving(trace)
    assert (first, second) == ("leakage_supply_to_chamber", "leakage_chamber_to_tank")
    assert [candidate.label for candidate in rival.candidates] == ["leakage_chamber_to_tank"]
    assert own is leaking
    assert np.isfinite(rival.chi2)
    assert rival.chi2 > own.chi2
