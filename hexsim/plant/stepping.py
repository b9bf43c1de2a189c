# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""One tick of the plant, compiled: the valve's delay and hysteresis, the state written down, the time steps.

The steps are RK4's, either constant or chosen anew at least every `steps.LONGEST_S` by the rule in `hydraulics.steps`.
RK4 remembers nothing of its last step, so the step may change at any time.

MuJoCo's own functions are called by their addresses, so that the tick is cached and needs no Python: a control tick in
Python costs as much as the whole of the hydraulics.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.hydraulics import leg, valve
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.steps import LONGEST_S, StepRule, count_steps, leg_steps, near_standstill, power_unit_steps
from hexsim.hydraulics.supply import POWER_UNIT, S
from hexsim.plant.callbacks import leg_state, supply_pressure, supply_state
from hexsim.plant.structs import timestep_view

Array = NDArray[np.float64]
RK4_STAGES = 4
FROM_POSITION, ALL_SENSORS = 1, 0  # mjSTAGE_POS: what depends on positions alone is there; no sensor is left out


@intrinsic
def _call(typingctx, address, model, data, numbers):
    """Call void f(mjModel*, mjData*, int ...) at an address; numbers: a tuple, maybe empty."""
    signature = types.void(types.uintp, types.uintp, types.uintp, numbers)

    def codegen(context, builder, signature, args):
        word, number = ir.IntType(64), ir.IntType(32)
        given = [builder.trunc(builder.extract_value(args[3], i), number) for i in range(len(numbers))]
        kind = ir.FunctionType(ir.VoidType(), [word, word, *(number for _ in given)])
        builder.call(builder.inttoptr(args[0], ir.PointerType(kind)), [args[1], args[2], *given])
        return context.get_dummy_value()

    return signature, codegen


def _address(name: str) -> int:
    """Address of a function of the MuJoCo library that is already loaded."""
    library = ctypes.CDLL(mujoco._functions.__file__)
    return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0


class StepContext(NamedTuple):
    """What a tick calls and looks at. Views share MuJoCo's memory; arrays (1,) are numbers that change."""

    model: int
    data: int
    step: int  # functions' addresses
    forward: int
    position: int
    forward_from: int
    check: int
    runge_kutta: int
    is_tendon: bool
    is_recorded: bool
    is_chosen: bool  # whether `rule` chooses the steps
    rule: StepRule
    tick_s: float
    parts: int  # equal parts of a tick, each with steps of its own
    steps: NDArray[np.int64]  # (1,) time steps of a part
    timestep: Array  # (1,) view of the model's [s]
    calm_s: Array  # (1,) since a leg was near standstill
    count: NDArray[np.int64]  # (1,) ticks done, and the row of the record to write
    qpos: Array
    qvel: Array
    qacc: Array
    act: Array
    ctrl: Array
    user: Array  # rows of legs and supply with their layouts (n_actuators, ROW)
    leg_length: Array  # of the last evaluation
    leg_velocity: Array
    velocity_before: Array  # a part ago (n_legs,)
    lengths: Array  # of the tendons, or empty
    slides: NDArray[np.int64]  # places of the slide joints in qpos, or empty
    offsets: Array  # length at full retraction (n_legs,)
    hysteresis: Array  # [V]
    spread: Array  # of the hysteresis over the threshold, half widths [V]
    delay: NDArray[np.int64]  # [ticks]
    past: Array  # volts of the last ticks (longest delay + 1, n_legs), a ring
    spool_volts: Array  # what reaches the spools (n_legs,)
    apart: Array  # the valves' two plays [V] (n_legs,)


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
    is_closed: NDArray[np.bool_]  # (m,) whether `middle` holds the acceleration at the tick's end already


