"""What all tables of a machine or scenario file have in common: strict types, bounds, a description of each key."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator

ZERO_OR = "zero_or_at_least"  # key of the JSON schema


class Section(BaseModel):
    """A table of a file: frozen and strict (`true` is no 1.0, "7" no 7.0; whole numbers are fine for floats).

    Unknown keys and numbers that are not finite are refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

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
