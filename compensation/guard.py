# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""What stands between any algorithm and the valve: detection of sensor and valve faults, bounds, and a way back.

| condition | volts added |
|---|---|
| signals sound | those of the algorithm, within the valve's range |
| a signal lost or frozen, the valve saturated | the last ones, faded to nothing within `FADE_TICKS` |
| more than the declared valve can explain (volts_bound.py) | what it can explain; after `BEYOND_S` of that as at a fault |
| the algorithm's volts or its state not finite | the last sound ones, faded as at a fault |
| until the signals have been sound for `HOLD_OFF_S`, four times longer after each fault of the algorithm's own | none: plain \
control; the algorithm is not stepped |
| after that | those of the algorithm, restarted with its parameters, or with nothing if the fault was its own; faded in over \
`RETURN_S` |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from . import compensator, volts_bound
from .arithmetic import next_noise, push
from .compensator import Compensator, Context, Parameters, Sample, Wrapped
from .compiled import compiled
from .desk import SHARE, STEP, call_tick, doubles, integers, on_desk, pointer, rows, truths
from .knowledge import Knowledge
from .learned_parameters import check_parameters
from .legs import Legs, OneByOne, Together, stepper
from .spool_model import set_spool_model
from .started import Started
from .volts_bound import EDGE_MARGIN, GAIN_MARGIN, USUAL_SPOOL_HZ

FADE_TICKS = 12  # 24 ms at 500 Hz
FROZEN_TICKS = 10  # a reading repeated at least so often, while the setpoint moved, is a dead sensor
# chance that a sound reading at rest repeats as often: with the readings of six legs at 500 Hz once in some 300 hours at rest. Ten ticks
# alone did it on one of 40,000 readings of a count as large as the noise, and a platform in six axes lost a leg for nothing
FALSE_ALARM = 1e-10
FROZEN_TRAVEL_M = (
    1e-4  # by which the setpoint must have moved meanwhile, of a transducer whose noise moves its last count
)
FROZEN_MARGIN = (
    2.0  # on the setpoint's travel over a dead band; a coarser reading repeats while the piston stands there
)
FROZEN_STROKE = 0.25  # of the stroke: the same of a coarse pressure, which only the load's changes move
SATURATED_TICKS = 5  # after which a saturated valve is a fault
SATURATED_SHARE = 0.999  # of the voltage range
HOLD_OFF_S = 0.5  # of plain control after a fault
RETURN_S = 1.0  # in which the algorithm's volts are faded in again
# so long its volts may be bounded; each fault of its own holds it off so many times as long, up to the sixth: half an hour
BEYOND_S, HOLD_OFF_RATIO, MOST_OWN_FAULTS = 0.05, 4, 6


class Reason(IntEnum):
    """Why plain control stands in, as the C library's header numbers it."""

    SOUND = 0
    LOST = 8
    POSITION_FROZEN = 16
    PRESSURE_FROZEN = 32
    VALVE_AT_END = 64
    NOT_FINITE = 256
    BEYOND = 512


class Todo(IntEnum):
    """What the guard asks of the algorithm at a tick."""

    ACT = 0
    FALL_BACK = 1
    RESTART = 2  # with its parameters
    BEGIN_ANEW = 3  # with nothing learned


TELLS = 128  # beside a reason, of an algorithm: something for the other legs
SENTENCES: dict[int, str] = {
    Reason.SOUND: "",
    Reason.LOST: "a signal is lost (not a number): plain control until it is sound again",
    Reason.POSITION_FROZEN: "the position signal is frozen: plain control until it moves again",
    Reason.PRESSURE_FROZEN: "the pressure signal is frozen: plain control until it moves again",
    Reason.VALVE_AT_END: "the valve is at its end: plain control until it is not",
    Reason.NOT_FINITE: "the algorithm's state is not finite: plain control, and it starts anew with nothing learned",
    Reason.BEYOND: "it asked for more volts than the declared valve's overlap, leak and friction can explain: plain control, and it "
    "starts anew with nothing learned; are overlap and flow of the valve declared rightly?",
}

