"""Settings by dotted key: `valve.overlap_m` changes the machine, `scenario.fade_s` the scenario."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hexsim.errors import HexsimError
from hexsim.files.toml_files import set_dotted
from hexsim.machine import Machine, load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import Scenario, load_scenario, scenario_from_dict

SCENARIO = "scenario."


def loaded(machine: Machine | str | Path, scenario: Scenario | str | Path) -> tuple[Machine, Scenario]:
    """Both, by name or file where they are not made yet. Raises HexsimError for anything else."""
    if isinstance(machine, str | Path):
        machine = load_machine(machine)
    if isinstance(scenario, str | Path):
        scenario = load_scenario(scenario)
    for given, kind, example in ((machine, Machine, "bench"), (scenario, Scenario, "heave")):
        if not isinstance(given, kind):
            raise HexsimError(
                f"a {type(given).__name__} stands where a {kind.__name__} is needed: give one, its name, as {example!r}, or a file"
            )
    return machine, scenario


def machine_in(scenario: Scenario, machine: Machine) -> Machine:
    """The machine with what the scenario changes in it."""
    if not scenario.machine_changes:
        return machine
    return changed(machine, dict(scenario.machine_changes), f"scenario {scenario.name}")


def scenario_and_machine(
    scenario_name: str,
    machine_name: str | None = None,
    *,
    amplitude: float | None = None,
    frequency_Hz: float | None = None,
    duration_s: float | None = None,
    allow_native: bool = False,
) -> tuple[Scenario, Machine]:
    """A scenario with its changes, and the machine named, else the scenario's own."""
    scenario = load_scenario(
        scenario_name, amplitude=amplitude, frequency_Hz=frequency_Hz, duration_s=duration_s, allow_native=allow_native
    )
    return scenario, load_machine(machine_name or scenario.machine_name)


def apply_settings(
    scenario: Scenario,
    machine: Machine,
    settings: Mapping[str, Any],
    source: str = "settings",
    *,
    allow_native: bool = False,
) -> tuple[Scenario, Machine]:
    """Both with the settings applied and checked; a setting goes before what the scenario changes in the machine."""
    asked = {key.removeprefix(SCENARIO): value for key, value in settings.items() if key.startswith(SCENARIO)}
    if asked:
        tables = scenario.to_dict()
        for key, value in asked.items():
            set_dotted(tables, key, value, source)
        scenario = scenario_from_dict(tables, source, allow_native=allow_native or scenario.allow_native)
    changes = {key: value for key, value in settings.items() if not key.startswith(SCENARIO)}
    for key, value in changes.items():
        if "." not in key and not isinstance(value, Mapping):  # a whole table has no dot
            raise HexsimError(f"{source}: {key} names no table: give table.key, for example valve.overlap_m")
    if changes:
        machine = changed(machine, changes, source)
        kept = {key: value for key, value in scenario.machine_changes.items() if key not in changes}
        if len(kept) < len(scenario.machine_changes):
            tables = {**scenario.to_dict(), "machine": kept}
            scenario = scenario_from_dict(tables, source, allow_native=allow_native or scenario.allow_native)
    return scenario, machine
