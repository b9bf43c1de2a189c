"""Scenarios are data: what is asked of the machine, and for how long. TOML files of this folder, or the user's own."""

from hexsim.scenarios.scenario import (
    Scenario,
    available_scenarios,
    load_scenario,
    replay_scenario,
    scenario_from_dict,
)

__all__ = ["Scenario", "available_scenarios", "load_scenario", "replay_scenario", "scenario_from_dict"]
