"""TOML files and what is wrong in them, in one sentence."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from pydantic import ValidationError

from hexsim.errors import HexsimError, shortened

MAX_DEPTH = 20  # tables within tables
SI = {
    "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "g": 1e-3, "kg": 1.0, "t": 1e3, "ms": 1e-3, "s": 1.0,
    "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "N": 1.0, "kN": 1e3, "l/min": 1e-3 / 60, "l": 1e-3, "ml": 1e-6,
    "cm3": 1e-6, "mV": 1e-3, "V": 1.0, "Hz": 1.0, "kHz": 1e3, "%": 1e-2,
}  # fmt: skip
PLAINLY = {
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "must be a table"),
    **dict.fromkeys(("tuple_type", "list_type"), "must be a list"),
}


def read_toml(
    path: Path,
    *,
    most_bytes: int = 10_000_000,  # of settings written by hand, a thousand times over
) -> dict[str, Any]:
    """The tables of a TOML file, or a HexsimError that names the file and line."""
    try:
        if path.stat().st_size > most_bytes:
            raise HexsimError(f"{path} is larger than {most_bytes // 1_000_000} MB: that is no file of settings")
        return parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise HexsimError(f"{path} is no text in UTF-8: save it so in your editor") from None
    except ValueError as error:
        raise HexsimError(f"{path} is not valid TOML: {shortened(str(error), 400)}") from None


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


def validation_sentence(
    error: ValidationError,
    model: Any,
    *,
    most_problems: int = 3,  # that one sentence holds
) -> str:
    """The problems of a pydantic error as one sentence: table, key, what was given, what is allowed.

    A key that is not known stands before those that are missing, because it may be one of them, misspelled.
    """
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] == "missing")
    said = list(dict.fromkeys(_problem(problem, model) for problem in problems))
    more = f" (and {len(said) - most_problems} more)" if len(said) > most_problems else ""
    return "; ".join(said[:most_problems]) + more


def _problem(first: Any, model: Any) -> str:
    where, at, bounds = _where(model, first["loc"])
    given = first.get("input")
    place = f"[{'.'.join(where[:-1])}] {where[-1]}" if len(where) > 1 else where[0] if where else "the file"
    kind = first["type"]
    a_table = hasattr(at, "model_fields") and kind != "extra_forbidden"
    if len(where) == 1 and (a_table or (isinstance(given, dict) and kind != "missing")):
        place = f"[{place}]"
    if kind == "missing" and isinstance(first["loc"][-1], int):
        return f"{place} = {shortened(repr(given))}: entry {first['loc'][-1] + 1} is missing"
    if kind == "missing" and isinstance(first["loc"][-1], str):
        return f"{place} is missing: add it (SI units)"
    if kind == "extra_forbidden":
        what = "table" if place.endswith("]") else "key"
        close = get_close_matches(where[-1], _keys(at), 1) if where else []
        meant = f"did you mean {close[0]}? " if close else ""
        return f"{shortened(place)} is not a known {what}: {meant}allowed are {', '.join(_keys(at))}"
    if kind.startswith("union_tag") and isinstance(given, dict):
        place = f"[{'.'.join(where)}] " if where else ""
        allowed = ", ".join(tag for member in _candidates(at) for tag in _kinds(member))
        return f"{place}kind = {shortened(repr(given.get('kind')))}: allowed are {allowed}"
    text = PLAINLY.get(kind) or first["msg"].removeprefix("Value error, ").replace(" after validation", "")
    shown = f" = {shortened(repr(given))}" if isinstance(given, (int, float, str, list, tuple)) else ""
    if kind in ("float_parsing", "float_type", "int_parsing", "int_type") and isinstance(given, str):
        return f"{place}{shown}: a number is needed, {_with_unit(given)}"
    units = f" ({bounds}SI units, as the key description)" if kind.startswith(("greater_than", "less_than")) else ""
    return f"{place}{shown}: {text[0].lower() + text[1:]}{units}"


def _with_unit(text: str) -> str:
    """What to write in place of a number with a unit, "20um"."""
    number = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\S+)\s*", text)
    if number is None:
        return "without quotes, in SI units"
    value, unit = number.groups()
    try:
        return f"in the unit that the key names: {float(value) * SI[unit]:g} for {text.strip()}"
    except (KeyError, ValueError):
        return f"without the unit {shortened(unit)}: in the unit that the key names"


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


def _keys(model: Any) -> list[str]:
    return list(getattr(model, "model_fields", {}))
