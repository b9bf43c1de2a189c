"""All legs of a machine in one compiled call: what each leg by itself gives, and nothing that a derived algorithm does is passed over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import compensation.guard
from compensation import Compensator, Context, Sample, guard, legs
from compensation.adaptive import Adaptive
from hexsim import load_scenario
from hexsim.simulation import simulate

LOST = {"kind": "position_sensor", "leg": 1, "time_s": 5.5}


def short(seconds: float):
    return replace(load_scenario("heave"), duration_s=seconds)


def test_legs_together_are_legs_one_by_one(hexapod, monkeypatch):
    """Six seconds of six legs that are compensated, at last without a position sensor: every column of the log and what was learned are
    equal to the bit."""
    scenario = replace(short(6.0), faults=(LOST,))
    together = simulate(hexapod, scenario, compensator="adaptive", fast=True)
    monkeypatch.setattr(compensation.guard, "stepper", legs.OneByOne)
    apart = simulate(hexapod, scenario, compensator="adaptive", fast=True)
    assert together.log.equals(apart.log)
    assert together.compensator_parameters == apart.compensator_parameters
    assert together.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy().any(axis=0).all()


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


@dataclass(frozen=True, kw_only=True)
class Stepping(Adaptive):
    def step(self, state, sample):
        return 0.01, super().step(state, sample)[1]


def test_what_a_derived_algorithm_does_is_done(hexapod):
    """A step of its own adds 10 mV to every leg."""
    run = simulate(hexapod, short(0.5), compensator=guard.Guarded(Stepping(name="derived")), fast=True)
    added = run.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy()
    assert np.allclose(added[100:], 0.01)
