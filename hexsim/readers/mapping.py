"""Mapping file: which column of a foreign file is which signal, in which unit.

kind = "bench"                    # or "hexapod", or "own" (a machine with balances of its own)
[file]                            # all optional
separator = "whitespace"          # "," ";" "tab" "whitespace"; left out = found by itself
comment = "#"                     # lines that begin so are skipped
columns = ["t", "pos", "p1"]      # names, when the file has no header row of its own
header_row = 12                   # the line, from 1, with the names (default: found by itself)
skip_rows = 3                     # lines before the table that are passed over
rate_Hz = 1000.0                  # when there is no column of time
si_letters = true                 # 25.1m is 0.0251: letters n, u, m, k behind numbers
[columns.position_m]              # name of the signal, SI unit at its end
from = "pos"                      # column of the file (default: the same name)
unit = "mm"                       # or factor = 1e-3 and offset = 0.0 (SI = factor * value + offset)
delay_s = 0.012                   # this channel is late by so much: it is moved forward
time = "t2"                       # its own column of time, in the unit of time_s (default: that of time_s)
missing = [-9999.0]               # values, as the file has them, that say "no sample"
held = true                       # it keeps its value until the next sample, however late that comes
unwrap = 65536.0                  # a counter that begins anew at this value of the file
[columns."position_{leg}_m"]      # all six legs at once: {leg} is 1 to 6, {leg0} is 0 to 5, in the name and in texts
from = "axis{leg}.actual"
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hexsim.errors import HexsimError
from hexsim.files.toml_files import read_toml, validation_sentence
from hexsim.signals.log import N_LEGS
from hexsim.signals.units import unit_of_name, unit_to_si

LEG, LEG0 = "{leg}", "{leg0}"


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, strict=True)


class FileLayout(Section):
    """How a text file is laid out."""

    separator: Literal[",", ";", "tab", "whitespace"] | None = Field(
        default=None, description="between cells; default: found by itself"
    )
    comment: str | None = Field(default=None, min_length=1, description="lines that begin so are passed over")
    columns: list[str] | None = Field(default=None, description="names, where the file has no row of names")
    header_row: int | None = Field(
        default=None, ge=1, le=100_000, description="line with the names, from 1; default: found by itself"
    )
    skip_rows: int = Field(default=0, ge=0, le=100_000, description="lines before the table that are passed over")
    rate_Hz: float | None = Field(
        default=None, gt=0.0, le=1e5, description="samples a second, where there is no column of time [Hz]"
    )
    si_letters: bool = Field(default=False, description="n, u, m, k behind a number are 1e-9, 1e-6, 1e-3, 1e3")


class Channel(Section):
    """One signal: where it stands and how it becomes SI."""

    source: str | None = Field(default=None, alias="from", description="column of the file; default: the same name")
    unit: str | None = Field(
        default=None, description="unit of the file's values; default: as the file states, else SI"
    )
    factor: float | None = Field(default=None, allow_inf_nan=False, description="SI = factor * value + offset")
    offset: float = Field(default=0.0, allow_inf_nan=False, description="in SI units")
    delay_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="by how much this channel is late [s]")
    time: str | None = Field(default=None, description="its own column of time, in the unit of time_s")
    missing: list[float] = Field(default=[], description="values of the file that say that there is no sample")
    held: bool | None = Field(default=None, description="it keeps its value until the next sample")
    unwrap: float | None = Field(
        default=None, gt=0.0, allow_inf_nan=False, description="value of the file at which a counter begins anew"
    )

    def to_si(self, name: str, where: str) -> tuple[float, float]:
        """(factor, offset) to SI of the column `name`."""
        if self.unit is not None and self.factor is not None:
            raise HexsimError(f"{where} [columns.{name}]: give unit or factor, not both")
        if self.unit is None:
            return (1.0 if self.factor is None else self.factor), self.offset
        factor, offset = unit_to_si(self.unit, f"{where} [columns.{name}]", unit_of_name(name)[1] or None)
        return factor, offset + self.offset


class Mapping(Section):
    """A mapping file."""

    kind: Literal["bench", "hexapod", "own"] | None = Field(default=None, description="default: by the columns")
    file: FileLayout = FileLayout()
    columns: dict[str, Channel] = Field(
        default={}, description="column of a log -> where it stands; {leg} for all legs"
    )


def load_mapping(path: Path | str | Mapping | None) -> Mapping:
    """Read and check a mapping file; None is the empty mapping (columns named as in the measured-log format)."""
    if path is None:
        return Mapping()
    if isinstance(path, Mapping):
        return path
    path = Path(path)
    try:
        mapping = Mapping.model_validate(of_each_leg(read_toml(path), path))
    except ValidationError as error:
        sentence = validation_sentence(error, Mapping).replace("source", "from")  # the key's name in the file
        raise HexsimError(f"{path}: {sentence}") from None
    for name, channel in mapping.columns.items():
        channel.to_si(name, str(path))
    return mapping


def of_each_leg(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """A mapping as read, with six columns for one whose name holds {leg}."""
    columns = data.get("columns")
    if not isinstance(columns, dict):
        return data
    found: dict[str, Any] = {}
    for name, channel in columns.items():
        legs: list[int | None] = list(range(1, N_LEGS["hexapod"] + 1)) if LEG in name else [None]
        for leg in legs:
            whole = name if leg is None else name.replace(LEG, str(leg))
            if whole in found:
                raise HexsimError(f"{path} [columns]: {whole} stands twice, once for all legs: name it once")
            found[whole] = channel if leg is None else for_leg(channel, leg)
    return {**data, "columns": found}


def for_leg(value: Any, leg: int) -> Any:
    """Texts under a channel with {leg} and {leg0} filled in."""
    if isinstance(value, str):
        return value.replace(LEG, str(leg)).replace(LEG0, str(leg - 1))
    return {key: for_leg(inner, leg) for key, inner in value.items()} if isinstance(value, dict) else value
