"""The tables [[leg]]: what one leg has otherwise than the others."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Optional, TypeVar

from pydantic import Field, ValidationError, create_model

from hexsim.declaration.actuator import Cylinder, Friction
from hexsim.declaration.section import Section, between
from hexsim.declaration.sensors import Sensors
from hexsim.declaration.valve import Valve
from hexsim.files.toml_files import validation_sentence

Table = TypeVar("Table", bound=Section)

# Keys of which one replaces the others: a leg that gives one of them does not inherit the rest.
SAME = (
    ("overlap_m", "overlap_percent", "overlap_edges_m", "flow_curve"),
    ("spool_diameter_m", "rated_flow_m3_s"),
    ("spool_diameter_m", "rated_pressure_drop_Pa"),
    ("spool_frequency_Hz", "small_signal_minus_90deg_Hz"),
    ("laminar_reynolds", "flow_at_10_percent_m3_s"),
    ("slew_time_s", "large_signal_minus_3dB_Hz"),
)


def _some_of(table: type[Section], keys: Iterable[str]) -> Any:
    """The table with none of its keys required."""
    fields: dict[str, Any] = {}
    for key in keys:
        field = copy.copy(table.model_fields[key])
        field.default, field.default_factory = None, None
        fields[key] = (Optional[field.annotation], field)  # noqa: UP045  # a union of a forward reference cannot be written
    return create_model(f"{table.__name__}OfLeg", __base__=Section, __doc__=table.__doc__, **fields)


def _but(table: type[Section], *keys: str) -> Any:
    return _some_of(table, [key for key in table.model_fields if key not in keys])


OF_SENSOR = [key for key in Sensors.model_fields if key.startswith(("position_", "pressure_")) and "filter" not in key]
CylinderOfLeg = _but(Cylinder, "rod_side")
ValveOfLeg = _but(Valve, "kind")
FrictionOfLeg = _but(Friction)
SensorsOfLeg = _some_of(Sensors, OF_SENSOR)


class ControllerOfLeg(Section):
    """What legs of one motion computer may have of their own."""

    gain_V_per_m: float | None = between(1e-3, 1e6, "proportional gain [V/m]", default=None)


class LegTable(Section):
    """Keys of one leg that differ from the machine's tables; all others hold for it too."""

    number: int = Field(ge=1, le=6, description="which leg, from 1")
    cylinder: CylinderOfLeg = Field(None, description="keys of [cylinder]")  # pyright: ignore[reportInvalidTypeForm]
    valve: ValveOfLeg = Field(None, description="keys of [valve]")  # pyright: ignore[reportInvalidTypeForm]
    friction: FrictionOfLeg = Field(None, description="keys of [friction]")  # pyright: ignore[reportInvalidTypeForm]
    sensors: SensorsOfLeg = Field(None, description="keys of [sensors]: position and pressure of this leg")  # pyright: ignore[reportInvalidTypeForm]
    controller: ControllerOfLeg | None = Field(None, description="keys of [controller]")


@dataclass(frozen=True, kw_only=True)
class Leg:
    """All tables of one leg."""

    cylinder: Cylinder
    valve: Valve
    friction: Friction
    sensors: Sensors
    controller: Any


TABLES = tuple(name for name in LegTable.model_fields if name != "number")


def leg_of(number: int, shared: Leg, tables: Iterable[LegTable]) -> Leg:
    """Leg `number`, from 1. ValueError where its tables together are none that a leg can have."""
    own = next((table for table in tables if table.number == number), None)
    if own is None:
        return shared
    return Leg(**{name: _changed(number, name, getattr(shared, name), getattr(own, name)) for name in TABLES})


@lru_cache(maxsize=256)
def _changed(number: int, name: str, table: Table, own: Section | None) -> Table:
    """The table with the leg's own keys."""
    changes = own.model_dump(exclude_none=True) if own is not None else {}
    if not changes:
        return table
    replaced = {key for group in SAME for key in group if not changes.keys().isdisjoint(group)}
    kept = {key: value for key, value in table.model_dump(exclude_none=True).items() if key not in replaced}
    try:
        return type(table).model_validate(kept | changes)
    except ValidationError as error:
        sentence = validation_sentence(error, type(table)).removeprefix("the file: ")
        raise ValueError(f"leg {number}: [leg.{name}] {sentence}") from None
