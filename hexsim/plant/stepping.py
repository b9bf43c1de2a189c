# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""One tick of the plant, compiled: the valve's delay and hysteresis, the state written down, the time steps.

MuJoCo's own functions are called by their addresses, so that the tick is cached between sessions and needs no Python:
a control tick in Python costs as much as the whole of the hydraulics.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics import valve
from hexsim.hydraulics.parameters import P
from hexsim.plant.structs import timestep_view

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


@cache
def _address(name: str) -> int:
    """Address of a function of the MuJoCo library that is already loaded."""
    library = ctypes.CDLL(mujoco._functions.__file__)
    return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0


class StepContext(NamedTuple):
    """What a tick calls and looks at. Views share MuJoCo's memory; arrays (1,) are numbers that change.

    Whoever chooses the steps of the next tick writes `steps` and timestep = tick_s/steps together.
    """

    model: int
    data: int
    step: int
    forward: int
    kinematics: int
    tendon: int
    is_tendon: bool
    is_fast: bool
    is_recorded: bool
    tick_s: float
    steps: NDArray[np.int64]  # (1,) time steps of a tick
    timestep: Array  # (1,) view of the model's [s]
    count: NDArray[np.int64]  # (1,) ticks done, and the row of the record to write
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
    past: Array  # volts of the last ticks (longest delay + 1, n_legs), a ring
    spool_volts: Array  # what reaches the spools (n_legs,)


class Record(NamedTuple):
    """What a run writes down, one row a tick."""

    positions: Array
    qpos: Array
    qvel: Array
    qacc: Array  # of the instant
    middle: Array  # velocities in the middle of the tick; see `mean_acceleration`
    act: Array
    volts: Array  # commanded
    spool_volts: Array  # after delay, backlash and faults
    steps: NDArray[np.int64]  # (m,) time steps of the tick


def step_context(plant: Any, tick_s: float, steps: int, is_recorded: bool) -> StepContext:
    """A plant's view for ticks of `tick_s` in `steps` time steps."""
    model, data, rows = plant.model, plant.data, plant.rows
    delay = np.rint(rows[:, P.VALVE_DELAY] / tick_s).astype(np.int64)
    return StepContext(
        model=model._address, data=data._address,
        step=_address("mj_step"), forward=_address("mj_forward"),
        kinematics=_address("mj_kinematics"), tendon=_address("mj_tendon"),
        is_tendon=plant.is_tendon, is_fast=plant.scheme == "fast", is_recorded=is_recorded, tick_s=tick_s,
        steps=np.array([steps]), timestep=timestep_view(model), count=np.zeros(1, np.int64),
        qpos=data.qpos, qvel=data.qvel, qacc=data.qacc, act=data.act, ctrl=data.ctrl,
        lengths=data.ten_length, slides=np.zeros(0, np.int64) if plant.is_tendon else plant.slides.astype(np.int64),
        offsets=np.ascontiguousarray(rows[:, P.LENGTH_OFFSET]),
        hysteresis=np.ascontiguousarray(rows[:, P.HYSTERESIS]), delay=delay,
        past=np.zeros((round(plant.longest_delay_s / tick_s) + 1, plant.n_legs)), spool_volts=np.zeros(plant.n_legs),
    )  # fmt: skip


def new_record(plant: Any, ticks: int) -> Record:
    """Empty rows for `ticks` ticks."""
    model, n = plant.model, plant.n_legs
    widths = (n, model.nq, model.nv, model.nv, model.nv, model.na, n, n)
    return Record(*(np.zeros((ticks, width)) for width in widths), np.zeros(ticks, np.int64))


@compiled
def sense(context, record):
    """Write down the piston positions of the present state."""
    row = context.count[0] if context.is_recorded else 0
    if context.is_tendon:
        _call(context.kinematics, context.model, context.data)
        _call(context.tendon, context.model, context.data)
        record.positions[row] = context.lengths - context.offsets
    else:
        for i in range(context.slides.shape[0]):
            record.positions[row, i] = context.qpos[context.slides[i]] - context.offsets[i]