def step_context(plant: Any, tick_s: float, steps: int, is_recorded: bool) -> StepContext:
    """A plant's view for ticks of `tick_s` in `steps` time steps; 0: as the rule chooses."""
    model, data, rows, n = plant.model, plant.data, plant.rows, plant.n_legs
    parts = 1 if steps or tick_s < 1.001 * LONGEST_S else 2 * math.ceil(tick_s / LONGEST_S / 2 - 1e-6)  # even: a middle
    model.opt.timestep = plant.timestep or tick_s / parts
    delay = np.rint(rows[:, P.VALVE_DELAY] / tick_s).astype(np.int64)
    return StepContext(
        model=model._address, data=data._address,
        step=_address("mj_step"), forward=_address("mj_forward"),
        position=_address("mj_fwdPosition"), forward_from=_address("mj_forwardSkip"),
        check=_address("mj_checkAcc"), runge_kutta=_address("mj_RungeKutta"),
        is_tendon=plant.is_tendon, is_recorded=is_recorded, is_chosen=steps == 0, rule=plant.step_rule(), tick_s=tick_s,
        parts=parts, steps=np.array([steps]), timestep=timestep_view(model), calm_s=np.zeros(1),
        count=np.zeros(1, np.int64), user=model.actuator_user[: len(plant.layout)], leg_length=data.actuator_length[:n],
        leg_velocity=data.actuator_velocity[:n], velocity_before=np.zeros(n),
        qpos=data.qpos, qvel=data.qvel, qacc=data.qacc, act=data.act, ctrl=data.ctrl,
        lengths=data.ten_length, slides=np.zeros(0, np.int64) if plant.is_tendon else plant.slides.astype(np.int64),
        offsets=np.ascontiguousarray(rows[:, P.LENGTH_OFFSET]),
        hysteresis=np.ascontiguousarray(rows[:, P.HYSTERESIS]),
        spread=np.ascontiguousarray(rows[:, P.HYSTERESIS_SPREAD]), delay=delay,
        past=np.zeros((round(plant.longest_delay_s / tick_s) + 1, n)), spool_volts=np.zeros(n), apart=np.zeros(n),
    )  # fmt: skip


def new_record(plant: Any, ticks: int) -> Record:
    """Empty rows for `ticks` ticks."""
    model, n = plant.model, plant.n_legs
    widths = (n, model.nq, model.nv, model.nv, model.nv, model.na, n, n)
    return Record(*(np.zeros((ticks, width)) for width in widths), np.zeros(ticks, np.int64), np.zeros(ticks, np.bool_))


@compiled
def sense(context, record):
    """Write down the piston positions of the present state. Of tendons MuJoCo makes all that depends on positions alone."""
    row = context.count[0] if context.is_recorded else 0
    if context.is_tendon:
        _call(context.position, context.model, context.data, ())
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
        context.spool_volts[i], context.apart[i] = valve.hysteresis(
            command, context.spool_volts[i], context.apart[i], context.hysteresis[i], context.spread[i]
        )
    if context.is_recorded:
        record.volts[now] = volts


@compiled
def middle_weight(step, steps):
    """Weight of the velocity at the beginning of time step `step` in that of the tick's middle.

    Even steps: the middle is the beginning of step `steps`/2. Odd steps, 3 or more: cubic through the four velocities
    about it, v(0) = (9 v(-h/2) + 9 v(h/2) - v(-3h/2) - v(3h/2))/16, of fourth order as RK4 is. One step: the mean
    of its ends, which `mean_acceleration` corrects.
    """
    ahead = abs(2 * step - steps)  # half steps from the middle
    if steps % 2 == 0:
        return 1.0 if ahead == 0 else 0.0
    if steps == 1:
        return 0.5
    if ahead > 3:
        return 0.0
    return 0.5625 if ahead == 1 else -0.0625


@compiled
def _note_middle(context, record, row, step, steps):
    weight = middle_weight(step, steps)
    if weight == 1.0:
        record.middle[row] = context.qvel
    elif weight != 0.0:
        record.middle[row] += weight * context.qvel