# The last readings of a transducer, newest first, for how many ticks it has repeated, the setpoint when it came, its count (the smallest
# step seen) and its noise.
READING = np.dtype(
    (np.record, [("values", "f8", (5,)), ("repeated", "i8"), ("setpoint_m", "f8"), ("count", "f8"), ("noise", "f8")])
)
GUARD = np.dtype(
    (
        np.record,
        [
            ("tick_s", "f8"),
            ("voltage_max_V", "f8"),
            ("position", READING),
            ("pressure", READING),
            ("position_travel_m", "f8"),  # of the setpoint, from which a coarse reading is frozen
            ("pressure_travel_m", "f8"),
            ("edges_V", "f8"),
            ("volts_per_m_s", "f8"),
            ("lead_gain", "f8"),
            ("spool", "f8", (4,)),  # of volts_bound.py; spool.py
            ("spool_V", "f8"),
            ("spool_rate_V", "f8"),  # of the added volts alone; a tick
            ("setpoint_m", "f8"),
            ("speed_m_s", "f8"),
            ("ticks", "i8"),
            ("beyond_ticks", "i8"),
            ("own_faults", "i8"),
            ("anew", "i8"),
            ("top_pressure", READING),
            ("saturated_ticks", "i8"),
            ("open_ticks", "i8"),  # for which the valve has been open, whatever its overlap
            ("output_V", "f8"),
            ("fade_from_V", "f8"),
            ("fade_ticks", "i8"),  # left
            ("hold_off_ticks", "i8"),  # left; 0 = the algorithm acts
            ("fade_in", "f8"),
            ("reason", "i8"),
        ],
    )
)
SHEET = np.dtype(
    (
        np.record,
        [
            (name, "f8")
            for name in (
                "tick_s",
                "voltage_max_V",
                "edge_V",
                "velocity_gain_m_s_V",
                "velocity_gain_V_s_per_m",
                "spool_frequency_Hz",
                "spool_damping",
                "position_gain_V_per_m",
                "position_noise_m",
                "position_resolution_m",
                "pressure_noise_Pa",
                "pressure_resolution_Pa",
                "stroke_m",
            )
        ],
    )
)
clip = compiled(compensator.clip)
lead_gain = compiled(volts_bound.lead_gain)


@compiled
def start_guard(guard, sheet):
    """guard: a record GUARD, zero; sheet: a record with the numbers of the data sheet, SETTINGS or SHEET."""
    guard.tick_s, guard.voltage_max_V, guard.fade_in = sheet.tick_s, sheet.voltage_max_V, 1.0
    guard.edges_V = EDGE_MARGIN * sheet.edge_V
    guard.volts_per_m_s = GAIN_MARGIN / sheet.velocity_gain_m_s_V + abs(sheet.velocity_gain_V_s_per_m)
    frequency_Hz = sheet.spool_frequency_Hz if sheet.spool_frequency_Hz > 0.0 else USUAL_SPOOL_HZ
    guard.lead_gain = lead_gain(frequency_Hz, sheet.spool_damping)
    set_spool_model(guard.spool, sheet.spool_damping / (math.pi * frequency_Hz), sheet.tick_s, sheet.spool_damping)
    standstill_m = FROZEN_MARGIN * 2.0 * sheet.edge_V / sheet.position_gain_V_per_m + 2.0 * sheet.position_resolution_m
    guard.position_travel_m = FROZEN_TRAVEL_M + standstill_m
    guard.pressure_travel_m = FROZEN_STROKE * sheet.stroke_m
    guard.position.noise = sheet.position_noise_m
    guard.pressure.noise = guard.top_pressure.noise = sheet.pressure_noise_Pa
    guard.position.count = guard.pressure.count = guard.top_pressure.count = (
        1e300  # coarse, until it is seen to be fine
    )


