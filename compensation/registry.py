"""Algorithms by name: those of this package, those other packages announce, and any class by its module path.

A module of this package that holds a class derived from `Compensator` is an algorithm: adding one is adding a file.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import entry_points
from typing import Any

from .compensator import Compensator
from .guard import Guarded

ENTRY_POINT_GROUP = "hexsim.compensators"
PACKAGE = __name__.rpartition(".")[0]
SUFFIXES = (".so", ".dll", ".dylib")  # of exported libraries
Factory = Callable[..., Compensator]


def _built_in() -> dict[str, Factory]:
    """Factories of this package's algorithms and of their variants."""
    return _factories(importlib.import_module(f"{PACKAGE}.{name}") for name in _modules())


def _built_in_one(name: str) -> Factory | None:
    """The factory of one algorithm; the module of its name alone is loaded where that has it."""
    one = _factories([importlib.import_module(f"{PACKAGE}.{name}")]) if name in _modules() else {}
    return one.get(name) or _built_in().get(name)


def _factories(modules: Iterable[Any]) -> dict[str, Factory]:
    found = {kind.name: kind for module in modules for kind in vars(module).values() if _is_algorithm(kind)}
    factories: dict[str, Factory] = {}
    for kind in sorted(found.values(), key=lambda kind: (kind.place, kind.name)):
        factories[kind.name] = kind
        for name, configuration in vars(kind).get("variants", {}).items():
            factories[name] = partial(kind, **{"name": name, **configuration})
    return factories


def _modules() -> list[str]:
    return [found.name for found in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]


def _is_algorithm(found: Any) -> bool:
    """Whether it is a class that can be made by its name; the base class and the guard have none of their own."""
    if not (inspect.isclass(found) and issubclass(found, Compensator)) or inspect.isabstract(found):
        return False
    return isinstance(found.name, str) and found.name != ""


def _announced() -> dict[str, Any]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


def built_in() -> list[str]:
    """Names of this package's own algorithms."""
    return list(_built_in())


def create_built_in(name: str, **configuration: Any) -> Compensator:
    """This package's own algorithm called `name`: the gate for every name that comes from outside the process.

    Neither a path nor a module nor an installed package is looked at, so that a name cannot make the process run other
    code. Raises ValueError for any other name.
    """
    factory = _built_in_one(name)
    if factory is None:
        raise ValueError(
            f"{name[:60]!r} is no built-in compensator, and no other is taken from outside; there are {', '.join(built_in())}"
        )
    made = _configured(factory, name, configuration)
    return made if name == "none" else Guarded(made)


def available() -> list[str]:
    """Names that `create` understands, the built-in ones first."""
    own = built_in()
    return [*own, *(name for name in sorted(_announced()) if name not in own)]


def create(name: str, **configuration: Any) -> Compensator:
    """The algorithm called `name`, the class at `package.module:Class`, or the exported library at a path, with its
    configuration.

    Raises ValueError for an unknown name or one that cannot be imported (naming what there is), and TypeError for a
    class that is no compensator (naming what it lacks).
    """
    if name.endswith(SUFFIXES):
        from .library import Library  # it brings numba, which other names may not need

        return _configured(Library, name, {"path": name, **configuration})
    if ":" in name:
        return Guarded(check(_import(name), name, **configuration))
    if _built_in_one(name) is not None:
        return create_built_in(name, **configuration)
    announced = _announced()
    if name in announced:
        try:
            found = announced[name].load()
        except Exception as problem:
            raise ValueError(
                f"compensator '{name}' is announced by an installed package but does not load: {problem}"
            ) from problem
        return Guarded(check(found, name, **configuration))
    raise ValueError(
        f"no compensator is called '{name}'; there are {', '.join(available())}, "
        "or give your own as package.module:Class or an exported library as ./NAME.so"
    )


def check(found: Any, where: str, **configuration: Any) -> Compensator:
    """`found` made into a compensator, or a TypeError that says what it lacks."""
    if not inspect.isclass(found):
        raise TypeError(
            f"'{where}' is a {type(found).__name__}; a compensator is given as a class derived from "
            "compensation.Compensator"
        )
    if not issubclass(found, Compensator):
        missing = [m for m in ("start", "step", "parameters", "restore") if not callable(getattr(found, m, None))]
        lacks = f" and lacks {', '.join(missing)}" if missing else ""
        raise TypeError(
            f"'{where}' is not derived from compensation.Compensator{lacks}; derive it and write these methods"
        )
    missing = sorted(getattr(found, "__abstractmethods__", ()))
    if missing:
        raise TypeError(f"'{where}' lacks {', '.join(missing)}; compensation.Compensator says what each must do")
    made = _configured(found, where, configuration)
    if not made.name:
        raise TypeError(f"'{where}' has no name; set the class attribute `name`, by which logs and tables call it")
    return made


def _configured(factory: Factory, where: str, configuration: dict[str, Any]) -> Compensator:
    try:
        return factory(**configuration)
    except TypeError as problem:
        given = ", ".join(configuration) or "no configuration"
        raise TypeError(f"compensator '{where}' cannot be made with {given}: {problem}") from problem


def _import(path: str) -> Any:
    module_name, _, attribute = path.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ImportError as problem:
        raise ValueError(
            f"compensator '{path}': module '{module_name}' cannot be imported ({problem}); is it on PYTHONPATH?"
        ) from problem
    if not hasattr(module, attribute):
        classes = [
            n
            for n, c in vars(module).items()
            if inspect.isclass(c) and issubclass(c, Compensator) and c is not Compensator
        ]
        has = f"it has {', '.join(classes)}" if classes else "it has no compensator"
        raise ValueError(f"compensator '{path}': module '{module_name}' has no '{attribute}'; {has}")
    return getattr(module, attribute)
