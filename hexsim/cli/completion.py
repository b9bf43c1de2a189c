"""Names that the Tab key offers: machines, scenarios, compensators, effects. Read from the files, nothing is imported."""

from __future__ import annotations

import ast
import importlib.util
import tomllib
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


def machines(incomplete: str) -> list[str]:
    """Machines that travel with hexsim, as `hexsim list machines` has them."""
    folders = (PACKAGE / "models", PACKAGE.parent / "models")
    there = next((folder for folder in folders if folder.is_dir()), None)
    return begun(incomplete, [path.parent.name for path in there.glob("*/machine.toml")] if there else [])


def scenarios(incomplete: str) -> list[str]:
    """Scenarios that travel with hexsim."""
    return begun(incomplete, [path.stem for path in (PACKAGE / "scenarios").glob("*.toml")])


def effects(incomplete: str) -> list[str]:
    """The library of effects, by its table of advice, and those of other packages."""
    advice = PACKAGE / "hydraulics" / "effects" / "advice.toml"
    announced = [point.name for point in entry_points(group="hexsim.effects")]
    return begun(incomplete, [*tomllib.loads(advice.read_text(encoding="utf-8")), *announced])


def compensators(incomplete: str) -> list[str]:
    """Algorithms of `compensation` with their variants, and those of other packages."""
    found = importlib.util.find_spec("compensation")
    folders = (found.submodule_search_locations if found else None) or []
    names = [name for folder in folders for path in Path(folder).rglob("*.py") for name in named_in(path)]
    return begun(incomplete, names + [point.name for point in entry_points(group="hexsim.compensators")])


def several(one: Callable[[str], list[str]]) -> Callable[[str], list[str]]:
    """Of names separated by commas, the last."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in one(last) if name not in before.split(",")]

    return complete


def begun(incomplete: str, names: list[str]) -> list[str]:
    """The names that begin so."""
    return sorted(name for name in set(names) if name.startswith(incomplete))


def named_in(path: Path) -> list[str]:
    """Names of the algorithms in a module: `name` and the keys of `variants` in the bodies of its classes."""
    names: list[str] = []
    for kind in (node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.ClassDef)):
        for line in (line for line in kind.body if isinstance(line, ast.AnnAssign)):
            target = line.target.id if isinstance(line.target, ast.Name) else ""
            if target == "name" and isinstance(line.value, ast.Constant) and line.value.value:
                names.append(str(line.value.value))
            elif target == "variants" and isinstance(line.value, ast.Dict):
                names += [str(key.value) for key in line.value.keys if isinstance(key, ast.Constant)]
    return names
