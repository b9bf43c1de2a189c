"""What decides a run beside its declared values: the bytes of hexsim, of the files that a scenario names and of foreign code.

A compensator's code is its module, all of its package, and the other modules of the user's that these import. Files that
its code reads by itself are not seen.
"""

from __future__ import annotations

import ast
import hashlib
import os
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import compensation
import hexsim
from hexsim.errors import HexsimError

CODE = (".py", ".so", ".pyd", ".dll", ".dylib")
GROUPS = ("hexsim.effects", "hexsim.sensors", "hexsim.readers", "hexsim.compensators")


def inputs_digest(scenario: Mapping[str, Any], settings: Mapping[str, Any], compensator: str) -> str:
    """Digest of the bytes that decide a run of these scenario tables and settings with this compensator.

    Raises HexsimError for a file that cannot be read.
    """
    digest = hashlib.sha256(_hexsim_digest().encode())
    named = sorted(set(_paths_in(scenario.get("axes", {})) + _paths_in(settings)))
    if os.path.isfile(compensator):  # start parameters, or an exported library
        named.append(compensator)
    elif ":" in compensator:
        digest.update(_own_code_digest(compensator.partition(":")[0]).encode())
    for name in named:
        try:
            digest.update(hashlib.sha256(Path(name).read_bytes()).digest())
        except OSError as error:
            raise HexsimError(f"cannot read {name}: {error.strerror or error}") from None
    return digest.hexdigest()[:20]


def _paths_in(tables: Mapping[str, Any]) -> list[str]:
    """Values of all keys `path`, dotted ones and those of tables within tables."""
    found = [value for key, value in tables.items() if key.rpartition(".")[2] == "path" and isinstance(value, str)]
    return found + [path for value in tables.values() if isinstance(value, Mapping) for path in _paths_in(value)]


@cache
def _hexsim_digest() -> str:
    """Of the sources of hexsim and its algorithms, and of the parts that other packages announce."""
    packages = [Path(str(package.__file__)).parent for package in (hexsim, compensation)]
    announced = [point for group in GROUPS for point in entry_points(group=group)]
    files = [path for package in packages for path in _code_below(package)]
    files += [path for point in announced for path in _code_of(point.module)]
    return _digest_of(files)


@cache  # a process runs the code that it has loaded
def _own_code_digest(module: str) -> str:
    """Of a module, its package, and what of the user's they import."""
    found, waiting, files = set(), [module.partition(".")[0]], []
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        code = _code_of(name)
        if name != module.partition(".")[0] and any(_is_installed(path) for path in code):
            continue
        files += code
        waiting += [other for path in code if path.suffix == ".py" for other in _imported_by(path)]
    return _digest_of(files)


def _is_installed(path: Path) -> bool:
    """Whether a file is Python's, of an installed package or hexsim's own."""
    paths = sysconfig.get_paths()
    folders = [Path(paths[key]) for key in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [Path(str(package.__file__)).parent for package in (hexsim, compensation)]
    return any(path.is_relative_to(folder) for folder in folders)


def _imported_by(path: Path) -> list[str]:
    """Top names of what a source file imports."""
    try:
        nodes = list(ast.walk(ast.parse(path.read_bytes())))
    except (SyntaxError, ValueError):
        return []
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    return [name.partition(".")[0] for name in names]


def _code_of(module: str) -> list[Path]:
    """The files of the package that a module is in, or its own."""
    try:
        spec = find_spec(module.partition(".")[0])
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    if spec.submodule_search_locations:
        return [path for folder in spec.submodule_search_locations for path in _code_below(Path(folder))]
    return [Path(spec.origin)] if spec.origin else []


def _code_below(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.suffix in CODE and path.is_file())


def _digest_of(files: Iterable[Path]) -> str:
    """By name and content: the same on another computer with the same files in other folders."""
    digest = hashlib.sha256()
    for entry in sorted(
        {(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in files if path.is_file()}
    ):
        digest.update(repr(entry).encode())
    return digest.hexdigest()
