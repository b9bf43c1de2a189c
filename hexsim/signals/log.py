"""A log: the columns of one run, measured or simulated, and its signals as arrays with one row a leg or axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import polars as pl
import scipy

from hexsim.errors import HexsimError
from hexsim.signals.table import table
from hexsim.signals.weak_form import Window

Array = np.ndarray
Kind = Literal["bench", "hexapod", "own"]
N_LEGS: dict[str, int] = {"bench": 1, "hexapod": 6, "own": 0}
ATTRIBUTES = {
    "volts": "valve",
    "pressure": "pressure_bottom",
    "supply": "pressure_supply",
    "angular": "angular_acceleration",
}


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class Log:
    """One run in SI units on a uniform time base.

    kind: "bench" (one leg), "hexapod" (six) or "own" (a machine of other columns). time: (n,) [s]. rate [Hz].
    columns: name -> (n,). losses: what a reader dropped, filled or converted, a sentence each.
    repaired: name -> (n,) bool, samples that were missing and filled; a column without such samples is not there.
    They weigh nothing in a fit. sampled: name -> places (m,) of its samples, in points of the log, of columns with fewer of
    them than it has; between them is a spline (`readers.one_grid.as_read`). offset_s: time from the beginning of its run to its first
    sample, of a part of a run.
    loaded: was the machine's additional mass on it?
    Signals may be given as arrays by their stem or attribute (`position=...`), and so they can be exchanged:
    `dataclasses.replace(log, volts=other)`; rows are legs or axes, (n_rows, n), or (n,) for one of the machine.
    """

    name: str
    kind: Kind
    time: Array
    rate: float
    columns: Mapping[str, Array]
    losses: tuple[str, ...]
    repaired: Mapping[str, Array]
    sampled: Mapping[str, Array]
    path: Path | None
    offset_s: float
    loaded: bool

    def __init__(
        self,
        *,
        name: str,
        kind: Kind,
        time: Array,
        rate: float | None = None,
        columns: Mapping[str, Array] | None = None,
        losses: tuple[str, ...] = (),
        repaired: Mapping[str, Array] | None = None,
        sampled: Mapping[str, Array] | None = None,
        path: Path | None = None,
        offset_s: float = 0.0,
        loaded: bool = False,
        **signals: Array | None,
    ) -> None:
        own = dict(columns or {})
        for key, rows in signals.items():
            names = table()[ATTRIBUTES.get(key, key)].columns(N_LEGS[kind])
            if rows is None:
                own = {column: values for column, values in own.items() if column not in names}
            else:
                own |= zip(names, np.atleast_2d(rows), strict=True)
        given = {
            "name": name,
            "kind": kind,
            "time": time,
            "columns": own,
            "losses": tuple(losses),
            "path": path,
            "repaired": dict(repaired or {}),
            "sampled": dict(sampled or {}),
            "rate": _rate_of(name, time) if rate is None else rate,
            "offset_s": offset_s,
            "loaded": loaded,
        }
        for key, value in given.items():
            object.__setattr__(self, key, value)

    @classmethod
    def of_table(cls, name: str, columns: pl.DataFrame, kind: Kind) -> Log:
        """A run whose table has time_s and columns in SI units. Raises HexsimError without time, or with two rows."""
        if "time_s" not in columns.columns:
            raise HexsimError(f"the log of {name!r} has no column time_s; columns are {', '.join(columns.columns)}")
        arrays = {key: np.ascontiguousarray(columns[key].to_numpy(), dtype=float) for key in columns.columns}
        return cls(name=name, kind=kind, time=arrays.pop("time_s"), columns=arrays)

    @property
    def table(self) -> pl.DataFrame:
        """The same as a table, time_s first."""
        return pl.DataFrame({"time_s": self.time, **self.columns})

    @property
    def n(self) -> int:
        return self.time.shape[0]

    @property
    def n_legs(self) -> int:
        return N_LEGS[self.kind]

    @property
    def duration_s(self) -> float:
        return float(self.time[-1] - self.time[0])

    def signal(self, *stems: str) -> Array | None:
        """The first of these signals that the log holds whole: (n,) of the machine, else (n_rows, n)."""
        return next((rows for stem in stems if (rows := self._rows(stem)) is not None), None)

    def _rows(self, stem: str) -> Array | None:
        if stem not in self._views:
            signal = table()[stem]
            names = signal.columns(self.n_legs)
            rows = None
            if names and all(name in self.columns for name in names):
                rows = np.stack([self.columns[name] for name in names])
                rows = rows[0] if signal.scope == "machine" else rows
            self._views[stem] = rows
        return self._views[stem]

    @cached_property
    def _views(self) -> dict[str, Array | None]:
        return {}

    def names(self, stem: str) -> list[str]:
        """Columns of a signal that the log holds."""
        return [name for name in table()[stem].columns(self.n_legs) if name in self.columns]

    @property
    def setpoint(self) -> Array | None:
        """(n_legs, n) [m]."""
        return self._rows("setpoint")

    @property
    def position(self) -> Array:
        """(n_legs, n) [m]. Raises HexsimError where a leg has none."""
        rows = self._rows("position")
        if rows is None:
            raise HexsimError(f"log {self.name!r} needs time_s and a position_m column for each leg")
        return rows

    @property
    def volts(self) -> Array | None:
        """Valve voltages (n_legs, n)."""
        return self._rows("valve")

    @property
    def pressure(self) -> Array | None:
        """Chamber pressures (n_legs, n) [Pa]."""
        return self._rows("pressure_bottom")

    @property
    def supply(self) -> Array | None:
        """Supply pressure (n,) [Pa]."""
        return self._rows("pressure_supply")

    @property
    def acceleration(self) -> Array | None:
        """(1, n) along the leg of a bench, (3, n) of a platform [m/s2]."""
        return self._rows("acceleration")

    @property
    def angular(self) -> Array | None:
        """Angular acceleration of a platform (3, n) [rad/s2]."""
        return self._rows("angular_acceleration")

    @cached_property
    def near_rest(self) -> Array:
        """Is any leg near a standstill, by its measured position? (n,) bool. Where fits follow the ring of a reversal."""
        rest_m_s = 0.015  # 3 Stribeck velocities: friction is stiff below, or falls with speed
        return np.any(np.abs(Window(self.rate).rate(self.position)) < rest_m_s, axis=0)

    @cached_property
    def crossover_rad_s(self) -> float:
        """Of the position loops: least squares of velocity = crossover * (setpoint - position). 0 without a setpoint."""
        if self.setpoint is None:
            return 0.0
        error, velocity = self.setpoint - self.position, Window(self.rate).rate(self.position)
        return max(float(np.sum(velocity * error)) / (float(np.sum(error**2)) or 1.0), 0.0)

    @cached_property
    def run_time(self) -> Array:
        """Time since the run began (n,) [s]."""
        return self.time - self.time[0] + self.offset_s

    def tick_phase(self, every: int) -> int:
        """First sample of a controller's tick, of `every` samples each, by where held volts and setpoints change; 0 unseen."""
        if every < 2:
            return 0
        held = [self.columns[name] for stem in ("valve", "setpoint") for name in self.names(stem)]
        changes = [np.flatnonzero(np.diff(x)) + 1 for x in held]
        counts = np.sum([np.bincount(at % every, minlength=every) for at in changes], axis=0) if changes else [0]
        return int(np.argmax(counts))

    def finer(self, factor: int) -> Log:
        """The run with `factor` samples for each: smooth signals on a quintic spline, volts held. Made once.

        What is faster than half the log's rate is not in it.
        """
        key = f"finer {factor}"
        if key not in self._finer:
            n, held = np.arange(self.n), {name for name in self.names("valve")}
            at = np.arange(self.n * factor) / factor
            columns = {
                name: np.repeat(x, factor)
                if name in held
                else scipy.interpolate.make_interp_spline(n, x, k=5)(np.minimum(at, n[-1]))
                for name, x in self.columns.items()
            }
            time = self.time[0] + at / self.rate
            self._finer[key] = replace(
                self, time=time, rate=self.rate * factor, columns=columns, repaired={}, sampled={}
            )
        return self._finer[key]

    @cached_property
    def _finer(self) -> dict[str, Log]:
        return {}

    def weight(self, name: str) -> Array:
        """What the points of a column weigh in a fit (n,): 1; samples a point where it is a spline; 0 where repaired."""
        there = np.logical_not(self.repaired.get(name, np.zeros(self.n, dtype=bool)))
        if name not in self.sampled:
            return there.astype(float)
        at = self.sampled[name]
        steps = np.searchsorted(at, np.arange(self.n), side="right")
        return there / np.maximum(np.diff(at), 1.0)[np.clip(steps - 1, 0, len(at) - 2)]

    def rate_of(self, name: str) -> float:
        """Samples a second of a column [Hz]."""
        return self.rate * len(self.sampled.get(name, self.time)) / self.n

    def whole(self, reach_s: float, longest: int) -> Array:
        """Samples (n,) bool further than reach_s from every repaired stretch of more than `longest` samples."""
        reach, bad = round(reach_s * self.rate), np.zeros(self.n, dtype=bool)
        for marks in self.repaired.values():
            bad |= scipy.ndimage.binary_opening(marks, np.ones(longest + 1))
        return np.logical_not(scipy.ndimage.maximum_filter1d(bad, 2 * reach + 1) if bad.any() else bad)

    def part(self, rows: slice, **changes: Any) -> Log:
        """Some of the samples, with other fields changed."""
        cut: dict[str, Any] = {
            key: {name: np.ascontiguousarray(values[rows]) for name, values in getattr(self, key).items()}
            for key in ("columns", "repaired")
        }
        cut["repaired"] = {name: marks for name, marks in cut["repaired"].items() if marks.any()}
        first, last = rows.start or 0, len(self.time[rows]) - 1
        sampled = {name: at[(at >= first) & (at <= first + last)] - first for name, at in self.sampled.items()}
        cut["sampled"] = {name: at for name, at in sampled.items() if len(at) > 1}
        cut["offset_s"] = self.offset_s + (rows.start or 0) / self.rate
        return replace(self, time=np.ascontiguousarray(self.time[rows]), **cut, **changes)

    def head(self, duration_s: float) -> Log:
        """The first seconds."""
        return self.part(slice(0, min(int(duration_s * self.rate), self.n)))


def _rate_of(name: str, time: Array) -> float:
    if len(time) < 2:
        raise HexsimError(f"the log of {name!r} has {len(time)} rows; two at least are needed")
    return float(round((len(time) - 1) / (time[-1] - time[0]), 6))
