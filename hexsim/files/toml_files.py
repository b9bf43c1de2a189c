"""TOML files and what is wrong in them, in one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hexsim.errors import HexsimError


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, or a HexsimError that names the file and line."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise HexsimError(f"cannot read {path}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise HexsimError(f"{path} is not valid TOML: {error}") from None


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
    units = " (SI units, as the key description)" if first["type"].startswith(("greater_than", "less_than")) else ""
    return f"{place}{shown}: {text[0].lower() + text[1:]}{units}{more}"


def _keys_at(model: type, path: list[str]) -> list[str]:
    """Field names of the section that `path` leads to."""
    for part in path:
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        model = next((c for c in candidates if hasattr(c, "model_fields")), model)
    return list(model.model_fields)
