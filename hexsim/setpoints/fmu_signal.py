"""Setpoints from a foreign FMU: an output of it over time, simulated before the run in a process of its own.

[axes.z]
kind = "fmu"
path = "sea.fmu"
column = "heave"        # its output
factor = 0.05

The FMU starts from its own values and takes nothing from the machine; one that does is a payload (`--payload`). It is
native code, which runs only with `--allow-native`: give it for FMUs of people whom you trust.
"""

from __future__ import annotations

import os
from dataclasses import InitVar, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from hexsim.declaration import between
from hexsim.errors import HexsimError
from hexsim.foreign_fmu import ForeignFmu
from hexsim.setpoints.signal import Array, Duration
from hexsim.setpoints.signal_file import SampledSignal


@dataclass(frozen=True, kw_only=True)
class FmuSignal(SampledSignal):
    """Output `column` of an FMU for co-simulation (2.0 or 3.0), times factor, in m or rad.

    duration_s: how long it is simulated; its last value is held then. sample_s: its communication step.
    allow_native: the user trusts its code; it is no part of a scenario's file.
    Raises HexsimError without that, where FMPy is missing, the FMU cannot be simulated, or has no such output.
    """

    kind: ClassVar[str] = "fmu"
    _is_allowed: ClassVar[bool] = False  # until one is made that may run
    factor: Annotated[float, between(-1e6, 1e6, "setpoint over output")] = 1.0
    duration_s: Duration = 20.0
    sample_s: Annotated[float, between(1e-4, 1.0, "[s]")] = 0.002
    allow_native: InitVar[bool] = False

    def __post_init__(self, allow_native: bool) -> None:  # type: ignore[override]
        object.__setattr__(self, "_is_allowed", allow_native)
        super().__post_init__()

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        if self.duration_s / self.sample_s > 1e6:  # minutes of an FMU that is stepped through a process
            raise self.refuse("sample_s", f"gives more than a million steps in {self.duration_s:g} s")
        if not self._is_allowed or not os.path.isfile(self.path):
            ForeignFmu(Path(self.path), allow_native=self._is_allowed)  # says why
        state = os.stat(self.path)
        time, values = _simulated(
            self.path, self.column, self.duration_s, self.sample_s, (state.st_mtime_ns, state.st_size)
        )
        if not np.isfinite(self.factor * values).all():
            raise self.refuse("path", f"gives values of {self.column} that are not finite")
        return time, self.factor * values


@lru_cache(maxsize=8)  # a scenario is made several times on its way to a run
def _simulated(
    path: str, column: str, duration_s: float, sample_s: float, version: tuple[int, int]
) -> tuple[Array, Array]:
    fmu = ForeignFmu(Path(path), allow_native=True)
    try:
        outputs = [name for name, (_, causality) in fmu.variables.items() if causality == "output"]
        if column not in outputs:
            raise HexsimError(f"{path} has no output {column!r}: its outputs are {', '.join(outputs[:20]) or 'none'}")
        time = np.arange(max(2, round(duration_s / sample_s) + 1)) * sample_s
        values = [fmu.start([], [fmu.variables[column][0]])[0]]
        values += [fmu.step(float(at), sample_s, [])[0] for at in time[:-1]]
    finally:
        fmu.close()
    return time.astype(np.float64), np.array(values)