@compiled
def choose_steps(context, span_s):
    """Set the steps of the next `span_s` by the rule, from the state of the last evaluation."""
    n_legs = context.offsets.shape[0]
    asked, near = 0.0, False
    if context.user.shape[0] > n_legs and context.user[n_legs, S.MODEL] == POWER_UNIT:
        s = context.user[n_legs]
        _, _, _, pump_pressure, _, _ = supply_state(s[N_PARAMETERS:], context.act)
        asked = power_unit_steps(s, pump_pressure)
    t = context.count[0] * context.tick_s
    for i in range(n_legs):
        p, v = context.user[i], context.leg_velocity[i]
        Ps = supply_pressure(p, p[N_PARAMETERS:], context.act)
        P1, P2, place, _, z = leg_state(p[N_PARAMETERS:], context.act, Ps)
        x = leg.metering_spool(p, context.ctrl[i], t, place)
        asked = max(asked, leg_steps(context.rule, p, context.leg_length[i] - context.offsets[i], v, x, P1, P2, Ps, z))
        near = near or near_standstill(p, v, context.velocity_before[i])
        context.velocity_before[i] = v
    context.calm_s[0] = 0.0 if near else context.calm_s[0] + span_s
    context.steps[0] = count_steps(context.rule, asked, context.calm_s[0], span_s)
    context.timestep[0] = span_s / context.steps[0]


@compiled
def _evaluate(context, is_located):
    """Derivatives of the present state, as `mj_step` begins with."""
    if is_located:
        _call(context.forward_from, context.model, context.data, (FROM_POSITION, ALL_SENSORS))
    else:
        _call(context.forward, context.model, context.data, ())
    _call(context.check, context.model, context.data, ())


@compiled
def advance(context, record, is_located=False):
    """Write the state down, hand `spool_volts` to MuJoCo and step to the next tick. is_located: what depends
    on positions alone is there, because `sense` came just before.

    Each part of the tick begins with the evaluation that its first step needs. Two accelerations come of it: `qacc` is
    the instant's, which a sensor without filter samples; `middle` gives the mean over one tick.
    """
    for i in range(context.offsets.shape[0]):
        context.ctrl[i] = context.spool_volts[i]
    row, done = context.count[0], 0
    if context.is_recorded:
        record.qpos[row], record.qvel[row], record.act[row] = context.qpos, context.qvel, context.act
        record.spool_volts[row] = context.spool_volts
        record.middle[row] = 0.0
    for part in range(context.parts):
        _evaluate(context, is_located and part == 0)
        if context.is_recorded and part == 0:
            record.qacc[row] = context.qacc
        if context.is_recorded and context.parts > 1 and 2 * part == context.parts:
            record.middle[row] = context.qvel
        if context.is_chosen:
            choose_steps(context, context.tick_s / context.parts)
        steps = context.steps[0]
        for k in range(steps):
            if context.is_recorded and context.parts == 1:
                _note_middle(context, record, row, k, steps)
            if k == 0:
                _call(context.runge_kutta, context.model, context.data, (RK4_STAGES,))
            else:
                _call(context.step, context.model, context.data, ())
        done += steps
    if context.is_recorded:
        record.steps[row] = done
        if context.parts == 1:
            _note_middle(context, record, row, done, done)
    context.count[0] += 1


@compiled
def tick(context, record, volts, is_located=False):
    """One tick under the volts (n_legs,) that the motion computer commands."""
    apply_valve_delay_and_hysteresis(context, record, volts)
    advance(context, record, is_located)


def mean_acceleration(record: Record, ticks: int, tick_s: float) -> Array:
    """Mean acceleration (ticks, nv) over one tick about each instant, a_k = (v(t_k + T/2) - v(t_k - T/2))/T.

    Figures in a band need it, because samples of the instant alias: the friction jolt of a 40 kg leg is a pulse of 1 ms
    and reads twice as much in the 50 Hz band. The first is the mean of half a tick. In ticks of one time step
    v(T/2) = (v_0 + v_1)/2 + T (a_0 - a_1)/8, the cubic through both ends; a_1 is the next tick's, or `Plant` has noted it
    before it changed the machine (in the last tick: linear).
    """
    middle, velocity = record.middle[:ticks].copy(), record.qvel[:ticks]
    lone = np.flatnonzero((record.steps[: ticks - 1] == 1) & ~record.is_closed[: ticks - 1])
    middle[lone] += 0.125 * tick_s * (record.qacc[lone] - record.qacc[lone + 1])
    mean = np.empty_like(middle)
    mean[:1] = (middle[:1] - velocity[:1]) / (0.5 * tick_s)
    mean[1:] = (middle[1:] - middle[:-1]) / tick_s
    return mean
