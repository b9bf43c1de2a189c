"""Parts that are found, not listed: a module of a package each, and those that other installed packages announce."""

from __future__ import annotations

import importlib
import pkgutil
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any


def found_parts(package: ModuleType, attribute: str, group: str) -> dict[str, Any]:
    """Module or entry point name -> its object, in the order of the names, those of the package first.

    Each module of `package` defines `attribute`; an entry point of `group` names such an object of another package.
    """
    names = sorted(info.name for info in pkgutil.iter_modules(package.__path__))
    found = {name: getattr(importlib.import_module(f"{package.__name__}.{name}"), attribute) for name in names}
    announced = sorted(entry_points(group=group), key=lambda point: point.name)
    return found | {point.name: point.load() for point in announced if point.name not in found}