@compiled
def apply_valve_delay_and_hysteresis(context, record, volts):
    """From commanded volts to `spool_volts`. Before the first tick the valve was at its first volts, the spool at 0."""
    now, size = context.count[0], context.past.shape[0]
    if now == 0:
        context.past[:] = volts
    context.past[now % size] = volts
    for i in range(context.offsets.shape[0]):
        command = context.past[(now - context.delay[i]) % size, i]
        context.spool_volts[i] = valve.play(command, context.spool_volts[i], context.hysteresis[i])
    if context.is_recorded:
        record.volts[now] = volts


@compiled
def middle_weight(step, steps):
    """Weight of the velocity at the beginning of time step `step` in that of the tick's middle.

    Even steps: the middle is the beginning of step `steps`/2. Odd steps, 3 or more: cubic through the four velocities
    about it, v(0) = (9 v(-h/2) + 9 v(h/2) - v(-3h/2) - v(3h/2))/16, of fourth order as RK4 is. One step a tick has
    no velocity near its middle: `mean_acceleration` takes the neighbouring ticks.
    """
    ahead = abs(2 * step - steps)  # half steps from the middle
    if steps == 1 or ahead > 3:
        return 0.0
    if steps % 2 == 0:
        return 1.0 if ahead == 0 else 0.0
    return 0.5625 if ahead == 1 else -0.0625


@compiled
def advance(context, record):
    """Write the state down, hand `spool_volts` to MuJoCo and step to the next tick.

    Two accelerations come of it. `qacc` is the instant's, which a sensor without filter samples: Euler leaves in it what
    it began its step with, RK4 needs an evaluation. `middle` gives the mean over one tick.
    """
    for i in range(context.offsets.shape[0]):
        context.ctrl[i] = context.spool_volts[i]
    steps, row = context.steps[0], context.count[0]
    if context.is_recorded:
        record.qpos[row], record.qvel[row], record.act[row] = context.qpos, context.qvel, context.act
        record.spool_volts[row], record.steps[row] = context.spool_volts, steps
        record.middle[row] = 0.0
        if not context.is_fast:
            _call(context.forward, context.model, context.data)
            record.qacc[row] = context.qacc
    for k in range(steps):
        weight = middle_weight(k, steps)
        if context.is_recorded and weight != 0.0:
            for i in range(context.qvel.shape[0]):
                record.middle[row, i] += weight * context.qvel[i]
        _call(context.step, context.model, context.data)
        if context.is_recorded and context.is_fast and k == 0:
            record.qacc[row] = context.qacc
    if context.is_recorded and steps == 3:  # the last of the four stands at the end of the tick
        for i in range(context.qvel.shape[0]):
            record.middle[row, i] += middle_weight(steps, steps) * context.qvel[i]
    context.count[0] += 1


@compiled
def tick(context, record, volts):
    """One tick under the volts (n_legs,) that the motion computer commands."""
    apply_valve_delay_and_hysteresis(context, record, volts)
    advance(context, record)


def mean_acceleration(record: Record, ticks: int, tick_s: float) -> Array:
    """Mean acceleration (ticks, nv) over one tick about each instant, a_k = (v(t_k + T/2) - v(t_k - T/2))/T.

    Figures in a band need it, because samples of the instant alias: the friction jolt of a 40 kg leg is a pulse of 1 ms
    and reads twice as much in the 50 Hz band. The first is the mean of half a tick. Of ticks with one time step the
    middle is the cubic through the velocities at the four ticks about it.
    """
    middle, velocity = record.middle[:ticks].copy(), record.qvel[:ticks]
    lone = record.steps[:ticks] == 1
    if lone.any():
        v = np.pad(velocity, ((1, 2), (0, 0)), mode="reflect", reflect_type="odd")
        middle[lone] = ((9.0 * (v[1:-2] + v[2:-1]) - v[:-3] - v[3:]) / 16.0)[lone]
    mean = np.empty_like(middle)
    mean[:1] = (middle[:1] - velocity[:1]) / (0.5 * tick_s)
    mean[1:] = (middle[1:] - middle[:-1]) / tick_s
    return mean
