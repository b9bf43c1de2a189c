"""A measured log as arrays, one row a leg: what every later step reads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.signals.weak_form import Window

Array = np.ndarray
REST_m_s = (
    0.015  # a leg slower than this is near a reversal: friction is stiff, or falls with speed (3 Stribeck velocities)
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredLog:
    """One run. Arrays (n_legs, n) or (n,); a channel that was not logged is None.

    acceleration: (1, n) along the leg of a bench, (3, n) of a platform [m/s2]; angular: (3, n) [rad/s2].
    """

    name: str
    time: Array
    rate: float
    setpoint: Array | None
    position: Array
    volts: Array | None
    pressure: Array | None
    supply: Array | None
    acceleration: Array | None
    angular: Array | None = None

    @property
    def n(self) -> int:
        return self.time.shape[0]

    @property
    def n_legs(self) -> int:
        return self.position.shape[0]

    @cached_property
    def near_rest(self) -> Array:
        """Is any leg near a standstill, by its measured position? (n,) bool. Where fits need short steps."""
        return np.any(np.abs(Window(self.rate).rate(self.position)) < REST_m_s, axis=0)

    def head(self, duration_s: float) -> MeasuredLog:
        """The first seconds."""
        n = min(int(duration_s * self.rate), self.n)

        def cut(rows: Array | None) -> Array | None:
            return None if rows is None else np.ascontiguousarray(rows[..., :n])

        names = ("time", "setpoint", "position", "volts", "pressure", "supply", "acceleration", "angular")
        return replace(self, **{name: cut(getattr(self, name)) for name in names})


def measured_log(name: str, table: pl.DataFrame, machine: Machine) -> MeasuredLog:
    """Arrays of a checked table with a uniform time base. Raises HexsimError without time or position."""
    n_legs = machine.n_legs
    legs = [""] if n_legs == 1 else [f"_{i}" for i in range(1, n_legs + 1)]

    def column(key: str) -> Array:
        return np.ascontiguousarray(table[key].to_numpy(), dtype=float)

    def rows(stem: str, unit: str) -> Array | None:
        keys = [f"{stem}{leg}_{unit}" for leg in legs]
        return np.stack([column(key) for key in keys]) if all(key in table.columns for key in keys) else None

    def vector(stem: str, unit: str) -> Array | None:
        keys = [f"{stem}_{axis}_{unit}" for axis in "xyz"] if n_legs > 1 else [f"{stem}_{unit}"]
        return np.stack([column(key) for key in keys]) if all(key in table.columns for key in keys) else None

    position = rows("position", "m")
    if "time_s" not in table.columns or position is None:
        raise HexsimError(f"log {name!r} needs time_s and a position_m column for each leg: see measured-log columns")
    time = column("time_s")
    if len(time) < 3:
        raise HexsimError(f"log {name!r} has {len(time)} rows: give at least a second of data")
    return MeasuredLog(
        name=name,
        time=time,
        rate=float(round((len(time) - 1) / (time[-1] - time[0]), 6)),
        setpoint=rows("setpoint", "m"),
        position=position,
        volts=rows("valve", "V"),
        pressure=rows("pressure_bottom", "Pa"),
        supply=column("pressure_supply_Pa") if "pressure_supply_Pa" in table.columns else None,
        acceleration=vector("acceleration", "m_s2"),
        angular=vector("angular_acceleration", "rad_s2") if n_legs > 1 else None,
    )
