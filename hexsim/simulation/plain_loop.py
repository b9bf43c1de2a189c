"""Plain control without Python in between: the fast path of a run without compensators or faults."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import by_address, compiled
from hexsim.hydraulics import chamber
from hexsim.motion_computer import controller
from hexsim.motion_computer.controller import C, Control
from hexsim.plant.callbacks import MPa
from hexsim.plant.stepping import sense, tick
from hexsim.sensors.bank import measure

Array = NDArray[np.float64]


class Transducer(NamedTuple):
    """Noise (ticks, n_legs), gain, offset and one count (n_legs,)."""

    noise: Array
    gain: Array
    offset: Array
    resolution: Array


class PlainLoop(NamedTuple):
    """Controllers without compensators: what they need to run without Python."""

    setpoints: Array  # (control ticks, n_legs)
    every: int  # ticks between control ticks
    control: Control
    memory: Array
    position: Transducer
    bottom: Transducer
    top: Transducer
    bottom_places: NDArray[np.int64]  # of the pressures in the plant's states
    top_places: NDArray[np.int64]  # empty without pressure feedback from the rod sides


@compiled
def pressures(context, sensor, places, k):
    """What the transducers of chambers read at tick k (n_legs,) [Pa]."""
    true = np.empty(places.shape[0])
    for i in range(places.shape[0]):
        true[i] = chamber.pressure(context.act[places[i]] * MPa)
    return measure(true, sensor.noise[k], sensor.gain, sensor.offset, sensor.resolution)


@compiled
def load_pressures(context, loop, k):
    """p = P1 - P2 A2/A1 (n_legs,) as it is read at tick k [Pa]."""
    load = pressures(context, loop.bottom, loop.bottom_places, k)
    if loop.top_places.shape[0] > 0:
        load -= loop.control.rows[:, C.AREA_RATIO] * pressures(context, loop.top, loop.top_places, k)
    return load


@compiled
def run_plain(context, record, loop, first, last):
    """Ticks first..last - 1 under the declared controllers, without Python in between."""
    context, record, loop = by_address(context), by_address(record), by_address(loop)
    sensor, n = loop.position, loop.memory.shape[0]
    volts, load = np.empty(n), np.zeros(n)
    volts[:] = record.volts[max(first - 1, 0)]
    feels_load = loop.control.rows[0, C.PRESSURE_GAIN] > 0.0
    for k in range(first, last):
        sense(context, record)
        if k % loop.every == 0:
            measured = measure(record.positions[k], sensor.noise[k], sensor.gain, sensor.offset, sensor.resolution)
            if feels_load:
                load = load_pressures(context, loop, k)
            setpoint = loop.setpoints[k // loop.every]
            if k == 0:
                controller.begin(loop.control, loop.memory, setpoint, measured, load)
            controller.tick(loop.control, loop.memory, setpoint, measured, load, volts)
        tick(context, record, volts, context.is_tendon)
