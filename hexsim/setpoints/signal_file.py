"""Setpoints from a user's file, in any format of a log, one row a sample, refused with row and column where they make no sense.

Columns: `time_s`, then any of x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad (DOF mode), or setpoint_i_m for every leg
i = 1..n, or setpoint_m on the bench (actuator mode: piston position, 0 at full retraction). A log of a run can be
played back: its other columns are left aside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hexsim.errors import HexsimError
from hexsim.readers.files import raw_log, readers, suffix_of
from hexsim.readers.reader import RawLog, RawSignal
from hexsim.setpoints.signal import Array, Signal
from hexsim.signals.signal import HEXAPOD_AXES
from hexsim.signals.table import SETPOINT

DOF_COLUMNS = tuple(f"{axis}_{'m' if axis in 'xyz' else 'rad'}" for axis in HEXAPOD_AXES)
LEG_COLUMNS, (BENCH_COLUMN,) = SETPOINT.columns(6), SETPOINT.columns(1)


def read_setpoint_file(path: str | Path) -> dict[str, Array]:
    """`time_s` and the setpoint columns of a file, each (n,), checked.

    Rows in messages count from 1 after the header. Raises HexsimError if the file cannot be read, a column is
    missing or not a number, a value is NaN or infinite, or time stamps repeat or run backwards.
    """
    path = Path(path)
    raw = _read_table(path)
    signals = {signal.short: signal for signal in raw.signals}
    names = list(signals)
    chosen = {name: signals[name] for name in _setpoint_columns(path, names)}
    chosen = {"time_s": _time_of(path, signals, list(chosen.values()))} | chosen
    columns = {name: signal.values for name, signal in chosen.items()}
    for name, values in columns.items():
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            odd, text = chosen[name].odd or (row, str(values[row]))
            given = text if odd == row else str(values[row])
            raise HexsimError(f"{path}: row {row + 1}, column {name}: {given} is not a finite number.")
    if raw.rows_lost:
        raise HexsimError(f"{path}: {raw.losses[0]}; setpoints must be whole.")
    steps = np.diff(columns["time_s"])
    if len(steps) < 1:
        raise HexsimError(f"{path}: {len(columns['time_s'])} rows; setpoints need at least two.")
    if not np.all(steps > 0.0):
        row = int(np.argmax(~(steps > 0.0)))
        before, after = columns["time_s"][row], columns["time_s"][row + 1]
        what = "repeats the time stamp before it" if after == before else "is earlier than the row before it"
        raise HexsimError(
            f"{path}: row {row + 2}, column time_s: {after:g} s {what} ({before:g} s); time stamps must increase."
        )
    return columns


def _time_of(path: Path, signals: dict[str, RawSignal], chosen: list[RawSignal]) -> RawSignal:
    """The column of time, or the stamps that all setpoints share."""
    stamps = [next(iter(one.stamps.values()), None) for one in chosen]
    if stamps[0] is not None and all(one is stamps[0] for one in stamps):
        return RawSignal(name="time_s", values=stamps[0])
    if "time_s" not in signals:
        raise HexsimError(f"{path}: no column time_s; it has {', '.join(signals)}.")
    return signals["time_s"]


def _read_table(path: Path) -> RawLog:
    """By the readers of logs, which take any format of theirs."""
    if not path.is_file():
        raise HexsimError(f"{path}: no such setpoint file; give a .csv, .csv.gz or .parquet file.")
    if suffix_of(path) not in readers():
        raise HexsimError(
            f"{path}: unknown kind of file; give a .csv, .csv.gz or .parquet file, or another of {', '.join(readers())}."
        )
    try:
        return raw_log(path)
    except HexsimError as error:
        raise HexsimError(f"{path}: cannot be read as a table ({error}).") from None


def _setpoint_columns(path: Path, names: list[str]) -> list[str]:
    """The setpoint columns, of one mode."""
    dofs = [name for name in DOF_COLUMNS if name in names]
    legs = [name for name in LEG_COLUMNS if name in names]
    if dofs and legs:
        raise HexsimError(f"{path}: has both {dofs[0]} and {legs[0]}; give DOF setpoints or leg setpoints, not both.")
    if legs and len(legs) != len(LEG_COLUMNS):
        missing = [name for name in LEG_COLUMNS if name not in names]
        raise HexsimError(f"{path}: no column {missing[0]}; leg setpoints need all of {', '.join(LEG_COLUMNS)}.")
    found = dofs or legs or [name for name in (BENCH_COLUMN,) if name in names]
    if not found:
        raise HexsimError(
            f"{path}: no setpoint column; give any of {', '.join(DOF_COLUMNS)}, or {LEG_COLUMNS[0]} to "
            f"{LEG_COLUMNS[-1]}, or {BENCH_COLUMN} (bench); it has {', '.join(names)}."
        )
    return found


@dataclass(frozen=True, kw_only=True)
class SampledSignal(Signal):
    """One column of a setpoint file, held at its first and last value outside the file's time.

    interpolation: "cubic", a cubic spline with ends at rest in its first derivative: acceleration is continuous inside
    the file, but steps overshoot; "linear", straight lines: no overshoot, velocity jumps at the samples.
    time 0 of the signal is time 0 of the file.
    """

    kind: ClassVar[str] = "file"
    path: str
    column: str
    interpolation: Literal["cubic", "linear"] = "cubic"

    def __post_init__(self) -> None:
        if self.interpolation not in ("cubic", "linear"):
            raise self.refuse("interpolation", "allowed are 'cubic' and 'linear'")
        _ = self._samples

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        columns = read_setpoint_file(self.path)
        if self.column not in columns or self.column == "time_s":
            allowed = ", ".join(name for name in columns if name != "time_s")
            raise self.refuse("column", f"{self.path} has the setpoints {allowed}")
        return columns["time_s"], columns[self.column]

    @cached_property
    def _curve(self):

        time, values = self._samples
        if self.interpolation == "cubic":
            curve = scipy.interpolate.CubicSpline(time, values, bc_type="clamped")
        else:
            curve = scipy.interpolate.PPoly(np.stack([np.diff(values) / np.diff(time), values[:-1]]), time)
        return curve, curve.derivative(1), curve.derivative(2)

    def value(self, time_s: ArrayLike) -> Array:
        time, _ = self._samples
        return self._curve[0](np.clip(np.asarray(time_s, dtype=float), time[0], time[-1]))

    def _derivative(self, order: int, time_s: ArrayLike) -> Array:
        """Zero where the value is held."""
        (time, _), at = self._samples, np.asarray(time_s, dtype=float)
        inside = (at >= time[0]) & (at < time[-1])
        return np.where(inside, self._curve[order](np.clip(at, time[0], time[-1])), 0.0)

    def velocity(self, time_s: ArrayLike) -> Array:
        return self._derivative(1, time_s)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return self._derivative(2, time_s)