@compiled
def check(guard, setpoint_m, preview_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """What is to be done at a tick; unless the algorithm acts, `guard.output_V` is what is added. After a start it acts from the
    next tick on. preview_m: (n,) setpoints of this tick and the next."""
    reason = _fault(guard, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)
    if reason != Reason.SOUND:
        _fall_back(guard, reason, HOLD_OFF_S)
    else:
        _follow_speed(guard, setpoint_m, preview_m)
    if guard.hold_off_ticks == 0:
        return Todo.ACT
    guard.fade_ticks = max(0, guard.fade_ticks - 1)
    x = guard.fade_ticks / FADE_TICKS
    guard.output_V = guard.fade_from_V * x * x * (3.0 - 2.0 * x)
    _move_spool(guard, guard.output_V)
    guard.hold_off_ticks -= 1
    if guard.hold_off_ticks > 0:
        return Todo.FALL_BACK
    guard.fade_in, guard.reason, anew = 0.0, Reason.SOUND, guard.anew
    guard.anew = 0
    return Todo.BEGIN_ANEW if anew else Todo.RESTART


@compiled
def _fall_back(guard, reason, hold_off_s):
    """To plain control; a longer time that still runs is kept, and so is a fault of the algorithm's own."""
    if guard.hold_off_ticks == 0:
        guard.fade_from_V, guard.fade_ticks = guard.output_V, FADE_TICKS
    guard.reason = reason
    guard.hold_off_ticks = max(guard.hold_off_ticks, max(1, round(hold_off_s / guard.tick_s)))


@compiled
def _follow_speed(guard, setpoint_m, preview_m):
    """The largest speed of the setpoint of late, and at the end of its preview."""
    speed = abs(setpoint_m - guard.setpoint_m) / guard.tick_s if guard.ticks > 0 else 0.0
    n = len(preview_m)
    if n > 1:
        ahead = abs(preview_m[n - 1] - preview_m[n - 2]) / guard.tick_s
        speed = ahead if ahead > speed else speed  # not of a preview that is not finite
    faded = guard.speed_m_s * (1.0 - guard.tick_s / 0.5)  # a reference lags plain control's 0.1 to 0.2 s
    guard.speed_m_s = min(speed if speed > faded else faded, 1e3)  # m/s: finite
    guard.setpoint_m, guard.ticks = setpoint_m, 1


@compiled
def _move_spool(guard, volts_V):
    """The spool that the added volts alone move, a tick on."""
    m, away = guard.spool, volts_V - guard.spool_V
    guard.spool_V += m[0] * away + m[1] * guard.spool_rate_V
    guard.spool_rate_V = m[2] * away + m[3] * guard.spool_rate_V


@compiled
def _explained(guard, added_V, forward_V):
    """The volts, as far as the declared valve explains them."""
    most_V = guard.edges_V + guard.volts_per_m_s * guard.speed_m_s + abs(forward_V)
    limit_V = min(guard.lead_gain * most_V, guard.voltage_max_V)
    bounded_V = clip(added_V, -limit_V, limit_V)
    m = guard.spool
    spool_V = guard.spool_V + m[0] * (bounded_V - guard.spool_V) + m[1] * guard.spool_rate_V
    if abs(spool_V) > most_V:
        bounded_V = clip(bounded_V, -min(most_V, limit_V), min(most_V, limit_V))
    return bounded_V


@compiled
def accept(guard, added_V, forward_V, finite):
    """The algorithm's volts as they are added: finite, explained by the declared valve, faded in after a fault. forward_V: what the
    controller feeds forward; finite: whether the algorithm's state is."""
    own = Reason.SOUND
    if not finite or added_V - added_V != 0.0:
        own = Reason.NOT_FINITE
    else:
        bounded_V = _explained(guard, added_V, forward_V)
        guard.beyond_ticks = guard.beyond_ticks + 1 if bounded_V != added_V else 0
        if guard.beyond_ticks * guard.tick_s > BEYOND_S:
            own = Reason.BEYOND
    if own != Reason.SOUND:
        guard.anew, guard.beyond_ticks = 1, 0
        _fall_back(guard, own, HOLD_OFF_S * HOLD_OFF_RATIO**guard.own_faults)
        guard.own_faults = min(guard.own_faults + 1, MOST_OWN_FAULTS)
        _move_spool(guard, guard.output_V)
        return guard.output_V
    if guard.fade_in < 1.0:
        guard.fade_in = min(1.0, guard.fade_in + guard.tick_s / RETURN_S)
        bounded_V *= guard.fade_in
    guard.output_V = bounded_V
    _move_spool(guard, bounded_V)
    return bounded_V


@compiled
def _frozen(reading, value, setpoint_m, coarse_m, moves):
    """Takes the reading of this tick; whether it stands still although the setpoint moves: by FROZEN_TRAVEL_M where what is read moves or
    noise would have moved the last count by now, else by `coarse_m`: it stands still with the piston, in a dead band."""
    x = reading.values
    step = abs(value - x[0])
    push(x, value)
    slow = abs(x[0] - x[4]) < 4.0 * max(reading.noise, reading.count)  # a clock that jitters is noise in motion alone
    if slow and reading.repeated < FROZEN_TICKS:
        reading.noise = next_noise(reading.noise, x[0], x[1], x[2], x[3], x[4])
    if step > 0.0:
        reading.count = min(reading.count, step)
        reading.repeated, reading.setpoint_m = 0, setpoint_m
        return False
    reading.repeated += 1
    chance = reading.count / max(math.sqrt(2.0 * math.pi) * reading.noise, reading.count)  # of one repetition, at most
    needed = 1e-3 if moves else FALSE_ALARM  # of a piston that moves noise is not all that changes a reading
    sure = chance**reading.repeated < needed
    travel_m = FROZEN_TRAVEL_M if sure else coarse_m
    return reading.repeated >= FROZEN_TICKS and abs(setpoint_m - reading.setpoint_m) > travel_m


@compiled
def _fault(guard, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """What is wrong with this tick's signals."""
    total = position_m + bottom_Pa + top_Pa + supply_Pa + control_V + valve_V + setpoint_m
    if total - total != 0.0:
        return Reason.LOST
    guard.open_ticks = guard.open_ticks + 1 if abs(valve_V) > guard.edges_V / EDGE_MARGIN else 0
    moves = guard.open_ticks >= FROZEN_TICKS
    if _frozen(guard.position, position_m, setpoint_m, guard.position_travel_m, moves):
        return Reason.POSITION_FROZEN
    if _frozen(guard.pressure, bottom_Pa, setpoint_m, guard.pressure_travel_m, False):
        return Reason.PRESSURE_FROZEN
    if top_Pa != 0.0 and _frozen(guard.top_pressure, top_Pa, setpoint_m, guard.pressure_travel_m, False):
        return Reason.PRESSURE_FROZEN
    if abs(valve_V) < SATURATED_SHARE * guard.voltage_max_V:
        guard.saturated_ticks = 0
        return Reason.SOUND
    guard.saturated_ticks += 1
    return Reason.VALVE_AT_END if guard.saturated_ticks >= SATURATED_TICKS else Reason.SOUND


@compiled
def check_first(guards, setpoint_m, preview_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa):
    """`check` of guards (1,): Python hands an array over four times as fast as a record."""
    return check(guards[0], setpoint_m, preview_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)


@compiled
def accept_first(guards, added_V, forward_V, finite):
    """`accept` of guards (1,)."""
    return accept(guards[0], added_V, forward_V, finite)


@compiled
def check_legs(
    guards, setpoint_m, preview_m, counts, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, todo
):
    """`check` of guards (n,) into todo (n,). Returns whether all act."""
    all_act = True
    for i in range(len(guards)):
        preview = preview_m[i, : counts[i]]
        todo[i] = check(
            guards[i],
            setpoint_m[i],
            preview,
            position_m[i],
            control_V[i],
            valve_V[i],
            bottom_Pa[i],
            top_Pa[i],
            supply_Pa,
        )
        all_act = all_act and todo[i] == Todo.ACT
    return all_act


@compiled
def accept_legs(guards, todo, added_V, forward_V, finite, reasons):
    """`accept` of those guards (n,) whose algorithm acts, in added_V (n,); the others' own volts. Returns whether a reason (n,)
    has changed."""
    changed = False
    for i in range(len(guards)):
        if todo[i] == Todo.ACT:
            added_V[i] = accept(guards[i], added_V[i], forward_V[i], finite[i])
        else:
            added_V[i] = guards[i].output_V
        changed = changed or reasons[i] != guards[i].reason
        reasons[i] = guards[i].reason
    return changed


@compiled
def step_desk(guards, todo, reasons, desk, step):
    """One tick of guards (n,) and of an algorithm's legs on a desk. desk, step: addresses of its LEGS and of a `desk.TICK`.
    Returns whether all act, and whether a reason has changed."""
    d = on_desk(desk)
    n, acts = d.n, truths(d.acts, d.n)
    all_act = check_legs(
        guards,
        doubles(d.setpoint_m, n),
        rows(d.preview_m, n, d.most),
        integers(d.counts, n),
        doubles(d.position_m, n),
        doubles(d.control_V, n),
        doubles(d.valve_V, n),
        doubles(d.bottom_Pa, n),
        doubles(d.top_Pa, n),
        d.supply_Pa,
        todo,
    )
    added = doubles(d.added_V, n)
    for i in range(n):
        acts[i], added[i] = todo[i] == Todo.ACT, 0.0
    call_tick(step, pointer(desk), STEP)
    changed = accept_legs(guards, todo, added, doubles(d.forward_V, n), truths(d.finite, n), reasons)
    return all_act, changed


@compiled
def share_desk(reasons, desk, step):
    """What legs have just learned, to those that are alike."""
    d = on_desk(desk)
    acts = truths(d.acts, d.n)
    for i in range(d.n):
        acts[i] = acts[i] and reasons[i] == Reason.SOUND
    call_tick(step, pointer(desk), SHARE)


@dataclass(slots=True)
class GuardState:
    context: Context
    inner: Any
    guards: np.ndarray  # (1,) of GUARD
    reason: int = Reason.SOUND
    acted: bool = False  # the algorithm, at the last step


@dataclass(frozen=True)
class Guarded(Wrapped):
    """An algorithm behind the guard. `registry.create` returns every algorithm so."""

    def start(self, context: Context) -> GuardState:
        return self._around(context, self.inner.start(context))

    def _around(self, context: Context, inner: Any) -> GuardState:
        guards, sheet = np.zeros(1, GUARD), np.zeros(1, SHEET)
        for name in SHEET.names or ():
            sheet[name] = getattr(context, name)
        start_guard(guards[0], sheet[0])
        return GuardState(context, inner, guards)

    def step(self, state: GuardState, sample: Sample) -> tuple[float, GuardState]:
        todo = check_first(
            state.guards,
            sample.setpoint_m,
            sample.preview_m,
            sample.position_m,
            sample.control_V,
            sample.valve_V,
            sample.pressure_bottom_Pa,
            sample.pressure_top_Pa,
            sample.pressure_supply_Pa,
        )
        state.acted = todo == Todo.ACT
        if state.acted:
            added, state.inner = self.inner.step(state.inner, sample)
            finite = self.inner.finite(state.inner)
            added = accept_first(state.guards, float(added), sample.feed_forward_V, finite)
            state.reason = int(state.guards["reason"][0])
            return added, state
        state.reason = int(state.guards["reason"][0])
        if todo == Todo.BEGIN_ANEW:
            state.inner = self.inner.start(state.context)
        elif todo == Todo.RESTART:
            state.inner = self.inner.resume(state.context, self.inner.parameters(state.inner))
        return float(state.guards["output_V"][0]), state

    def parameters(self, state: GuardState) -> Parameters:
        return self.inner.parameters(state.inner)

    def restore(self, context: Context, parameters: Parameters) -> GuardState:
        check_parameters(self.inner, context, parameters)
        return self._around(context, self.inner.restore(context, parameters))

    def resume(self, context: Context, parameters: Parameters) -> GuardState:
        return self._around(context, self.inner.resume(context, parameters))

    def preview_of(self, state: GuardState) -> float:
        return self.inner.preview_of(state.inner)

    def tells(self, state: GuardState) -> bool:
        return state.acted and state.reason == Reason.SOUND and self.inner.tells(state.inner)

    def hear(self, state: GuardState, other: GuardState) -> None:
        self.inner.hear(state.inner, other.inner)

    def not_engaged(self, state: GuardState) -> str:
        return SENTENCES[state.reason] or self.inner.not_engaged(state.inner)

    def knows(self, state: GuardState) -> Knowledge | None:
        return self.inner.knows(state.inner)

    def refused(self, context: Context, parameters: Parameters) -> str:
        return self.inner.refused(context, parameters)

    def finite(self, state: GuardState) -> bool:
        return self.inner.finite(state.inner)

    def status(self, state: GuardState) -> str:
        return SENTENCES[state.reason] or self.inner.status(state.inner)


def step_together(compensators: Sequence[Compensator], states: Sequence[GuardState]) -> GuardedLegs | None:
    """What steps these legs in one call: None where they are not one algorithm behind guards. Start parameters are each leg's own."""
    bare = [one.inner if isinstance(one, Started) else one for one in compensators]
    guarded = bare[0] if bare else None
    if not isinstance(guarded, Guarded) or any(other != guarded for other in bare):
        return None
    return GuardedLegs(guarded, states)


class GuardedLegs:
    """Legs of one machine behind guards, stepped together; their states stay those of `Guarded.step`."""

    def __init__(self, guarded: Guarded, states: Sequence[GuardState]) -> None:
        self.algorithm, self.states = guarded.inner, states
        self.guards = np.concatenate([state.guards for state in states])
        for i, state in enumerate(states):
            state.guards = self.guards[i : i + 1]
        self.inner: Together = stepper(guarded.inner, [state.inner for state in states])
        n = len(states)
        self._todo, self._reasons = np.zeros(n, np.int64), np.array([state.reason for state in states], np.int64)
        self._finite, self._acts, self._all = np.ones(n, bool), np.ones(n, bool), False
        self.may_speak = True  # whether a leg's status may be another one than at the tick before

    def step(self, legs: Legs) -> np.ndarray:
        """Volts that are added (n_legs,)."""
        added, had_all = np.zeros(len(self.states)), self._all
        self._all = check_legs(
            self.guards,
            legs.setpoint_m,
            legs.preview_m,
            legs.counts,
            legs.position_m,
            legs.control_V,
            legs.valve_V,
            legs.pressure_bottom_Pa,
            legs.pressure_top_Pa,
            legs.pressure_supply_Pa,
            self._todo,
        )
        np.equal(self._todo, Todo.ACT, out=self._acts)
        self.inner.step(legs, self._acts, added, self._finite)
        if isinstance(self.inner, OneByOne):
            for state, inner in zip(self.states, self.inner.states, strict=True):
                state.inner = inner  # a step may give a new one
        changed = accept_legs(self.guards, self._todo, added, legs.feed_forward_V, self._finite, self._reasons)
        if changed or not (self._all and had_all):
            self._follow(self._todo.tolist(), self._reasons.tolist())
        self.may_speak = changed or self.inner.may_speak
        return added

    @property
    def of_desk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What `step_desk` needs beside a desk: guards, todo, reasons."""
        return self.guards, self._todo, self._reasons

    def follow(self) -> None:
        """After a tick by `step_desk`: what Python notes of it, and new starts after a fault."""
        self._follow(self._todo.tolist(), self._reasons.tolist())

    def _follow(self, todo: list[int], reasons: list[int]) -> None:
        """The states' own notes, and new starts after a fault."""
        for i, state in enumerate(self.states):
            state.reason, state.acted = reasons[i], todo[i] == Todo.ACT
            if todo[i] == Todo.BEGIN_ANEW:
                state.inner = self.algorithm.start(state.context)
            elif todo[i] == Todo.RESTART:
                state.inner = self.algorithm.resume(state.context, self.algorithm.parameters(state.inner))
            else:
                continue
            self.inner.renew(i, state.inner)

    def share(self, alike: np.ndarray) -> None:
        """What legs have just learned, to those that are alike (n_legs, n_legs)."""
        self.inner.share(self._acts & (self._reasons == Reason.SOUND), alike)
