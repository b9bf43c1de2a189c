"""All legs of a machine in one compiled call: what each leg by itself gives, and nothing that a derived algorithm does is passed over."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import pytest

import compensation
from compensation import Compensator, Context, Sample, guard, legs, started
from compensation.adaptive import Adaptive
from hexsim import load_scenario, smoothness
from hexsim.machine import load_machine
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.simulation import simulate

RUNG_V = 1e-9  # what rounding may make of volts in six seconds; a count of a transducer moves them by 1e-4
ROUNDING = 1e-6  # what it may make of what is learned, in standard errors and shares; 4e-8 is seen
LOST = {"kind": "position_sensor", "leg": 1, "time_s": 1.8}


def short(seconds: float):
    return replace(load_scenario("heave"), duration_s=seconds)


class Watching:
    """An intervention that changes nothing: with it every tick is Python's."""

    def before_step(self, time_s, plant, volts):
        return volts


@pytest.fixture(scope="module")
def python_ticks():
    """What a machine does in heave with Python at every control tick, made once for a machine, an algorithm and a time."""
    runs = {}

    def of(machine: str, name: str, seconds: float):
        key = machine, name, seconds
        if key not in runs:
            runs[key] = simulate(
                load_machine(machine), short(seconds), compensator=name, fast=True, interventions=[Watching()]
            )
        return runs[key]

    return of


def test_legs_together_are_legs_one_by_one(hexapod, monkeypatch, tmp_path, python_ticks):
    """Two seconds of six legs that start with what six seconds have taught them, at last without a position sensor: every column of the
    log and what was learned are equal to the bit."""
    learned = tmp_path / "compensator.json"
    taught = python_ticks("micro_motion_system", "adaptive", 6.0).compensator_parameters
    learned.write_text(json.dumps({"compensator": "adaptive", "legs": taught}))
    restart = replace(short(2.0), faults=(LOST,))
    together = simulate(hexapod, restart, compensator=str(learned), fast=True)
    monkeypatch.setattr(guard, "stepper", legs.OneByOne)
    apart = simulate(hexapod, restart, compensator=str(learned), fast=True)
    assert together.log.equals(apart.log)
    assert together.compensator_parameters == apart.compensator_parameters != taught
    assert together.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy().any(axis=0).all()


def bump(run) -> float:
    """Largest heave acceleration [m/s2] in 50 Hz about its mean over 0.1 s, from 4.6 s to 5.8 s."""
    t, a = (run.log[name].to_numpy() for name in ("time_s", "true_acceleration_z_m_s2"))
    a = smoothness.band_limit(t, a)
    return float(np.abs(a - np.convolve(a, np.ones(101) / 101, "same"))[(t > 4.6) & (t < 5.8)].max())


def test_legs_of_a_platform_engage_together_and_leave_a_third(hexapod, python_ticks):
    """From nothing, in heave: six legs begin within a tenth of a second, and at the next reversal at most a third of plain control's
    bump is left."""
    run = python_ticks("micro_motion_system", "adaptive", 6.0)
    volts = run.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    assert volts[-1].all() and np.ptp((volts != 0.0).argmax(axis=0)) < 100
    assert bump(run) < bump(simulate(hexapod, short(6.0), compensator="none", fast=True)) / 3.0


@pytest.mark.slow  # two seconds of it are above
def test_legs_that_learn_together_are_legs_one_by_one(hexapod, monkeypatch, python_ticks):
    """Six seconds of six legs from nothing: the same."""
    together = python_ticks("micro_motion_system", "adaptive", 6.0)
    monkeypatch.setattr(guard, "stepper", legs.OneByOne)
    apart = simulate(hexapod, short(6.0), compensator="adaptive", fast=True, interventions=[Watching()])
    assert together.log.equals(apart.log)
    assert together.compensator_parameters == apart.compensator_parameters
    assert together.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy().any(axis=0).all()


@pytest.mark.parametrize(
    ("legs", "name", "seconds"),
    [
        ("bench", "exact", 4.0),
        ("bench", "iterative", 4.0),
        ("bench", "repetitive", 12.0),  # a period is learned
        pytest.param("micro_motion_system", "buffered_two_sided", 4.0, marks=pytest.mark.slow),
        ("micro_motion_system", "adaptive", 6.0),
        ("servo_hexapod", "exact", 4.0),
    ],
)
def test_compiled_control_ticks_are_python_s(python_ticks, monkeypatch, legs, name, seconds):
    """Compensated without Python, and again with Python at every tick: the volts and what was learned are equal to rounding, on one leg,
    on six, and on six with a chamber on either side."""
    with_python = python_ticks(legs, name, seconds)
    monkeypatch.setattr(PositionLoop, "tick", None)
    without = simulate(load_machine(legs), short(seconds), compensator=name, fast=True)
    volts = [one.log.select(pl.col("^compensation(_\\d)?_V$")).to_numpy() for one in (without, with_python)]
    assert np.abs(volts[0]).max(axis=0).min() > 0.0
    assert np.abs(volts[0] - volts[1]).max() < RUNG_V
    assert without.summary["compensation"] == with_python.summary["compensation"]
    for ours, theirs in zip(with_python.compensator_parameters, without.compensator_parameters, strict=True):
        assert in_units_of_errors(theirs, ours) == pytest.approx(
            in_units_of_errors(ours, ours), rel=ROUNDING, abs=ROUNDING
        )


