# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""One tick of the plant, compiled: the valve's delay and hysteresis, the state written down, the time steps.

The steps are RK4's, either constant or chosen: no longer than the rule in `hydraulics.steps` asks for, which keeps them
stable, and no longer than the error of the last one allows. A step whose error is too large is taken back and done again
in smaller ones, so that kinks (a valve's edge, the sign of the friction) are passed with short steps and nothing else is.
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

from hexsim.compiled import by_address, compiled
from hexsim.hydraulics import leg, valve
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.steps import STEP, StepRule, count_steps, leg_steps, near_standstill, power_unit_steps
from hexsim.hydraulics.supply import POWER_UNIT, S
from hexsim.plant.callbacks import leg_state, offset, pointer_to, supply_pressure, supply_state
from hexsim.plant.newton_euler import What, native_platform
from hexsim.plant.states import ROW
from hexsim.plant.structs import time_view, timestep_view
from hexsim.smoothness.band import BANDWIDTH_Hz

Array = NDArray[np.float64]


class ErrorControl(NamedTuple):
    """A step's error, and the next step's length by it."""

    stages: int = 4  # evaluations of a step
    # [1/s] acceleration in that band after a jump of the velocity by 1 m/s: peak of the ideal low pass
    kick: float = 2.0 * BANDWIDTH_Hz
    # of an error of a pressure: its estimate is of second order, RK4's error of a smooth ring a tenth of it and less
    ring: float = 0.1
    # of a step, relative to the peak of the acceleration in the band; what adds up: docs/results/step.md
    tolerance: float = 2.0e-4
    # in which that peak is forgotten: a motion is judged by its own peak, not by a crash before it
    level_s: float = 3.0
    # a fifth of what people feel: a machine at rest needs no short steps for its sensors' noise
    least_level_m_s2: float = 0.01
    safe: float = 0.9  # of the length by which the next step would just be exact enough
    least_share: float = 0.2  # the next step's, at least, over the last one's
    largest_share: float = 2.0  # at most
    same_step: float = 1e-6  # of a step: as much longer than asked for it may be, so that rounding does not add one
    longer: float = 0.1  # of a step: so much longer it may be to fill the span, where `safe` has made it shorter


ERROR = ErrorControl()

FROM_POSITION = int(mujoco.mjtStage.mjSTAGE_POS)  # what depends on positions alone is there


@intrinsic
def call_native(typingctx, address, model, data, numbers):
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
    platform: int  # in place of the four before, where one body moves (`newton_euler`); 0: not
    is_tendon: bool
    is_recorded: bool
    is_chosen: bool  # whether `rule` and error choose the steps
    refined: int  # 1; 2: in steps half as long, to measure the error
    rule: StepRule
    tick_s: float
    parts: int  # equal parts of a tick, each with steps of its own
    steps: NDArray[np.int64]  # (1,) time steps that the rule asks for until the volts change or the part ends
    constant_s: float  # the step where none is chosen
    timestep: Array  # (1,) view of the model's [s]
    time: Array  # (1,) view of the data's [s]
    next_step: Array  # (1,) the step that the last error allows [s]
    error: Array  # (1,) sum of the steps' errors [m/s2]
    level: Array  # (1,) peak of the acceleration in the band so far, forgotten within level_s [m/s2]
    slow: Array  # acceleration behind a low pass of the band (nv,) [m/s2]
    reach: Array  # what a unit of qacc is at the joints of the platform (nv,): 1, or a radius [m]; 0: not judged
    push: Array  # acceleration of the leg that a unit of a state in act makes (na,) [m/s2]
    tolerance: float  # of a step's error, relative to `level`
    bends: tuple  # of velocities (nv,) and states (na,): of this step, and of the one before with its length (1,) [s]
    begun: tuple  # qpos, qvel, act, qacc, act_dot and time at the beginning of a step
    count: NDArray[np.int64]  # (1,) ticks done, and the row of the record to write
    qpos: Array
    qvel: Array
    qacc: Array
    act: Array
    act_dot: Array
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
    delay: NDArray[np.int64]  # whole ticks
    part_s: Array  # of a tick, the rest of the delay (n_legs,) [s]: so long the volts of the tick before stay
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
    spool_volts: Array  # after delay, backlash and faults, at the beginning of the tick
    reached: Array  # the same once a delay within the tick is over
    steps: NDArray[np.int64]  # (m,) time steps of the tick


def step_context(plant: Any, tick_s: float, steps: int, is_recorded: bool) -> StepContext:
    """A plant's view for ticks of `tick_s` in `steps` time steps; 0: as the rule chooses."""
    model, data, rows, n = plant.model, plant.data, plant.rows, plant.n_legs
    parts = (
        1 if steps or tick_s < 1.001 * STEP.longest_s else 2 * math.ceil(tick_s / STEP.longest_s / 2 - 1e-6)
    )  # even: a middle
    model.opt.timestep = plant.timestep or tick_s / parts
    delay, part_s = valve.delay_in_ticks(rows[:, P.VALVE_DELAY], tick_s)
    return StepContext(
        model=model._address,
        data=data._address,
        step=_address("mj_step"),
        forward=_address("mj_forward"),
        position=_address("mj_fwdPosition"),
        forward_from=_address("mj_forwardSkip"),
        check=_address("mj_checkAcc"),
        runge_kutta=_address("mj_RungeKutta"),
        platform=native_platform().address if plant.is_one_body else 0,
        is_tendon=plant.is_tendon,
        is_recorded=is_recorded,
        is_chosen=steps == 0,
        refined=1,
        rule=plant.step_rule(),
        tick_s=tick_s,
        parts=parts,
        steps=np.array([steps]),
        constant_s=plant.timestep or STEP.longest_s,
        timestep=timestep_view(model),
        time=time_view(data),
        next_step=np.full(1, STEP.longest_s),
        error=np.zeros(1),
        level=np.full(1, ERROR.least_level_m_s2),
        slow=np.zeros(model.nv),
        reach=plant.reach(),
        push=plant.push(),
        tolerance=ERROR.tolerance,
        bends=tuple(np.zeros(k) for k in (model.nv, model.na, model.nv, model.na, 1)),
        begun=tuple(np.zeros(k) for k in (model.nq, model.nv, model.na, model.nv, model.na, 1)),
        count=np.zeros(1, np.int64),
        user=model.actuator_user[: len(plant.layout)],
        leg_length=data.actuator_length[:n],
        leg_velocity=data.actuator_velocity[:n],
        velocity_before=np.zeros(n),
        qpos=data.qpos,
        qvel=data.qvel,
        qacc=data.qacc,
        act=data.act,
        act_dot=data.act_dot,
        ctrl=data.ctrl,
        lengths=data.ten_length,
        slides=np.zeros(0, np.int64) if plant.is_tendon else plant.slides.astype(np.int64),
        offsets=np.ascontiguousarray(rows[:, P.LENGTH_OFFSET]),
        hysteresis=np.ascontiguousarray(rows[:, P.HYSTERESIS]),
        spread=np.ascontiguousarray(rows[:, P.HYSTERESIS_SPREAD]),
        delay=delay,
        part_s=part_s,
        past=np.zeros((int(plant.longest_delay_s / tick_s + 1e-6) + 1, n)),
        spool_volts=np.zeros(n),
        apart=np.zeros(n),
    )


def new_record(plant: Any, ticks: int) -> Record:
    """Empty rows for `ticks` ticks."""
    model, n = plant.model, plant.n_legs
    widths = (n, model.nq, model.nv, model.nv, model.nv, model.na, n, n, n)
    return Record(*(np.zeros((ticks, width)) for width in widths), np.zeros(ticks, np.int64))


@compiled
def copy(there, values):
    """there[:] = values (n,); numba's own code for it, with its checks of shape and overlap, compiles ten times as long."""
    for i in range(there.shape[0]):
        there[i] = values[i]


@compiled
def sense(context, record):
    """Write down the piston positions of the present state. Of tendons MuJoCo makes all that depends on positions alone."""
    row = context.count[0] if context.is_recorded else 0
    if context.is_tendon:
        if context.platform:
            call_native(context.platform, context.model, context.data, (What.LENGTHS,))
        else:
            call_native(context.position, context.model, context.data, ())
        for i in range(context.offsets.shape[0]):
            record.positions[row, i] = context.lengths[i] - context.offsets[i]
    else:
        for i in range(context.slides.shape[0]):
            record.positions[row, i] = context.qpos[context.slides[i]] - context.offsets[i]


@compiled
def apply_valve_delay_and_hysteresis(context, record, volts):
    """From commanded volts to `spool_volts`. Before the first tick the valve was at its first volts, the spool at 0."""
    now, size = context.count[0], context.past.shape[0]
    for k in range(size):
        if now == 0 or k == now % size:
            copy(context.past[k], volts)
    for i in range(context.offsets.shape[0]):
        command = context.past[(now - context.delay[i]) % size, i]
        context.spool_volts[i], context.apart[i] = valve.hysteresis(
            command, context.spool_volts[i], context.apart[i], context.hysteresis[i], context.spread[i]
        )
    if context.is_recorded:
        copy(record.volts[now], volts)


@compiled
def keep_state(context):
    """Note what a step begins with: the state and its derivatives."""
    qpos, qvel, act, qacc, act_dot, time = context.begun
    copy(qpos, context.qpos)
    copy(qvel, context.qvel)
    copy(act, context.act)
    copy(qacc, context.qacc)
    copy(act_dot, context.act_dot)
    time[0] = context.time[0]


@compiled
def take_back(context):
    """The state before the last step again, with its derivatives, which RK4 begins with."""
    qpos, qvel, act, qacc, act_dot, time = context.begun
    copy(context.qpos, qpos)
    copy(context.qvel, qvel)
    copy(context.act, act)
    copy(context.qacc, qacc)
    copy(context.act_dot, act_dot)
    context.time[0] = time[0]


@compiled
def bend(h, start, end, moved):
    """k1 - 2 k23 + k4 of a step, times h/3: RK4 less the trapezoid of its first and last stage. k23 is the mean of the inner
    stages, which follows from what the step has moved, h (k1 + 4 k23 + k4)/6."""
    return h * (start + end) * 0.5 - moved


@compiled
def unforeseen(now, before, ratio):
    """What of a step's bend the bend of the step before does not foretell; a smooth law's goes on."""
    return min(abs(now), abs(now - ratio * before))


@compiled
def last_error(context, h):
    """Error of the step just done, as an acceleration in the 50 Hz band [m/s2].

    As large as what a jump within the step costs; of fourth order in h where the laws are smooth, as RK4's is of fifth.
    """
    _, qvel, act, qacc, act_dot, _ = context.begun
    _, _, was_moved, was_pushed, was_h = context.bends
    moved, pushed, ratio = 0.0, 0.0, (h / was_h[0]) ** 3 if was_h[0] > 0.0 else 0.0
    for i in range(context.reach.shape[0]):
        if context.reach[i] > 0.0:
            context.bends[0][i] = now = bend(h, qacc[i], context.qacc[i], context.qvel[i] - qvel[i])
            moved = max(moved, context.reach[i] * unforeseen(now, was_moved[i], ratio))
    for i in range(context.push.shape[0]):
        if context.push[i] > 0.0:
            context.bends[1][i] = now = bend(h, act_dot[i], context.act_dot[i], context.act[i] - act[i])
            pushed = max(pushed, context.push[i] * unforeseen(now, was_pushed[i], ratio))
    return moved * ERROR.kick + pushed * ERROR.ring


@compiled
def keep_bends(context, h):
    """A step is done: its bends are those before the next one."""
    moved, pushed, was_moved, was_pushed, was_h = context.bends
    copy(was_moved, moved)
    copy(was_pushed, pushed)
    was_h[0] = h


@compiled
def note_level(context):
    """Follow the peak of the acceleration in the band, at the beginning of a tick."""
    share, peak = 1.0 - math.exp(-2.0 * math.pi * BANDWIDTH_Hz * context.tick_s), 0.0
    for i in range(context.slow.shape[0]):
        context.slow[i] += share * (context.reach[i] * context.qacc[i] - context.slow[i])
        peak = max(peak, abs(context.slow[i]))
    context.level[0] = max(context.level[0] * math.exp(-context.tick_s / ERROR.level_s), peak, ERROR.least_level_m_s2)


@compiled
def note_middle(context, record, row, h, before_s):
    """Write down the velocity in the tick's middle where it lies in the step just done, which began before_s ahead of it.

    RK4's own interpolation of third order: the parabola through its stages.
    """
    share = before_s / h
    if not 0.0 <= share < 1.0:
        return
    _, qvel, _, qacc, _, _ = context.begun
    first = share - 1.5 * share**2 + 2.0 / 3.0 * share**3
    inner, last = 2.0 * share**2 - 4.0 / 3.0 * share**3, -0.5 * share**2 + 2.0 / 3.0 * share**3
    for i in range(qvel.shape[0]):
        # of the inner stages' mean, from v1 - v0 = h (k1 + 4 k23 + k4)/6
        k23 = 1.5 * (context.qvel[i] - qvel[i]) - 0.25 * h * (qacc[i] + context.qacc[i])
        record.middle[row, i] = qvel[i] + h * (first * qacc[i] + last * context.qacc[i]) + inner * k23


@compiled
def asked_steps(context):
    """Steps a second [1/s] that legs and supply ask for in the state of the last evaluation, and whether a leg is near standstill."""
    n_legs, rows, act = context.offsets.shape[0], pointer_to(context.user), pointer_to(context.act)
    asked, near = 0.0, False
    s = offset(rows, n_legs * ROW)
    if context.user.shape[0] > n_legs and s[S.MODEL] == POWER_UNIT:
        _, _, _, pump_pressure, _, _ = supply_state(offset(s, N_PARAMETERS), act)
        asked = power_unit_steps(s, pump_pressure)
    t = context.time[0]
    for i in range(n_legs):
        p, v = offset(rows, i * ROW), context.leg_velocity[i]
        places = offset(p, N_PARAMETERS)
        Ps = supply_pressure(p, places, act)
        P1, P2, place, _, z = leg_state(places, act, Ps)
        x = leg.metering_spool(p, context.ctrl[i], t, place)
        asked = max(asked, leg_steps(context.rule, p, context.leg_length[i] - context.offsets[i], v, x, P1, P2, Ps, z))
        near = near or near_standstill(p, v, context.velocity_before[i])
        context.velocity_before[i] = v
    return asked, near


@compiled
def _evaluate(context, is_located):
    """Derivatives of the present state, as `mj_step` begins with."""
    if context.platform:
        call_native(context.platform, context.model, context.data, (What.EVALUATE,))
    elif is_located:
        call_native(context.forward_from, context.model, context.data, (FROM_POSITION, 0))  # 0: no sensor is left out
    else:
        call_native(context.forward, context.model, context.data, ())
    call_native(context.check, context.model, context.data, ())


@compiled
def march(context, record, row, span, middle):
    """The steps of `span`, from an evaluated state on; their number. middle [s]: from here to the tick's middle."""
    rule = context.steps[0] * context.refined
    steps = max(rule, math.ceil(span / context.next_step[0] - ERROR.longer)) if context.is_chosen else rule
    longest, h, left, done, is_evaluated = span / rule, span / steps, span, 0, True
    tolerance = context.tolerance / context.refined**3 * context.level[0]
    while steps > 0:
        if not is_evaluated:
            _evaluate(context, False)
        context.timestep[0] = h
        keep_state(context)
        if context.platform:
            call_native(context.platform, context.model, context.data, (What.RUNGE_KUTTA,))
        else:
            call_native(context.runge_kutta, context.model, context.data, (ERROR.stages,))
        error = last_error(context, h)
        if context.is_chosen:
            share = ERROR.safe * (tolerance / (error + 1e-300)) ** (1.0 / 3.0)
            is_evaluated = error > tolerance and h > STEP.shortest_s * (1.0 + 2.0 * ERROR.same_step)
            context.next_step[0] = max(h * min(max(share, ERROR.least_share), ERROR.largest_share), STEP.shortest_s)
            if is_evaluated:
                take_back(context)
                steps = max(math.ceil(left / context.next_step[0] - ERROR.same_step), 1)
                h = left / steps
                continue
        else:
            is_evaluated = False
        context.error[0] += error
        keep_bends(context, h)
        if context.is_recorded:
            note_middle(context, record, row, h, middle)
        done, steps, left, middle = done + 1, steps - 1, left - h, middle - h
        if context.is_chosen and steps > 0:
            planned = max(
                max(math.ceil(left / context.next_step[0] - ERROR.longer), math.ceil(left / longest - ERROR.same_step)),
                1,
            )
            if planned != steps:
                steps, h = planned, left / planned
    return done


@compiled
def part_end(context, part):
    """Where in the tick a part ends [s]: one expression for all that compare with it, since its rounding is what they compare."""
    return context.tick_s if part + 1 == context.parts else (part + 1) * (context.tick_s / context.parts)


@compiled
def next_change(context, at, part):
    """Where in the tick [s] the steps end that begin at `at`: where delayed volts reach a spool, or the part ends."""
    end = part_end(context, part)
    for i in range(context.part_s.shape[0]):
        if at < context.part_s[i] < end:
            end = context.part_s[i]
    return end


@compiled
def advance(context, record, is_located):
    """Write the state down, hand `spool_volts` to MuJoCo and step to the next tick. is_located: what depends
    on positions alone is there, because `sense` came just before.

    Each part of the tick begins with the evaluation that its first step needs. Two accelerations come of it: `qacc` is
    the instant's, which a sensor without filter samples; `middle` gives the mean over one tick.
    """
    row, done, part, at, n_legs = context.count[0], 0, 0, 0.0, context.offsets.shape[0]
    for i in range(n_legs):
        if context.part_s[i] <= 0.0 or row == 0:
            context.ctrl[i] = context.spool_volts[i]
    if context.is_recorded:
        copy(record.qpos[row], context.qpos)
        copy(record.qvel[row], context.qvel)
        copy(record.act[row], context.act)
        for i in range(n_legs):
            record.spool_volts[row, i] = context.ctrl[i]
            record.reached[row, i] = context.spool_volts[i]
    while at < context.tick_s:
        end = next_change(context, at, part)
        span = end - at
        _evaluate(context, is_located and at == 0.0)
        if at == 0.0:
            note_level(context)
            if context.is_recorded:
                copy(record.qacc[row], context.qacc)
        if context.is_chosen:
            asked, near = asked_steps(context)
            context.steps[0] = count_steps(context.rule, asked, near, span)
        else:
            context.steps[0] = max(math.ceil(span / context.constant_s - 1e-6), 1)
        done += march(context, record, row, span, 0.5 * context.tick_s - at)
        at = end
        if at >= part_end(context, part):
            part += 1
        for i in range(n_legs):
            if 0.0 < context.part_s[i] <= at:
                context.ctrl[i] = context.spool_volts[i]
    if context.is_recorded:
        record.steps[row] = done
    context.count[0] += 1


@compiled
def for_python(context, record, volts, senses, takes, advances):
    """`sense`, `apply_valve_delay_and_hysteresis` and `advance` for callers in Python, each if it is asked for: one function,
    since each has all that is below it compiled into it."""
    context, record = by_address(context), by_address(record)
    if senses:
        sense(context, record)
    if takes:
        apply_valve_delay_and_hysteresis(context, record, volts)
    if advances:
        advance(context, record, senses and context.is_tendon)


def mean_acceleration(record: Record, ticks: int, tick_s: float) -> Array:
    """Mean acceleration (ticks, nv) over one tick about each instant, a_k = (v(t_k + T/2) - v(t_k - T/2))/T.

    Figures in a band need it, because samples of the instant alias: the friction jolt of a 40 kg leg is a pulse of 1 ms
    and reads twice as much in the 50 Hz band. The first is the mean of half a tick.
    """
    middle, velocity = record.middle[:ticks], record.qvel[:ticks]
    mean = np.empty_like(middle)
    mean[:1] = (middle[:1] - velocity[:1]) / (0.5 * tick_s)
    mean[1:] = (middle[1:] - middle[:-1]) / tick_s
    return mean
