"""What a user gives: machines, scenarios and compensators by name, file or object, and settings of single values."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from compensation import Compensator
from hexsim import declaration
from hexsim.errors import HexsimError, shortened
from hexsim.files.run_folder import run_folder
from hexsim.machine import files as machine_files
from hexsim.scenarios import Scenario, scenario
from hexsim.scenarios.settings import apply_settings, loaded


class Machine(declaration.Machine):
    """A declared machine, frozen: `machine.valve.overlap_m` reads a value, `with_` gives a changed copy.

    Made by `hx.load_machine`. All values in SI units; the key says which.

    >>> machine = hx.load_machine("bench")
    >>> machine.with_({"valve.overlap_m": 2e-5}).valve.overlap_m
    2e-05
    """

    def with_(self, changes: Mapping[str, Any]) -> Machine:
        """A copy with values changed by dotted key, {"valve.overlap_m": 2e-5}, checked as a whole again.

        Raises HexsimError for an unknown key or a value that is not allowed.
        """
        return faced(machine_files.changed(self, settings_of(changes, "with_"), "with_"))

    def to_folder(self, path: str | Path) -> Path:
        """Write machine.toml into a folder, which `hx.load_machine` and `hexsim run --machine` read; the folder."""
        with run_folder(Path(path)) as folder:
            machine_files.save_machine(self, folder.path / machine_files.FILE_NAME)
            return folder.finish()

    def __repr__(self) -> str:
        return f"<Machine {machine_files.in_one_line(self)}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        return escape(machine_files.in_one_line(self))


def faced(machine: declaration.Machine) -> Machine:
    """The same machine, whose values are checked already, with the methods of the face."""
    if isinstance(machine, Machine):
        return machine
    values = {name: getattr(machine, name) for name in type(machine).model_fields}
    return Machine.model_construct(_fields_set=machine.model_fields_set, **values)


def load_machine(machine: str | Path | declaration.Machine) -> Machine:
    """A machine by name, from a folder with machine.toml, from a TOML file, or of a run's folder.

    `hx.available()["machines"]` has the names. Raises HexsimError: for an unknown name with those most like it; for a
    value that is not allowed with file, table and key.

    >>> hx.load_machine("bench")
    <Machine bench: one leg, 40/30 mm cylinder with 200 mm stroke, 70 bar, 40 kg>
    """
    if isinstance(machine, declaration.Machine):
        return faced(machine)
    return faced(machine_files.load_machine(path_of(machine, "a machine", "bench")))


def load_scenario(
    scenario: str | Path | Scenario,
    *,
    amplitude: float | None = None,
    frequency_Hz: float | None = None,
    duration_s: float | None = None,
    allow_native: bool = False,
) -> Scenario:
    """A scenario by name, from a TOML file, or from a CSV or Parquet file of setpoints.

    amplitude: of the driven axes [m], of rotations in degrees. allow_native: foreign FMUs that it names may run.
    `hx.available()["scenarios"]` has the names. Raises HexsimError for an unknown name or a value that is not allowed.

    >>> hx.load_scenario("heave", duration_s=8.0).duration_s
    8.0
    """
    changes = {"amplitude": amplitude, "frequency_Hz": frequency_Hz, "duration_s": duration_s}
    for name, value in changes.items():
        if value is not None and not is_number(value):
            raise HexsimError(f"{name} is {shown(value)}: give a number")
    if isinstance(scenario, Scenario):
        if any(value is not None for value in changes.values()):
            raise HexsimError(
                "a scenario that is made already is changed by set: give set={'scenario.duration_s': 8.0}"
            )
        return scenario
    return scenario_files(path_of(scenario, "a scenario", "heave"), allow_native=allow_native, **changes)


scenario_files = scenario.load_scenario


def available() -> dict[str, list[str]]:
    """Names of the machines, scenarios and compensators that hexsim brings, and that installed packages add.

    >>> sorted(hx.available())
    ['compensators', 'machines', 'scenarios']
    """
    import compensation

    return {
        "machines": machine_files.available_machines(),
        "scenarios": scenario.available_scenarios(),
        "compensators": compensation.available(),
    }


def prepared(
    scenario: Any, machine: Any, settings: Any, allow_native: bool = False
) -> tuple[declaration.Machine, Scenario]:
    """Machine and scenario with the settings; the machine of the scenario where none is given."""
    what = load_scenario(scenario, allow_native=allow_native)
    with_machine = load_machine(what.machine_name if machine is None else machine)
    with_machine, what = loaded(with_machine, what)
    what, with_machine = apply_settings(
        what, with_machine, settings_of(settings or {}, "set"), "set", allow_native=allow_native
    )
    return with_machine, what


def settings_of(settings: Any, source: str) -> dict[str, Any]:
    """Dotted key -> value, numbers of numpy as Python's."""
    if not isinstance(settings, Mapping) or not all(isinstance(key, str) for key in settings):
        raise HexsimError(f"{source} is {shown(settings)}: give a mapping such as {{'valve.overlap_m': 2e-5}}")
    return {key: plain_value(value) for key, value in settings.items()}


def plain_value(value: Any) -> Any:
    """Numbers and arrays of numpy as Python's, paths as text."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, os.PathLike) else value


def path_of(given: Any, what: str, example: str) -> str | Path:
    """A name or path as it is; HexsimError for anything else."""
    if not isinstance(given, str | Path):
        raise HexsimError(
            f"{what} is {shown(given)}: give a name, such as {example!r}, a path, or an object of hexsim's"
        )
    return given


def compensator_of(given: Any) -> str | Compensator:
    """A name, or an object that is a compensator."""
    if not isinstance(given, str | Compensator):
        raise HexsimError(
            f"a compensator is {shown(given)}: give a name, such as 'adaptive', package.module:Class, or an object "
            "derived from compensation.Compensator"
        )
    return given


def names_in(given: Any, what: str) -> list[str]:
    """One name or path, or several."""
    names = [given] if isinstance(given, str | Path) else given
    found = list(names) if isinstance(names, Iterable) else []
    if not found or not all(isinstance(name, str | Path) for name in found):
        raise HexsimError(f"{what} is {shown(given)}: give a name or path, or a list of them")
    return [str(name) for name in found]


def check_run_options(seed: Any, timestep: Any = None) -> None:
    """Refuse a seed that is none, and a time step out of range."""
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise HexsimError(f"seed is {shown(seed)}: give a whole number from 0 on")
    low, high = 1e-6, 1e-3  # [s] that a run may keep constant
    if timestep is not None and not (is_number(timestep) and low <= timestep <= high):
        raise HexsimError(f"timestep is {shown(timestep)}: give {low:g} to {high:g} s, or None to have it chosen")


def is_number(value: Any) -> bool:
    """A number of Python's or numpy's, and no truth value."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def shown(value: Any) -> str:
    """A value for a sentence."""
    if isinstance(value, Sequence | int | float | None):
        return shortened(repr(value))
    return f"a {type(value).__name__}"
