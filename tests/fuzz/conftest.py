"""The first run of each kind compiles the hydraulics; the time limit of an example is for the others."""

import pytest

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import simulate


@pytest.fixture(scope="session", autouse=True)
def compiled():
    for name in ("bench", "micro_motion_system/power_unit"):
        simulate(load_machine(name), load_scenario("heave", duration_s=0.1), fast=True)
    fault = load_scenario("heave", duration_s=0.1).to_dict() | {"faults": [{"kind": "pump_trip", "time_s": 0.05}]}
    simulate(load_machine("micro_motion_system"), scenario_from_dict(fault), fast=True)
