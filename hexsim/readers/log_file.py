"""What a reader gives: a clean table in SI units on one uniform time base, and every loss on the way as a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

BENCH_COLUMNS = ("setpoint_m", "position_m", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "acceleration_m_s2")
LEG_COLUMNS = ("setpoint_{}_m", "position_{}_m", "valve_{}_V", "pressure_bottom_{}_Pa")
PLATFORM_COLUMNS = (
    "pressure_supply_Pa",
    *(f"acceleration_{axis}_m_s2" for axis in "xyz"),
    *(f"angular_acceleration_{axis}_rad_s2" for axis in "xyz"),
)
HEXAPOD_COLUMNS = (*(name.format(leg) for name in LEG_COLUMNS for leg in range(1, 7)), *PLATFORM_COLUMNS)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogFile:
    """One run as read.

    time_s: (n,) uniform [s]; columns: name with SI unit -> (n,) finite values; losses: what was dropped, filled or
    converted; kind: "bench" (n_legs 1), "hexapod" (n_legs 6) or "own" (n_legs 0, columns of the mapping file).
    """

    name: str
    path: Path
    time_s: np.ndarray
    rate_Hz: float
    columns: dict[str, np.ndarray]
    losses: tuple[str, ...]
    kind: str

    @property
    def n_legs(self) -> int:
        return {"bench": 1, "hexapod": 6}.get(self.kind, 0)

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def table(self) -> pl.DataFrame:
        """The same as a table, time_s first."""
        return pl.DataFrame({"time_s": self.time_s, **self.columns})


def log_name(path: Path) -> str:
    """fit.csv.gz -> fit."""
    name = path.name
    for ending in (".gz", ".csv", ".txt", ".exp", ".parquet", ".mat", ".mf4", ".mdf"):
        name = name.removesuffix(ending)
    return name
