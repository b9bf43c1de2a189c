# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""The inner loop, compiled: write the state down, hand the volts to MuJoCo, step, tick after tick.

MuJoCo's own functions are called by their addresses, so that the loop is cached between sessions and needs no Python:
a control tick in Python costs as much as the whole of the hydraulics.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics import valve
from hexsim.hydraulics.parameters import P
from hexsim.plant.plant import Plant

Array = NDArray[np.float64]


@intrinsic
def _call(typingctx, address, model, data):
    """Call void f(mjModel*, mjData*) at an address."""
    signature = types.void(types.uintp, types.uintp, types.uintp)

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        function = ir.PointerType(ir.FunctionType(ir.VoidType(), [word, word]))
        builder.call(builder.inttoptr(args[0], function), [args[1], args[2]])
        return context.get_dummy_value()

    return signature, codegen


def _address(name: str) -> int:
    """Address of a function of the MuJoCo library that is already loaded."""
    library = ctypes.CDLL(mujoco._functions.__file__)
    return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0


class Machinery(NamedTuple):
    """What the loop calls and looks at. Views share MuJoCo's memory."""

    model: int
    data: int
    step: int
    forward: int
    kinematics: int
    tendon: int
    is_tendon: bool
    is_fast: bool
    steps: int  # time steps a tick
    tick_s: float
    qpos: Array
    qvel: Array
    qacc: Array
    act: Array
    ctrl: Array
    lengths: Array  # of the tendons, or empty
    slides: NDArray[np.int64]  # places of the slide joints in qpos, or empty
    offsets: Array  # length at full retraction (n_legs,)
    hysteresis: Array  # [V]
    delay: NDArray[np.int64]  # [ticks]
    middle: Array  # velocities (nv,) in the middle of the tick before


class Record(NamedTuple):
    """What a run writes down, one row a tick."""

    positions: Array
    qpos: Array
    qvel: Array
    qacc: Array  # of the instant
    mean_acceleration: Array  # over one tick about it
    act: Array
    volts: Array  # commanded
    spool_volts: Array  # after delay, backlash and faults


def machinery(plant: Plant, steps: int, tick_s: float) -> Machinery:
    """The loop's view of a plant; `steps` time steps a tick of `tick_s`."""
    model, data, rows = plant.model, plant.data, plant.rows
    return Machinery(
        model=model._address, data=data._address,
        step=_address("mj_step"), forward=_address("mj_forward"),
        kinematics=_address("mj_kinematics"), tendon=_address("mj_tendon"),
        is_tendon=plant.is_tendon, is_fast=plant.scheme == "fast", steps=steps, tick_s=tick_s,
        qpos=data.qpos, qvel=data.qvel, qacc=data.qacc, act=data.act, ctrl=data.ctrl,
        lengths=data.ten_length, slides=np.zeros(0, np.int64) if plant.is_tendon else plant.slides.astype(np.int64),
        offsets=np.ascontiguousarray(rows[:, P.LENGTH_OFFSET]),
        hysteresis=np.ascontiguousarray(rows[:, P.HYSTERESIS]),
        delay=np.rint(rows[:, P.VALVE_DELAY] / tick_s).astype(np.int64),
        middle=data.qvel.copy(),
    )  # fmt: skip


def new_record(plant: Plant, ticks: int) -> Record:
    """Empty rows for `ticks` ticks."""
    model, n = plant.model, plant.n_legs
    widths = (n, model.nq, model.nv, model.nv, model.nv, model.na, n, n)
    return Record(*(np.zeros((ticks, width)) for width in widths))


@compiled
def sense(machine, record, tick):
    """Write down the piston positions of the present state."""
    if machine.is_tendon:
        _call(machine.kinematics, machine.model, machine.data)
        _call(machine.tendon, machine.model, machine.data)
        record.positions[tick] = machine.lengths - machine.offsets
    else:
        for i in range(machine.slides.shape[0]):
            record.positions[tick, i] = machine.qpos[machine.slides[i]] - machine.offsets[i]


@compiled
def shape(machine, record, tick):
    """Volts at the spool: after the valve's delay and backlash."""
    for i in range(machine.offsets.shape[0]):
        held = record.spool_volts[tick - 1, i] if tick > 0 else 0.0
        command = record.volts[max(tick - machine.delay[i], 0), i]
        record.spool_volts[tick, i] = valve.play(command, held, machine.hysteresis[i])


@compiled
def _keep_mean(machine, record, tick, half):
    """Mean acceleration between the middles of the tick before and of this one; of half a tick at the start."""
    span = machine.tick_s
    if tick == 0:
        span *= half / machine.steps
        machine.middle[:] = record.qvel[0]
    record.mean_acceleration[tick] = (machine.qvel - machine.middle) / span
    machine.middle[:] = machine.qvel


@compiled
def advance(machine, record, tick):
    """Write the state down, set the volts of `record.spool_volts[tick]` and step to the next tick.

    Two accelerations are kept. `qacc` is the instant's, which a sensor without filter samples: Euler leaves in it what it
    began its step with, RK4 needs an evaluation. `mean_acceleration` is the mean over one tick about the instant, from the
    velocities in the middle of the ticks before and after: figures in a band need it, because samples of the instant alias
    (the friction jolt of a 40 kg leg is a pulse of 1 ms, and reads twice as much in the 50 Hz band).
    """
    for i in range(machine.offsets.shape[0]):
        machine.ctrl[i] = record.spool_volts[tick, i]
    record.qpos[tick] = machine.qpos
    record.qvel[tick] = machine.qvel
    record.act[tick] = machine.act
    if not machine.is_fast:
        _call(machine.forward, machine.model, machine.data)
        record.qacc[tick] = machine.qacc
    half = machine.steps // 2
    for k in range(machine.steps):
        if k == half and half > 0:
            _keep_mean(machine, record, tick, half)
        _call(machine.step, machine.model, machine.data)
        if machine.is_fast and k == 0:
            record.qacc[tick] = machine.qacc
    if half == 0:  # one time step a tick: the instant is the tick
        record.mean_acceleration[tick] = record.qacc[tick]