def in_units_of_errors(learned: dict, of: dict) -> np.ndarray:
    """All numbers; of a fit those of its leg over the standard errors of another one, its standard errors over those, and correlations:
    an element of the factor of its information may be rounding alone beside the others of its row."""
    if "factor" not in learned:
        return np.array(flat(learned))
    spread = np.sqrt(np.diag(covariance(of)))
    numbers, scale = (np.array(list(learned[part].values())) for part in ("numbers", "scale"))
    fit = covariance(learned) / np.outer(spread, spread)
    rest = {key: value for key, value in learned.items() if key not in ("numbers", "scale", "factor")}
    return np.concatenate([numbers / (np.array(list(of["scale"].values())) * spread), scale, fit.ravel(), flat(rest)])


def covariance(learned: dict) -> np.ndarray:
    """Of the leg's numbers, in units of their scales."""
    factor = np.zeros((len(learned["numbers"]),) * 2)
    factor[np.tril_indices(len(factor))] = learned["factor"]
    return np.linalg.inv(factor @ factor.T)


def flat(tables) -> list[float]:
    """All numbers within tables and lists."""
    if isinstance(tables, dict | list):
        return [x for part in (tables.values() if isinstance(tables, dict) else tables) for x in flat(part)]
    return [tables] if isinstance(tables, int | float) else []


def test_a_fault_of_a_guard_is_followed(hexapod):
    """An algorithm that turns not finite in a compiled run is held off, starts anew after half a second, fails again; the run says so."""
    run = simulate(hexapod, short(0.8), compensator=guard.Guarded(Failing()), fast=True)
    said = [text for _, _, text in run.messages]
    assert sum("not finite" in text for text in said) == 12 and sum("normal again" in text for text in said) == 6
    assert all("not finite" in leg["reason"] for leg in run.summary["compensation"])


class Failing(type(compensation.create_built_in("exact").inner)):
    """Its means overflow at the first noise."""

    def new_row(self, context):
        return np.full_like(super().new_row(context), 1e308)


@dataclass(frozen=True)
class Counting(Compensator):
    """Gives a new state at each step, as the protocol allows."""

    name: str = "counting"

    def start(self, context: Context) -> int:
        return 0

    def step(self, state: int, sample: Sample) -> tuple[float, int]:
        return 0.0, state + 1

    def parameters(self, state: int) -> dict:
        return {"steps": state}

    def restore(self, context: Context, parameters: dict) -> int:
        return int(parameters["steps"])


def test_a_new_state_at_each_step_is_kept(hexapod):
    """Half a second at 500 Hz: each leg's state has counted the ticks."""
    run = simulate(hexapod, short(0.5), compensator=guard.Guarded(Counting()), fast=True)
    counted = [leg["steps"] for leg in run.compensator_parameters]
    assert len(set(counted)) == 1 and abs(counted[0] - 250) <= 1


def test_legs_with_start_parameters_of_their_own_are_stepped_together(hexapod):
    """Six legs of one algorithm are one call, each with other start parameters or none; of two algorithms they are not."""
    one, other = compensation.create("adaptive"), compensation.create("exact")
    contexts = [compensator_context(hexapod, None, leg) for leg in range(1, 7)]
    legs_of = {
        "alike": [started.Started(one, one.parameters(one.start(context))) for context in contexts],
        "one without": [
            one,
            *(started.Started(compensation.create("adaptive"), one.parameters(one.start(contexts[0]))),) * 5,
        ],
        "unlike": [*[one] * 5, other],
    }
    found = {
        what: guard.step_together(made, [c.start(x) for c, x in zip(made, contexts, strict=True)]) is not None
        for what, made in legs_of.items()
    }
    assert found == {"alike": True, "one without": True, "unlike": False}


@dataclass(frozen=True, kw_only=True)
class Stepping(Adaptive):
    def step(self, state, sample):
        return 0.01, super().step(state, sample)[1]


def test_what_a_derived_algorithm_does_is_done(hexapod):
    """A step of its own adds 10 mV to every leg."""
    run = simulate(hexapod, short(0.5), compensator=guard.Guarded(Stepping(name="derived")), fast=True)
    added = run.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    assert np.allclose(added[100:], 0.01)
