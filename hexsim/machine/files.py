"""Machine files: find, read, check and write `machine.toml`."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from hexsim.declaration import Machine
from hexsim.declaration.oil_grades import GRADES, declared_of
from hexsim.errors import HexsimError, one_of, refuse_missing_file, shortened
from hexsim.files.atomic import write_text
from hexsim.files.toml_files import read_toml, set_dotted, validation_sentence
from hexsim.hydraulics.effects import check_effects
from hexsim.signals.table import check_extra_sensors

FILE_NAME = "machine.toml"
OF_A_RUN = "config.toml"  # its table [machine]


def models_folder() -> Path:
    """The folder of machines: inside the installed package, or beside it in the repository."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "models", package.parent / "models"):
        if folder.is_dir():
            return folder
    raise HexsimError(f"the machine folder `models` is missing beside {package}: install hexsim again")


def available_machines() -> list[str]:
    """Names of the machines that travel with hexsim."""
    return sorted(path.parent.name for path in models_folder().glob(f"*/{FILE_NAME}"))


def find_machine_file(name_or_path: str | Path) -> Path:
    """A name of the list, a folder with `machine.toml`, a TOML file, a run's folder, or a variant: bench/power_unit."""
    path = Path(name_or_path)
    packaged = models_folder() / (Path(*path.parts[1:]) if path.parts[:1] == ("models",) else path)
    for candidate in (
        path if path.suffix == ".toml" else path / FILE_NAME,
        packaged if path.suffix == ".toml" else packaged / FILE_NAME,
        Path(f"{packaged}.toml"),
        path / OF_A_RUN,
    ):
        if os.path.isfile(candidate):  # unlike Path's, false for a name that no file can have
            return candidate
    if os.path.isdir(path):
        raise HexsimError(f"folder {path} has no {FILE_NAME}: put the machine's declaration there")
    if path.suffix or not set(path.parts[:1]) & {*available_machines(), "models"}:  # else a variant of one of them
        refuse_missing_file("machine", str(name_or_path))
    raise HexsimError(
        f"unknown machine {shortened(repr(str(name_or_path)))}: {one_of(str(name_or_path), available_machines())}, "
        f"a folder with {FILE_NAME}, or a TOML file"
    )


def load_machine(name_or_path: str | Path) -> Machine:
    """Read and check a machine. Raises HexsimError that names file, table and key."""
    path = find_machine_file(name_or_path)
    tables = read_toml(path)
    return machine_from_dict(tables.get("machine", {}) if path.name == OF_A_RUN else tables, source=str(path))


def machine_from_dict(tables: dict[str, Any], source: str = "machine") -> Machine:
    """Check tables and make a Machine."""

    try:
        machine = Machine.model_validate(tables)
    except ValidationError as error:
        raise HexsimError(f"{source}: {validation_sentence(error, Machine)}") from None
    check_effects(machine, source)
    check_extra_sensors(machine, source)
    return machine


def changed(machine: Machine, changes: dict[str, Any], source: str = "changes") -> Machine:
    """A copy with dotted keys set, {"valve.overlap_m": 20e-6}, validated again."""
    tables = machine.model_dump(exclude_none=True)
    if machine.oil.grade is not None:  # what the grade gave follows it to another temperature
        given = declared_of(GRADES[machine.oil.grade], machine.oil.temperature_degC)
        tables["oil"] = {key: value for key, value in tables["oil"].items() if given.get(key) != value}
    for dotted, value in changes.items():
        set_dotted(tables, dotted, value, source)
    return machine_from_dict(tables, source)


def number_at(machine: Machine, key: str) -> tuple[str, float]:
    """Dotted place and value of the number that `key` of [uncertainty] means: a key, or table and key, supply_pressure_Pa.

    Raises HexsimError where there is none.
    """
    for section, table in machine.model_dump(exclude={"uncertainty", "effects"}, exclude_none=True).items():
        for name, value in table.items() if isinstance(table, dict) else ():
            if key in (name, f"{section}_{name}") and isinstance(value, float):
                return f"{section}.{name}", value
    raise HexsimError(f"[uncertainty] {key} is no number of the machine file: use the key of its table")


def machine_tables(machine: Machine) -> dict[str, Any]:
    """Plain tables for TOML, without empty ones."""
    tables = machine.model_dump(exclude_none=True, mode="json")
    return {name: table for name, table in tables.items() if table not in ({}, [])}


def in_one_line(machine: Machine) -> str:
    """Legs, cylinder, pressure and mass."""
    legs = f"{machine.n_legs} legs" if machine.n_legs > 1 else "one leg"
    cylinder, load = machine.cylinder, machine.load
    mass = load.platform_mass_kg if machine.is_hexapod else load.moving_mass_kg
    return (
        f"{machine.name}: {legs}, {1e3 * cylinder.piston_diameter_m:g}/{1e3 * cylinder.rod_diameter_m:g} mm cylinder with "
        f"{1e3 * cylinder.stroke_m:g} mm stroke, {1e-5 * machine.supply.pressure_Pa:g} bar, {mass:g} kg"
    )


def save_machine(machine: Machine, path: Path, like: str | Path | None = None) -> None:
    """Write `machine.toml` whole or not at all; `path` is the file.

    like: the machine that it was made from, as `load_machine` takes it; its comments and order stay, and what differs is changed. Where
    that file declares the same in another way (a run's config.toml, a data sheet's numbers), all numbers are written.
    """
    text = None if like is None else _text_like(machine, find_machine_file(like))
    write_text(path, text or tomli_w.dumps(machine_tables(machine)))


def _text_like(machine: Machine, path: Path) -> str | None:
    """The text of the file at `path` with this machine's numbers; None where it would not read as this machine."""
    from hexsim.machine.edited import edited  # tomlkit, for who writes a machine

    try:
        declared = machine_tables(load_machine(path))
        text = edited(path.read_text(encoding="utf-8-sig"), declared, machine_tables(machine))
        same = machine_from_dict(tomllib.loads(text), str(path)) == machine
    except (HexsimError, ValueError, OSError):
        return None
    return text if same else None
