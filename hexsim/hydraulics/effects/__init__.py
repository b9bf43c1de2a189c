"""The library of effects, found by folder or entry point. See `effect` for what an effect is."""

from __future__ import annotations

import importlib
import math
import pkgutil
import re
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.effects.effect import Effect, EffectParameter

GROUP = "hexsim.effects"
__all__ = ["Effect", "EffectParameter", "check_effects", "effect_named", "effect_setting", "effect_settings", "library"]


@cache
def library() -> dict[str, Effect]:
    """All effects by name, in the order of their names: the files of this folder (one EFFECT, or several EFFECTS), and
    installed ones.

    A package adds its own by an entry point of the group `hexsim.effects` that leads to an Effect. HexsimError when a
    name is taken, or when what an entry point leads to is no Effect.
    """
    names = [info.name for info in pkgutil.iter_modules(__path__) if info.name != "effect"]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    found = [effect for module in modules for effect in getattr(module, "EFFECTS", None) or (module.EFFECT,)]
    for entry in entry_points(group=GROUP):
        effect = entry.load()
        if not isinstance(effect, Effect):
            raise HexsimError(f"entry point {entry.name} of {GROUP} leads to {type(effect).__name__}: give an Effect")
        if effect.name in {other.name for other in found}:
            raise HexsimError(
                f"entry point {entry.name} of {GROUP}: there is an effect {effect.name} already; rename it"
            )
        found.append(effect)
    return {effect.name: effect for effect in sorted(found, key=lambda effect: effect.name)}


def effect_named(name: str, source: str = "effects") -> Effect:
    """The effect, or a HexsimError that lists what there is."""
    if name not in library():
        raise HexsimError(f"{source}: unknown effect {name!r}; known are {', '.join(library())}")
    return library()[name]


def effect_settings(machine: Machine, source: str = "machine") -> list[tuple[Effect, tuple[int, ...], dict[str, Any]]]:
    """The machine's [effects] as (effect, 0-based legs, values), checked against bounds and places."""
    return [
        effect_setting(machine, name, table, f"{source}: [effects.{name}]")
        for name, tables in machine.effects.items()
        for table in (tables if isinstance(tables, list) else [tables])
    ]


def effect_setting(
    machine: Machine, name: str, table: dict[str, Any], place: str
) -> tuple[Effect, tuple[int, ...], dict[str, Any]]:
    """One effect as (effect, 0-based legs, values) from its table: parameters and `where`; `place` begins an error."""
    effect = effect_named(name, place)
    if machine.machine.kind not in effect.kinds:
        raise HexsimError(f"{place} is for a {' or '.join(effect.kinds)}, not a {machine.machine.kind}")
    if not effect.fits(machine):
        raise HexsimError(f'{place} is for a cylinder with both chambers on the valve: [cylinder] rod_side = "valve"')
    return effect, _legs(table.get("where", "all legs"), machine.n_legs, place), _values(effect, table, place)


def check_effects(machine: Machine, source: str) -> None:
    """Raise HexsimError when an effect of the file is unknown, out of bounds, in no such place, or twice where it may be once."""
    there: dict[str, set[int]] = {}
    for effect, legs, _ in effect_settings(machine, source):
        taken = there.setdefault(effect.name, set())
        if effect.once and taken & set(legs):
            where = "it" if effect.places in ("platform", "machine") else f"leg {min(taken & set(legs)) + 1}"
            raise HexsimError(
                f"{source}: [effects.{effect.name}] is given twice for {where}, and one would overwrite the other: "
                'keep one table, or give each its own legs by `where = "leg 2"`'
            )
        taken |= set(legs)
    lines = [name for name in there if library()[name].balance == "supply" and library()[name].once]
    if len(lines) > 1:
        raise HexsimError(
            f"{source}: [effects.{lines[0]}] and [effects.{lines[1]}] are a supply line each: keep one of them"
        )


def _values(effect: Effect, table: dict[str, Any], place: str) -> dict[str, Any]:
    """Every parameter of the effect with its value; unknown, missing and out-of-bounds ones are refused."""
    known = {parameter.name: parameter for parameter in effect.parameters}
    free = {"where", "curve", "description"}  # a learned term carries its curve
    unknown = [key for key in table if key not in known and key not in free]
    if unknown:
        raise HexsimError(f"{place} {unknown[0]} is not a known key: allowed are {', '.join([*known, 'where'])}")
    values: dict[str, Any] = {key: table[key] for key in ("curve",) if key in table}
    for name, parameter in known.items():
        value = table.get(name, parameter.default)
        if value is None:
            raise HexsimError(f"{place} {name} is missing: add it in {parameter.unit}")
        low, high = parameter.bounds
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise HexsimError(f"{place} {name} = {value!r} must be a finite number in {parameter.unit}")
        if not low <= value <= high:
            raise HexsimError(f"{place} {name} = {value:g} must lie in [{low:g}, {high:g}] {parameter.unit}")
        values[name] = float(value)
    return values


def _legs(where: Any, n_legs: int, place: str) -> tuple[int, ...]:
    """0-based legs of "all legs", "leg 2", ["leg 1", "leg 4"]; "platform" and "machine" stand for all."""
    legs: list[int] = []
    for item in where if isinstance(where, list) else [where]:
        if item in ("all legs", "platform", "machine"):
            legs += range(n_legs)
            continue
        match = re.fullmatch(r"leg (\d+)", item) if isinstance(item, str) else None
        if match is None or not 1 <= int(match[1]) <= n_legs:
            raise HexsimError(f'{place} where = {item!r} must be "all legs", "platform" or "leg 1".."leg {n_legs}"')
        legs.append(int(match[1]) - 1)
    return tuple(dict.fromkeys(legs))
