"""What all tables of a machine or scenario file have in common: strict types, bounds, a description of each key.

A kind of thing that a scenario lists (a signal, a fault) is a frozen dataclass with its `kind`. Its fields carry their
bounds, and `section_of` makes its table from them.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, create_model, field_validator

ZERO_OR = "zero_or_at_least"  # key of the JSON schema


class Section(BaseModel):
    """A table of a file: frozen and strict (`true` is no 1.0, "7" no 7.0; whole numbers are fine for floats).

    Unknown keys and numbers that are not finite are refused.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, strict=True, arbitrary_types_allowed=True
    )

    @field_validator("*")
    @classmethod
    def _zero_or_at_least(cls, value: Any, info: ValidationInfo) -> Any:
        extra = cls.model_fields[str(info.field_name)].json_schema_extra
        if isinstance(extra, dict) and 0.0 < value < (low := float(str(extra.get(ZERO_OR, 0.0)))):
            raise ValueError(f"must be 0 or at least {low:g}")
        return value


def between(low: float, high: float, description: str, **more: Any) -> Any:
    """A number with the bounds that are physically possible; `description` with its unit stands in the JSON schema."""
    return Field(ge=low, le=high, allow_inf_nan=False, description=description, **more)


def zero_or(low: float, high: float, description: str) -> Any:
    """Bounds of a number that is 0, the effect switched off, or lies between `low` and `high`; default 0."""
    return between(0.0, high, description, default=0.0, json_schema_extra={ZERO_OR: low})


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError("must be printable characters on one line")
    return name


Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]


@cache
def section_of(declared: type, *more: tuple[str, Any, Any]) -> type[Section]:
    """The table that makes the dataclass `declared`: its `kind`, its fields, and more as (name, type, default)."""
    hints = get_type_hints(declared, include_extras=True)
    fields: dict[str, Any] = {"kind": (Literal[declared.kind], Field(description="what it is"))}  # type: ignore[attr-defined]
    for field in dataclasses.fields(declared):
        default = ... if field.default is dataclasses.MISSING else field.default
        fields[field.name] = (hints[field.name], default)
    fields |= {name: (annotation, default) for name, annotation, default in more}
    return create_model(declared.__name__, __base__=Section, __doc__=declared.__doc__, **fields)


def values_of(table: BaseModel) -> dict[str, Any]:
    """The values of a checked table, without its `kind`: arguments for the dataclass."""
    return {name: value for name, value in table if name != "kind"}
