"""Ordinary dirt for clean logs: what loggers of real machines do to their files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl
from scipy.interpolate import make_interp_spline

Dirt = Callable[[pl.DataFrame, np.random.Generator], pl.DataFrame]


def empty_cells(table: pl.DataFrame, rng: np.random.Generator, count: int = 20) -> pl.DataFrame:
    """So many cells of every column but the time are empty."""
    columns = []
    for name in table.columns:
        values = table[name].to_numpy().astype(float).copy()
        if name != "time_s":
            values[rng.choice(np.arange(50, len(values) - 50), count, replace=False)] = np.nan
        columns.append(pl.Series(name, values).fill_nan(None))
    return pl.DataFrame(columns)


def missing_rows(table: pl.DataFrame, rng: np.random.Generator, count: int = 7) -> pl.DataFrame:
    """So many rows are missing at one place."""
    at = int(rng.integers(len(table) // 4, len(table) // 2))
    return pl.concat([table[:at], table[at + count :]])


def stamp_jitter(table: pl.DataFrame, rng: np.random.Generator, size_s: float = 4e-4) -> pl.DataFrame:
    """The samples are even, their time stamps are off by noise (one standard deviation)."""
    return table.with_columns(time_s=pl.col("time_s") + pl.Series(size_s * rng.standard_normal(len(table))))


def sampling_jitter(table: pl.DataFrame, rng: np.random.Generator, size_s: float = 2e-4) -> pl.DataFrame:
    """The samples are really taken off their grid, and their stamps say so. Noise between samples is interpolated too."""
    time = table["time_s"].to_numpy()
    real = np.clip(time + size_s * np.clip(rng.standard_normal(len(time)), -2, 2), time[0], time[-1])
    own = {}
    for name in table.columns:
        values = table[name].to_numpy()
        held = name.startswith(("setpoint", "valve"))
        last = np.clip(np.searchsorted(time, real + 1e-9, side="right") - 1, 0, len(time) - 1)
        own[name] = values[last] if held else make_interp_spline(time, values, k=3)(real)
    return pl.DataFrame(own | {"time_s": real})


def coarse_stamps(
    table: pl.DataFrame, rng: np.random.Generator, step_s: float = 2e-3, down: bool = True
) -> pl.DataFrame:
    """Time stamps with a coarse resolution, cut off or rounded."""
    steps = table["time_s"].to_numpy() / step_s
    return table.with_columns(time_s=pl.Series((np.floor(steps + 1e-6) if down else np.round(steps)) * step_s))


def every(table: pl.DataFrame, rng: np.random.Generator, rows: int = 10) -> pl.DataFrame:
    """A slower logger: every tenth row of 1 kHz is 100 Hz."""
    return table[::rows]


def only(table: pl.DataFrame, *stems: str) -> pl.DataFrame:
    """Few channels."""
    return table.select([name for name in table.columns if name.startswith(("time_s", *stems))])


CASES: dict[str, Dirt] = {
    "clean": lambda table, rng: table,
    "20 empty cells a column": empty_cells,
    "200 empty cells a column": lambda table, rng: empty_cells(table, rng, 200),
    "7 missing rows": missing_rows,
    "300 missing rows": lambda table, rng: missing_rows(table, rng, 300),
    "stamps off by 0.05 ms": lambda table, rng: stamp_jitter(table, rng, 5e-5),
    "stamps off by 0.4 ms": stamp_jitter,
    "stamps off by 0.4 ms and 7 missing rows": lambda table, rng: stamp_jitter(missing_rows(table, rng), rng),
    "samples off by 0.1 ms": lambda table, rng: sampling_jitter(table, rng, 1e-4),
    "stamps cut to 2 ms": coarse_stamps,
    "stamps rounded to 2 ms": lambda table, rng: coarse_stamps(table, rng, down=False),
    "stamps cut to 10 ms": lambda table, rng: coarse_stamps(table, rng, 1e-2),
    "100 Hz": every,
    "250 Hz": lambda table, rng: every(table, rng, 4),
    "position and volts": lambda table, rng: only(table, "position", "valve"),
    "position and setpoint and volts": lambda table, rng: only(table, "position", "setpoint", "valve"),
    "position and setpoint": lambda table, rng: only(table, "position", "setpoint"),
}
