"""Plain proportional control without Python in between: the fast path of a run without compensators or faults."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.motion_computer.position_loop import proportional
from hexsim.plant.stepping import advance, sense, shape
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
def run_plain(machine, record, control, first, last):
    """Ticks first..last - 1 under proportional control, without Python in between."""
    for tick in range(first, last):
        sense(machine, record, tick)
        if tick % control.every == 0:
            measured = measure(
                record.positions[tick], control.noise[tick], control.sensor_gain, control.sensor_offset,
                control.resolution,
            )  # fmt: skip
            record.volts[tick] = proportional(
                control.setpoints[tick // control.every], measured, control.gain, control.limit
            )
        else:
            record.volts[tick] = record.volts[tick - 1]
        shape(machine, record, tick)
        advance(machine, record, tick)
