"""The measurement chain of report 2.3: a log as the volts that a scope records, and back.

    U     = zero + gain s / per               sensor or test output, s in SI
    U_adc = clip(round(U / q), -2^(b-1), 2^(b-1) - 1) q,   q = 2 R / 2^b      b bits over the range -R..+R
    s     = (U_adc - zero) per / gain

Scale factors are data: a TOML file (`measurement_chain.toml` beside this module is the report's). A channel serves all
columns of its kind: `position_m` serves position_m, position_1_m .. position_6_m; `acceleration_m_s2` serves all axes.
Columns without a channel (the truth behind a simulated log, angular accelerations) do not reach the scope.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import tomli_w
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from hexsim.declaration import Section
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.files.log_files import read_log, write_log
from hexsim.files.toml_files import read_toml, validation_sentence
from hexsim.signals.table import places
from hexsim.signals.units import unit_of_name

REPORT_CHAIN = Path(__file__).with_suffix(".toml")
UNITS = ("_m_s2", "_Pa", "_V", "_m")


class ScopeInput(Section):
    """Analogue-to-digital converter of the scope; bits = 0: ideal."""

    bits: int = Field(default=16, ge=0, le=32)
    range_V: float = Field(default=10.0, gt=0.0)

    @property
    def resolution_V(self) -> float:
        """One count [V]."""
        return 2.0 * self.range_V / 2.0**self.bits

    def convert(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the converter gives for an analogue voltage; not-a-number stays."""
        if self.bits == 0:
            return volts
        half = 2.0 ** (self.bits - 1)
        return np.clip(np.rint(volts / self.resolution_V), -half, half - 1) * self.resolution_V


class ScopeChannel(Section):
    """Volts of one kind of signal, U = zero_V + gain_V * s / per; range_V: an input range of its own."""

    gain_V: float
    per: float = Field(default=1.0, gt=0.0)
    zero_V: float = 0.0
    range_V: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _gain_is_not_zero(self) -> ScopeChannel:
        if self.gain_V == 0.0:
            raise ValueError("gain_V must not be 0")
        return self

    @property
    def slope(self) -> float:
        """Volts per SI unit."""
        return self.gain_V / self.per


class MeasurementChain(Section):
    """Scale factors of all channels by kind of signal, and the scope behind them."""

    name: str = "chain"
    scope: ScopeInput = ScopeInput()
    channels: dict[str, ScopeChannel]

    @model_validator(mode="after")
    def _kinds_have_units(self) -> MeasurementChain:
        for kind in self.channels:
            if not kind.endswith(UNITS):
                raise ValueError(f"channel {kind} has no unit: its name must end in {', '.join(UNITS)}")
        return self

    def kind_of(self, column: str) -> str | None:
        """The channel that serves a column of a log: its name without leg number or axis."""
        kind = places()[column][0].kind if column in places() else column
        return kind if kind in self.channels else None

    def input_of(self, kind: str) -> ScopeInput:
        """The converter of a channel."""
        own = self.channels[kind].range_V
        return self.scope if own is None else ScopeInput(bits=self.scope.bits, range_V=own)

    def resolution(self, kind: str) -> float:
        """One count in the signal's own unit."""
        return self.input_of(kind).resolution_V / abs(self.channels[kind].slope)


def load_chain(path: Path | str | None = None) -> MeasurementChain:
    """Read a chain; None is the report's. Raises HexsimError that names file, table and key."""
    path = REPORT_CHAIN if path is None else Path(path)
    try:
        return MeasurementChain.model_validate(read_toml(path))
    except ValidationError as error:
        raise HexsimError(f"{path}: {validation_sentence(error, MeasurementChain)}") from None


def scope_column(column: str) -> str:
    """Name of a column's volts: position_1_m -> scope_position_1_V."""
    return f"scope_{column.removesuffix('_' + unit_of_name(column)[1])}_V"


def to_scope_volts(log: pl.DataFrame, chain: MeasurementChain) -> pl.DataFrame:
    """The log as the scope records it: time_s and one column of volts for each column that has a channel.

    Raises HexsimError when no column has one.
    """
    columns = {"time_s": log["time_s"].to_numpy()}
    for name in log.columns:
        kind = chain.kind_of(name)
        if kind is not None:
            channel = chain.channels[kind]
            volts = channel.zero_V + channel.slope * log[name].to_numpy()
            columns[scope_column(name)] = chain.input_of(kind).convert(volts)
    if len(columns) == 1:
        known = ", ".join(chain.channels)
        raise HexsimError(f"no column of the log has a channel in chain {chain.name}: it has {known}")
    return pl.DataFrame(columns)


def _signal_of(scope_name: str, chain: MeasurementChain) -> tuple[str, str] | None:
    """(column, kind) of a scope column."""
    columns = (*places(), *chain.channels)
    found = next((name for name in columns if chain.kind_of(name) and scope_column(name) == scope_name), None)
    return None if found is None else (found, str(chain.kind_of(found)))


def from_scope_volts(scope: pl.DataFrame, chain: MeasurementChain) -> pl.DataFrame:
    """A log in SI from a scope's volts: time_s and every column that the chain knows.

    Raises HexsimError that names a scope column without a channel.
    """
    columns = {"time_s": scope["time_s"].to_numpy()}
    for name in scope.columns:
        if name == "time_s":
            continue
        found = _signal_of(name, chain)
        if found is None:
            raise HexsimError(
                f"scope column {name} has no channel in chain {chain.name}: it has {', '.join(chain.channels)}"
            )
        column, kind = found
        channel = chain.channels[kind]
        columns[column] = (scope[name].to_numpy() - channel.zero_V) / channel.slope
    return pl.DataFrame(columns)


def export_scope(log: pl.DataFrame, path: Path, chain: MeasurementChain) -> None:
    """Write a log in volts; the suffix chooses the format. A log name `scope.csv` gets `scope.mapping.toml` beside it,
    with which `hexsim trace` reads the volts."""

    volts = to_scope_volts(log, chain)
    write_log(volts, path)
    write_text(mapping_path(path), tomli_w.dumps(mapping_tables(volts, chain)))


def import_scope(path: Path, chain: MeasurementChain) -> pl.DataFrame:
    """Read a log in volts back into SI."""
    return from_scope_volts(read_log(path), chain)


def mapping_path(path: Path) -> Path:
    """Where the mapping of a scope's log stands."""
    return Path(path).with_name(f"{Path(path).name.split('.')[0]}.mapping.toml")


def mapping_tables(volts: pl.DataFrame, chain: MeasurementChain) -> dict[str, Any]:
    """Mapping file of the readers of measured logs: SI = factor * volts + offset."""
    columns: dict[str, Any] = {"time_s": {"from": "time_s"}}
    for name in volts.columns:
        if (signal := _signal_of(name, chain)) is not None:
            channel = chain.channels[signal[1]]
            columns[signal[0]] = {
                "from": name,
                "factor": 1.0 / channel.slope,
                "offset": -channel.zero_V / channel.slope,
            }
    return {"columns": columns}
