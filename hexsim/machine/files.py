"""Machine files: find, read, check and write `machine.toml`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from hexsim.errors import HexsimError
from hexsim.machine.declaration import Machine

FILE_NAME = "machine.toml"


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
    """A name of the list, a folder with `machine.toml`, a TOML file, or a variant: micro_motion_system/power_unit."""
    path = Path(name_or_path)
    packaged = models_folder() / (Path(*path.parts[1:]) if path.parts[:1] == ("models",) else path)
    for candidate in (
        path if path.suffix == ".toml" else path / FILE_NAME,
        packaged if path.suffix == ".toml" else packaged / FILE_NAME,
        packaged.with_name(f"{packaged.name}.toml"),
    ):
        if candidate.is_file():
            return candidate
    if path.is_dir():
        raise HexsimError(f"folder {path} has no {FILE_NAME}: put the machine's declaration there")
    raise HexsimError(
        f"unknown machine {str(name_or_path)!r}: give one of {', '.join(available_machines())}, "
        f"a folder with {FILE_NAME}, or a TOML file"
    )


def load_machine(name_or_path: str | Path) -> Machine:
    """Read and check a machine. Raises HexsimError that names file, table and key."""
    path = find_machine_file(name_or_path)
    return machine_from_dict(read_toml(path), source=str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, or a HexsimError that names the file and line."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise HexsimError(f"{path} is not valid TOML: {error}") from None


def machine_from_dict(tables: dict[str, Any], source: str = "machine") -> Machine:
    """Check tables and make a Machine."""
    from hexsim.hydraulics.effects import check_effects  # effects read the machine's classes

    try:
        machine = Machine.model_validate(tables)
    except ValidationError as error:
        raise HexsimError(f"{source}: {validation_sentence(error, Machine)}") from None
    check_effects(machine, source)
    return machine


def changed(machine: Machine, changes: dict[str, Any], source: str = "changes") -> Machine:
    """A copy with dotted keys set, {"valve.overlap_m": 20e-6}, validated again."""
    tables = machine.model_dump(exclude_none=True)
    for dotted, value in changes.items():
        *path, key = dotted.split(".")
        table = tables
        for part in path:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise HexsimError(f"{source}: {dotted} leads through {part}, which is no table")
        table[key] = value
    return machine_from_dict(tables, source)


def machine_tables(machine: Machine) -> dict[str, Any]:
    """Plain tables for TOML, without empty ones."""
    tables = machine.model_dump(exclude_none=True, mode="json")
    return {name: table for name, table in tables.items() if table != {}}


def save_machine(machine: Machine, path: Path) -> None:
    """Write `machine.toml` whole or not at all; `path` is the file."""
    from hexsim.recording.atomic import write_text  # one way of writing files in the project

    write_text(path, tomli_w.dumps(machine_tables(machine)))


def validation_sentence(error: ValidationError, model: type) -> str:
    """The first problem of a pydantic error as one sentence: table, key, what was given, what is allowed."""
    first = error.errors()[0]
    where = [part for part in first["loc"] if isinstance(part, str)]  # not the place within an array
    given = first.get("input")
    place = f"[{'.'.join(where[:-1])}] {where[-1]}" if len(where) > 1 else where[0] if where else "the file"
    if len(where) == 1 and (isinstance(given, dict) or _keys_at(model, where) != _keys_at(model, [])):
        place = f"[{place}]"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if first["type"] == "missing" and where == list(first["loc"]):
        return f"{place} is missing: add it (SI units){more}"
    if first["type"] == "extra_forbidden":
        what = "table" if place.endswith("]") else "key"
        return f"{place} is not a known {what}: allowed are {', '.join(_keys_at(model, where[:-1]))}{more}"
    text = first["msg"].removeprefix("Value error, ")
    shown = f" = {given!r}" if isinstance(given, (int, float, str, list, tuple)) else ""
    units = " (SI units, as the key says)" if first["type"].startswith(("greater_than", "less_than")) else ""
    return f"{place}{shown}: {text[0].lower() + text[1:]}{units}{more}"


def _keys_at(model: type, path: list[str]) -> list[str]:
    """Field names of the section that `path` leads to."""
    for part in path:
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        model = next((c for c in candidates if hasattr(c, "model_fields")), model)
    return list(model.model_fields)
