"""The one gate for what was learned elsewhere: start parameters from a file, a packet or a page, before they reach an algorithm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .compensator import Compensator, Context, Parameters


def check_parameters(compensator: Compensator, context: Context, parameters: Any) -> None:
    """Raises ValueError, in one sentence, where these cannot be what `compensator.parameters` gave on this data sheet: not the same
    names and shapes, not finite, or refused by the algorithm itself (`Compensator.refused`)."""
    usual = compensator.parameters(compensator.start(context))
    if problem := _unlike(usual, parameters, "") or compensator.refused(context, parameters):
        raise ValueError(f"start parameters of {compensator.name}: {problem}; learn them anew with `hexsim tune`")


def _unlike(usual: Any, given: Any, place: str) -> str:
    """What of `given` has not the kind of `usual`, or is not finite; empty where nothing is."""
    if isinstance(usual, Mapping):
        if not isinstance(given, Mapping):
            return f"{place or 'they'} must be a table of names and values, not {shown(given)}"
        inner = ((name, given[name]) for name in usual if name in given)
        return next((found for name, value in inner if (found := _unlike(usual[name], value, f"{place}{name}."))), "")
    place = place.rstrip(".")
    if isinstance(usual, str):
        return "" if isinstance(given, str) else f"{place} must be text, not {shown(given)}"
    if isinstance(usual, list):
        if not isinstance(given, list | tuple):
            return f"{place} must be a list, not {shown(given)}"
        first = usual[0] if usual else 0.0
        each = ((i, value) for i, value in enumerate(given))
        return next((found for i, value in each if (found := _unlike(first, value, f"{place}[{i}]."))), "")
    return "" if is_number(given) else f"{place} is {shown(given)}; it must be a finite number"


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, and no truth value."""
    try:
        return not isinstance(value, bool | str) and math.isfinite(float(value))
    except (TypeError, ValueError, OverflowError):
        return False


def shown(
    value: Any,
    *,
    most_characters: int = 60,  # of a value that is shown
) -> str:
    """A value as a sentence has it."""
    if value is None:
        return "null"
    if isinstance(value, list | tuple | Mapping):
        return f"a {'table' if isinstance(value, Mapping) else 'list'} of {len(value)}"
    try:
        return repr(value)[:most_characters]
    except ValueError:  # of more digits than Python writes
        return "a number of too many digits"


def beyond_volts(parameters: Parameters, names: tuple[str, ...], limit_V: float) -> str:
    """The first of the named numbers, or lists of numbers, beyond a limit [V], as a sentence."""
    for name in names:
        values = parameters[name] if isinstance(parameters[name], list | tuple) else [parameters[name]]
        for value in values:
            if abs(value) > limit_V:
                return f"{name} is {value:g}; it must lie within +-{limit_V:g}"
    return ""
