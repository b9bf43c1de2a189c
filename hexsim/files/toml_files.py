"""TOML files and what is wrong in them, in one sentence."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from pydantic import ValidationError

from hexsim.errors import HexsimError, shortened

MAX_BYTES = 10_000_000
MAX_DEPTH = 20  # tables within tables
PLAINLY = {
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "must be a table"),
    **dict.fromkeys(("tuple_type", "list_type"), "must be a list"),
}


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, or a HexsimError that names the file and line."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise HexsimError(f"{path} is larger than {MAX_BYTES // 1_000_000} MB: that is no file of settings")
        return parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise HexsimError(f"{path} is not valid TOML: {shortened(str(error))}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of TOML text. ValueError for what is no TOML, too deep, or an integer beyond 64 bits, as TOML has it."""
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"tables or lists within each other more than {MAX_DEPTH} deep") from None
    level: list[Any] = [tables]
    for _ in range(MAX_DEPTH):
        level = [item for value in level for item in _items(value)]
        if any(isinstance(value, int) and not -(2**63) <= value < 2**63 for value in level):
            raise ValueError("an integer beyond 64 bits")
        if not level:
            return tables
    raise ValueError(f"tables or lists within each other more than {MAX_DEPTH} deep")


def _items(value: Any) -> Iterator[Any]:
    if isinstance(value, (dict, list)):
        yield from value.values() if isinstance(value, dict) else value


def set_dotted(tables: dict[str, Any], dotted: str, value: Any, source: str) -> None:
    """Set one key of nested tables, "valve.overlap_m"; the tables on the way must exist or be new."""
    *path, key = dotted.split(".")
    if len(path) > MAX_DEPTH:
        raise HexsimError(f"{source}: {shortened(dotted)} leads through {len(path)} tables: give table.key")
    for part in path:
        tables = tables.setdefault(part, {})
        if not isinstance(tables, dict):
            raise HexsimError(f"{source}: {dotted} leads through {part}, which is no table")
    tables[key] = value


def validation_sentence(error: ValidationError, model: Any) -> str:
    """The first problem of a pydantic error as one sentence: table, key, what was given, what is allowed."""
    first = error.errors(include_url=False)[0]
    where, at, bounds = _where(model, first["loc"])
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    given = first.get("input")
    place = f"[{'.'.join(where[:-1])}] {where[-1]}" if len(where) > 1 else where[0] if where else "the file"
    kind = first["type"]
    a_table = hasattr(at, "model_fields") and kind != "extra_forbidden"
    if len(where) == 1 and (a_table or (isinstance(given, dict) and kind != "missing")):
        place = f"[{place}]"
    if kind == "missing" and isinstance(first["loc"][-1], int):
        return f"{place} = {shortened(repr(given))}: entry {first['loc'][-1] + 1} is missing{more}"
    if kind == "missing" and isinstance(first["loc"][-1], str):
        return f"{place} is missing: add it (SI units){more}"
    if kind == "extra_forbidden":
        what = "table" if place.endswith("]") else "key"
        return f"{shortened(place)} is not a known {what}: allowed are {', '.join(_keys(at))}{more}"
    if kind.startswith("union_tag") and isinstance(given, dict):
        place = f"[{'.'.join(where)}] " if where else ""
        return f"{place}kind = {shortened(repr(given.get('kind')))}: allowed are {', '.join(_all_kinds(at))}{more}"
    text = PLAINLY.get(kind) or first["msg"].removeprefix("Value error, ").replace(" after validation", "")
    shown = f" = {shortened(repr(given))}" if isinstance(given, (int, float, str, list, tuple)) else ""
    units = f" ({bounds}SI units, as the key description)" if kind.startswith(("greater_than", "less_than")) else ""
    return f"{place}{shown}: {text[0].lower() + text[1:]}{units}{more}"


def _where(model: Any, loc: tuple[int | str, ...]) -> tuple[list[str], Any, str]:
    """The keys that `loc` leads through, without places in lists and tags of unions; what is declared there; its range.

    For a key that is not known it is the table that lacks it.
    """
    keys: list[str] = []
    bounds = ""
    for part in loc:
        if isinstance(part, int):
            model = next(iter(_candidates(model, inside=True)), model)
            continue
        candidates = _candidates(model)
        tagged = [c for c in candidates if part in _kinds(c) or part == getattr(c, "__name__", "")]
        if tagged:
            model = tagged[0]
            continue
        table = next((c for c in candidates if hasattr(c, "model_fields")), None)
        if table is None and (len(candidates) > 1 or get_origin(candidates[0]) is not dict):
            continue  # which alternative of a union was tried
        keys.append(part)
        if table is None:
            model = get_args(candidates[0])[1]
        elif part in table.model_fields:
            model, bounds = table.model_fields[part].annotation, _range(table.model_fields[part].metadata)
        else:
            model = table
    tables = [c for c in _candidates(model) if hasattr(c, "model_fields")]
    return keys, tables[0] if len(tables) == 1 else model, bounds


def _range(metadata: list[Any]) -> str:
    """The range, "0.001 to 2 is possible; ", where both bounds are closed."""
    found = {name: getattr(item, name) for item in metadata for name in ("ge", "le") if hasattr(item, name)}
    return f"{found['ge']:g} to {found['le']:g} is possible; " if len(found) == 2 else ""


def _candidates(annotation: Any, inside: bool = False) -> list[Any]:
    """The alternatives of a union, annotated or not; `inside`: of what a list or tuple holds."""
    if get_origin(annotation) is Annotated:
        return _candidates(get_args(annotation)[0], inside)
    if get_origin(annotation) in (list, tuple):
        return _candidates(get_args(annotation)[0]) if inside else [annotation]
    if get_args(annotation) and get_origin(annotation) is not dict:
        return [one for part in get_args(annotation) for one in _candidates(part, inside)]
    return [annotation]


def _kinds(candidate: Any) -> tuple[Any, ...]:
    """The tags of a member of a discriminated union."""
    field = getattr(candidate, "model_fields", {}).get("kind")
    return get_args(field.annotation) if field is not None else ()


def _all_kinds(union: Any) -> list[str]:
    return [kind for candidate in _candidates(union) for kind in _kinds(candidate)]


def _keys(model: Any) -> list[str]:
    return list(getattr(model, "model_fields", {}))
