"""Setpoints from a foreign FMU: an output of it over time, simulated by FMPy before the run.

[axes.z]
kind = "fmu"
path = "sea.fmu"
column = "heave"        # its output
factor = 0.05

The FMU starts from its own values and takes nothing from the machine; one that does is a payload (`--payload`). It is
native code: use those of people whom you trust.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from hexsim.declaration import between
from hexsim.errors import HexsimError, shortened
from hexsim.setpoints.signal import Array, Duration
from hexsim.setpoints.signal_file import SampledSignal


@dataclass(frozen=True, kw_only=True)
class FmuSignal(SampledSignal):
    """Output `column` of an FMU for co-simulation (2.0 or 3.0), times factor, in m or rad.

    duration_s: how long it is simulated; its last value is held then. sample_s: its communication step.
    Raises HexsimError where FMPy is missing, the FMU cannot be simulated, or has no such output.
    """

    kind: ClassVar[str] = "fmu"
    factor: Annotated[float, between(-1e6, 1e6, "setpoint over output")] = 1.0
    duration_s: Duration = 20.0
    sample_s: Annotated[float, between(1e-4, 1.0, "[s]")] = 0.002

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        try:
            import fmpy
        except ImportError:
            raise HexsimError("a setpoint from an FMU needs FMPy: pip install 'hexsim[fmu]'") from None
        try:
            variables = fmpy.read_model_description(self.path).modelVariables
            outputs = [v.name for v in variables if v.causality == "output" and v.type in ("Real", "Float64")]
            found = None
            if self.column in outputs:
                found = fmpy.simulate_fmu(
                    self.path, stop_time=self.duration_s, output_interval=self.sample_s, output=[self.column],
                    fmi_type="CoSimulation",
                )  # fmt: skip
        except Exception as error:  # FMPy raises many kinds on foreign files
            raise self.refuse("path", f"cannot be simulated: {shortened(str(error), 200)}") from None
        if found is None:
            raise self.refuse("column", f"its outputs are {', '.join(outputs) or 'none'}")
        time, first = np.unique(np.asarray(found["time"], dtype=float), return_index=True)
        values = self.factor * np.asarray(found[self.column], dtype=float)[first]
        if len(time) < 2 or not np.isfinite(values).all():
            raise self.refuse(
                "path", f"gives {len(time)} samples of {self.column}, which must be two or more, and finite"
            )
        return time, values
