"""A machine file with other numbers in it and everything else, comments too, as its author wrote it."""

from __future__ import annotations

from collections.abc import MutableMapping
from typing import Any, TypeGuard

import tomlkit


def edited(text: str, before: dict[str, Any], after: dict[str, Any]) -> str:
    """The file's text, changed where the tables that it declares, `before`, differ from `after`."""
    document = tomlkit.parse(text)
    _update(document, before, after)
    return tomlkit.dumps(document)


def _update(document: MutableMapping[str, Any], before: dict[str, Any], after: dict[str, Any]) -> None:
    for key in before.keys() - after.keys() & document.keys():
        del document[key]
    for key, value in after.items():
        old, here = before.get(key), document.get(key)
        if value == old:
            continue
        if isinstance(value, dict) and (here is None or isinstance(here, MutableMapping)):
            if here is None:
                document[key] = tomlkit.table()
            _update(document[key], old if isinstance(old, dict) else {}, value)
        elif _tables(value) and _tables(old) and _tables(here) and len(value) == len(old) == len(here):
            for place, one, other in zip(here, old, value, strict=True):
                _update(place, one, other)
        else:
            document[key] = value


def _tables(value: Any) -> TypeGuard[list[Any]]:
    """Is it a list of tables?"""
    return isinstance(value, list) and all(isinstance(one, MutableMapping) for one in value)
