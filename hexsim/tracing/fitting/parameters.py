"""What is fitted: the declared parameters within their uncertainty, and the effects that a hypothesis adds.

A hypothesis is a tuple of candidates (an effect, where it acts, its shape). Its unknowns are coordinates: for a
declared parameter the relative deviation, for an effect's number the value over its typical size (1/value for an
effect that vanishes at infinity), to the power in which it grows. At coordinate 0 everything is as declared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hexsim.declaration import Machine
from hexsim.declaration.machine import LENGTHS
from hexsim.errors import HexsimError
from hexsim.hydraulics.effects import Effect, EffectParameter, effect_named, library
from hexsim.tracing import rules

Array = np.ndarray
ENDS = ("lower", "upper")
TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, kw_only=True)
class Prior:
    """A declared parameter that may be off: dotted key, declared value, relative half width (uniform)."""

    key: str  # as in [uncertainty]
    dotted: str
    declared: float
    half_width: float

    def after(self, here: float, step: float) -> float:
        """Coordinate [half widths] after a step along that in which its answer is straight: of oil, which trades with other
        springs, the compliance."""
        if self.key != "bulk_modulus_Pa":
            return here + step
        share = 1.0 + here * self.half_width
        softer = max(1.0 - step * self.half_width / share, 0.5)
        return min(max((share / softer - 1.0) / self.half_width, -1.0), 1.0)


def priors(machine: Machine) -> tuple[Prior, ...]:
    """The [uncertainty] table with the place of each key. Raises HexsimError for a key that is nowhere."""
    tables = machine.model_dump(exclude={"uncertainty", "effects", "leg"}, exclude_none=True)
    found = []
    relative = {key: half_width for key, half_width in machine.uncertainty.items() if key not in LENGTHS}
    for key, half_width in relative.items():
        for section, table in tables.items():
            for name, value in table.items() if isinstance(table, dict) else ():
                if key in (name, f"{section}_{name}") and isinstance(value, float) and half_width > 0:
                    found.append(Prior(key=key, dotted=f"{section}.{name}", declared=value, half_width=half_width))
    missing = set(relative) - {prior.key for prior in found} - {key for key, width in relative.items() if width == 0}
    if missing:
        raise HexsimError(f"[uncertainty] {min(missing)} is no number of the machine file: use the key of its table")
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect at a place, with the numbers of its shape fixed for screening; all are free in a refit."""

    effect: Effect
    where: str = "all legs"
    shape: dict[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        return self.effect.name if self.where in ("all legs", "platform") else f"{self.effect.name} in {self.where}"

    def free(self) -> tuple[EffectParameter, ...]:
        """The numbers that a refit changes, the size first."""
        return self.effect.parameters

    def table(self, values: dict[str, float]) -> dict[str, Any]:
        """The [effects.*] table of a machine file."""
        return self.shape | values | ({} if self.where == "all legs" else {"where": self.where})

    def start(self) -> dict[str, float]:
        """Values at a coordinate size of 0: neutral size, shape as screened."""
        values = {}
        for i, parameter in enumerate(self.effect.parameters):
            rest = parameter.typical if parameter.default is None else parameter.default
            values[parameter.name] = self.shape.get(parameter.name, parameter.neutral if i == 0 else rest)
        return values


def to_value(parameter: EffectParameter, coordinate: float) -> float:
    """Physical value of a coordinate, inside the bounds."""
    if math.isinf(parameter.neutral):
        value = parameter.typical / max(coordinate, 1e-12)
    else:
        size = np.copysign(abs(coordinate) ** (1.0 / parameter.power), coordinate)
        value = float(size) * (abs(parameter.typical) or 1.0)
    low, high = parameter.bounds
    return min(max(value, low), high)


def to_coordinate(parameter: EffectParameter, value: float) -> float:
    """Inverse of `to_value`."""
    if math.isinf(parameter.neutral):
        return 0.0 if math.isinf(value) else parameter.typical / value
    size = value / (abs(parameter.typical) or 1.0)
    return math.copysign(abs(size) ** parameter.power, size)


def coordinate_bounds(parameter: EffectParameter) -> tuple[float, float]:
    """Bounds of the coordinate."""
    low, high = parameter.bounds
    if math.isinf(parameter.neutral):
        return 0.0, parameter.typical / low
    return to_coordinate(parameter, low), to_coordinate(parameter, high)


def end_of_range(parameter: EffectParameter, value: float) -> str:
    """Which end of its range a number has run to: lower, upper or none of them, empty."""
    return next(
        (
            end
            for end, bound in zip(ENDS, parameter.bounds, strict=True)
            if math.isclose(value, bound, rel_tol=rules.AT_END)
        ),
        "",
    )


def in_range(candidate: Candidate, values: dict[str, float]) -> bool:
    """Are the size of an effect, and the time in which it settles if it does, inside what a machine can have?"""
    size, *others = candidate.free()
    asked = [size, *(number for number in others if number.name == TIME_CONSTANT)]
    return not any(end_of_range(number, values[number.name]) for number in asked)


def candidates(machine: Machine, proposed: dict[str, dict[str, float]] | None = None) -> list[Candidate]:
    """Every library effect that this machine can have, at every place and for every shape of its grid.

    proposed: effect name -> numbers of its shape, read off the data (see `proposals`).
    """

    found = []
    for effect in library().values():
        if not effect.fits(machine) or not effect.parameters:
            continue
        own = (proposed or {}).get(effect.name, {})
        for variant in components(effect, machine):
            for where in places(effect, machine):
                found += [Candidate(effect=variant, where=where, shape=own | shape) for shape in shapes(effect)]
    return found


def components(effect: Effect, machine: Machine) -> list[Effect]:
    """An effect once for each number that may be its size: the first one, or each component in turn."""
    numbers = tuple(number for number in effect.parameters if machine.machine.kind in number.kinds)
    if not effect.vector:
        return [replace(effect, parameters=numbers)]
    return [replace(effect, parameters=numbers[k:] + numbers[:k]) for k in range(len(numbers))]


def places(effect: Effect, machine: Machine) -> list[str]:
    """Where an effect can act on this machine."""
    legs = [f"leg {i + 1}" for i in range(machine.n_legs)]
    if effect.places == "one leg":
        return legs
    return ["all legs", *legs] if effect.places == "leg" and machine.n_legs > 1 else ["all legs"]


def shapes(effect: Effect) -> list[dict[str, float]]:
    """All combinations of the grids of an effect's shape parameters."""
    combinations: list[dict[str, float]] = [{}]
    for parameter in effect.parameters:
        if parameter.grid:
            combinations = [{**c, parameter.name: value} for c in combinations for value in parameter.grid]
    return combinations


def with_settings(
    machine: Machine, deviations: dict[Prior, float], effects: list[tuple[Candidate, dict[str, float]]]
) -> Machine:
    """The declared machine with relative deviations of parameters and effects with these values.

    An effect whose size is neutral is left out.
    """
    tables = machine.model_dump(exclude_none=True)
    for prior, deviation in deviations.items():
        section, key = prior.dotted.split(".")
        tables[section][key] = prior.declared * (1.0 + deviation)
    added: dict[str, list] = {
        name: list(table) if isinstance(table, list) else [table] for name, table in machine.effects.items()
    }
    for candidate, values in effects:
        size = candidate.effect.parameters[0]
        if values[size.name] != size.neutral and math.isfinite(values[size.name]):
            added.setdefault(candidate.effect.name, []).append(candidate.table(values))
    tables["effects"] = {name: rows[0] if len(rows) == 1 else rows for name, rows in added.items()}
    return Machine.model_validate(tables)


def named(name: str, where: str = "all legs", **shape: float) -> Candidate:
    """A candidate by the effect's name."""
    return Candidate(effect=effect_named(name), where=where, shape=shape)
