"""Ticks of a run without faults in compiled code: plain control without Python at all, a compensated one with Python at control
ticks alone."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hexsim.compiled import allocating, by_address
from hexsim.hydraulics import chamber
from hexsim.motion_computer import controller
from hexsim.motion_computer.controller import C, Control
from hexsim.plant.callbacks import MPa
from hexsim.plant.stepping import advance, apply_valve_delay_and_hysteresis, copy, sense
from hexsim.sensors.bank import measure

Array = NDArray[np.float64]
# of what it needs, and a tick's number; not 0: the run ends before that tick
CONTROL: Any = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int64)


class Transducer(NamedTuple):
    """Noise (ticks, n_legs), gain, offset and one count (n_legs,)."""

    noise: Array
    gain: Array
    offset: Array
    resolution: Array


class PlainLoop(NamedTuple):
    """What controllers without compensators need to run without Python, and what others need beside."""

    setpoints: Array  # (control ticks, n_legs)
    every: int  # ticks between control ticks
    control: Control
    memory: Array
    position: Transducer
    bottom: Transducer
    top: Transducer
    bottom_places: NDArray[np.int64]  # of the pressures in the plant's states
    top_places: NDArray[np.int64]  # empty without pressure feedback from the rod sides
    asks: int  # address of a CONTROL that leaves the volts of a control tick in `volts`; 0: the controllers alone
    needs: int  # address of what it needs
    volts: Array  # (n_legs,) at the valves
    added: Array  # (n_legs,) of them by compensators
    pressures: Array  # (ticks, n_legs) true ones, written down before CONTROL is asked; (0, n_legs): nobody asks
    rod_sides: Array  # the same of rod sides on a valve
    rod_side_places: NDArray[np.int64]
    compensation: Array  # (ticks, n_legs) of `added`
    given: Array  # (ticks, n_legs) volts at the spools of ticks done again; (0, n_legs): control


@allocating
def pressures(context, sensor, places, k):
    """What the transducers of chambers read at tick k (n_legs,) [Pa]."""
    true = np.empty(places.shape[0])
    for i in range(places.shape[0]):
        true[i] = chamber.pressure(context.act[places[i]] * MPa)
    return measure(true, sensor.noise[k], sensor.gain, sensor.offset, sensor.resolution)


@allocating
def load_pressures(context, loop, k):
    """p = P1 - P2 A2/A1 (n_legs,) as it is read at tick k [Pa]."""
    load = pressures(context, loop.bottom, loop.bottom_places, k)
    if loop.top_places.shape[0] > 0:
        top = pressures(context, loop.top, loop.top_places, k)
        for i in range(load.shape[0]):
            load[i] -= loop.control.rows[i, C.AREA_RATIO] * top[i]
    return load


@intrinsic  # type: ignore[misc]
def call_control(typingctx: Any, address: Any, needs: Any, tick: Any) -> Any:  # type: ignore[misc]
    """Call a CONTROL at an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.IntType(32), [word, word])
        return builder.call(builder.inttoptr(args[0], ir.PointerType(kind)), [args[1], args[2]])

    return types.int32(types.uintp, types.uintp, types.int64), codegen


@allocating
def true_pressures(context, places, out):
    """Pressures of chambers into out (n_legs,) [Pa]."""
    for i in range(out.shape[0]):
        out[i] = chamber.pressure(context.act[places[i]] * MPa)


@allocating
def ask(context, loop, k):
    """Let the CONTROL of a compensated run see tick k. Returns whether the run goes on."""
    true_pressures(context, loop.bottom_places, loop.pressures[k])
    if loop.rod_sides.shape[0] > 0:
        true_pressures(context, loop.rod_side_places, loop.rod_sides[k])
    if k % loop.every == 0 and call_control(loop.asks, loop.needs, k) != 0:  # pyright: ignore[reportCallIssue]
        return False
    copy(loop.compensation[k], loop.added)
    return True


@allocating
def plain_control(context, record, loop, k, load):
    """Volts of control tick k by the controllers alone, into `loop.volts`. load (n_legs,) takes what pressure feedback reads."""
    sensor = loop.position
    measured = measure(record.positions[k], sensor.noise[k], sensor.gain, sensor.offset, sensor.resolution)
    if loop.control.rows[0, C.PRESSURE_GAIN] > 0.0:
        copy(load, load_pressures(context, loop, k))
    setpoint = loop.setpoints[k // loop.every]
    if k == 0:
        controller.begin(loop.control, loop.memory, setpoint, measured, load)
    controller.tick(loop.control, loop.memory, setpoint, measured, load, loop.volts)


@allocating
def run_ticks(context, record, loop, first, last):
    """Ticks first..last - 1. Returns how many ticks are done, of the whole run."""
    context, record, loop = by_address(context), by_address(record), by_address(loop)
    load = np.zeros(loop.memory.shape[0])
    again = loop.given.shape[0] > 0
    for k in range(first, last):
        if again:
            copy(context.spool_volts, loop.given[k])
        else:
            sense(context, record)
            if loop.asks == 0:
                if k % loop.every == 0:
                    plain_control(context, record, loop, k, load)
            elif not ask(context, loop, k):
                return k
            apply_valve_delay_and_hysteresis(context, record, loop.volts)
        advance(
            context, record, context.is_tendon and not again
        )  # once: all that is below it is compiled into this function
    return last
