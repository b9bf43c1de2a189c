"""Plain proportional control without Python in between: the fast path of a run without compensators or faults."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import borrowed, compiled
from hexsim.motion_computer.position_loop import proportional
from hexsim.plant.stepping import sense, tick
from hexsim.sensors.bank import measure

Array = NDArray[np.float64]


class Control(NamedTuple):
    """Plain proportional control: what it needs to run without Python."""

    setpoints: Array  # (control ticks, n_legs)
    every: int  # ticks between control ticks
    gain: float
    limit: float
    noise: Array
    sensor_gain: Array
    sensor_offset: Array
    resolution: float


@compiled
def run_plain(context, record, control, first, last):
    """Ticks first..last - 1 under proportional control, without Python in between."""
    context, record, control = borrowed(context), borrowed(record), borrowed(control)
    volts = record.volts[max(first - 1, 0)].copy()
    for k in range(first, last):
        sense(context, record)
        if k % control.every == 0:
            measured = measure(
                record.positions[k], control.noise[k], control.sensor_gain, control.sensor_offset, control.resolution
            )
            volts = proportional(control.setpoints[k // control.every], measured, control.gain, control.limit)
        tick(context, record, volts, context.is_tendon)
