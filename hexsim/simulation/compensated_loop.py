# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions)
"""A control tick of legs with compensators in compiled code: what `TickLoop._control` and `PositionLoop.tick` do, without Python.

It is called at an address with one record, `TICK`, of sizes and of addresses of the run's arrays, so that the loop of ticks is compiled
once for all algorithms. Python is asked for what is rare: a change of a guard's reason, ticks at which a leg is held off,
and those at which a leg adds volts that is not yet noted in `PositionLoop.first_s`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from compensation.compensator import MEASURED_TICKS
from compensation.compiled import sources_digest as compensation_sources
from compensation.desk import LEGS, Desk, doubles, integers, pointer, rows
from compensation.guard import GUARD, share_desk, step_desk
from compensation.native_ticks import put_on
from compensation.records import record
from hexsim import compiled
from hexsim.hydraulics import chamber
from hexsim.motion_computer import controller
from hexsim.motion_computer.controller import N_CONSTANTS, N_MEMORY, C, Control
from hexsim.motion_computer.leg_load import SLOPE, SPAN
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant.callbacks import MPa
from hexsim.plant.states import A
from hexsim.plant.stepping import copy
from hexsim.sensors.bank import measure, reading
from hexsim.simulation.plain_loop import call_control

Array = NDArray[np.float64]
POSITION, BOTTOM, TOP = "position", "pressure_bottom", "pressure_top"
ERRORS = ("noise", "gain", "offset", "resolution")
SENSORS = tuple(f"{stem}_{error}" for stem in (POSITION, BOTTOM, TOP) for error in ERRORS)
SIZES = ("n", "every", "preview", "has_top", "has_load", "feels", "running", "had_all", "supply_place")
OF_LOAD, OF_POSE = ("inertia", "stiffness", "neutral", "mobility"), ("by_place", "bend", "drift")
PLACES = (
    "constants", "inertia", "memory", "setpoints", "positions", "pressures", "rod_sides", "act", "supply_noise", "areas", "seen",
    *(f"load_{name}" for name in OF_LOAD), *OF_POSE, "path", "followed", "forward", "asked", "load", "commanded", "valve",
    "compensation", "added_ticks", "first_s", "ticks", "guards", "todo", "reasons", "desk", "step", "follow",
)  # fmt: skip
NUMBERS = ("tick_s", "control_tick_s", "supply_Pa", "supply_gain", "supply_offset", "supply_resolution", "share")
TICK = record(**dict.fromkeys(SIZES + PLACES + SENSORS, "i8"), **dict.fromkeys(NUMBERS, "f8"))


class CompensatedLoop:
    """What the compiled tick of a run (`TickLoop`) needs: its record, and the arrays whose addresses stand there. `address` is 0 where
    the run's algorithm has no native tick, or a transducer does not read the present value alone. follow: address of a CONTROL."""

    def __init__(self, run: Any, loop: PositionLoop, follow: int) -> None:
        self.address, self.record, self.kept = 0, np.zeros(1, TICK), {}
        sensors, plant, n = run.sensors, run.plant, len(run.volts)
        stems = [POSITION, BOTTOM, *([TOP] if len(run.rod_sides) else [])]
        if loop.together is None or not all(sensors[stem].is_direct for stem in stems):
            return
        load, pose, supply, none = loop.load, loop.pose_load, sensors["pressure_supply"], np.zeros(0)
        desk = Desk(n, loop.preview, 0 if load is None else loop.preview, pose is not None, loop.counts, loop.alike)
        step = put_on(desk, loop.together.inner)
        if step == 0:
            return
        guards, todo, reasons = loop.together.of_desk
        arrays = {
            "constants": loop.control.rows, "inertia": loop.control.inertia, "memory": loop.memory, "setpoints": run.setpoints,
            "positions": run.record.positions, "pressures": run.pressures, "rod_sides": run.rod_sides, "act": plant.data.act,
            "supply_noise": supply.noise, "areas": loop.areas, "seen": np.zeros((SPAN, 2, n)), "path": np.zeros((loop.preview, n)),
            "valve": run.volts, "compensation": loop.compensation, "added_ticks": loop.added_ticks, "first_s": loop.first_s,
            "ticks": loop.ticks, "guards": guards, "todo": todo, "reasons": reasons, "desk": desk.record,
            **{name: np.zeros(n) for name in ("followed", "forward", "asked", "commanded", "load")},
            **{f"load_{name}": none if load is None else getattr(load, name) for name in OF_LOAD},
            **{name: none if pose is None else getattr(pose, name) for name in OF_POSE},
            **{f"{stem}_{error}": getattr(sensors[stem], error) for stem in stems for error in ERRORS},
        }  # fmt: skip
        for name, array in arrays.items():
            self.kept[name] = np.ascontiguousarray(array)
            self.record[name] = self.kept[name].ctypes.data
        numbers: dict[str, float] = {
            "n": n, "every": run.control_every, "preview": loop.preview, "has_top": TOP in stems, "has_load": load is not None,
            "feels": pose is not None, "supply_place": plant.layout[0, A.SUPPLY], "tick_s": run.tick_s,
            "control_tick_s": 1.0 / plant.machine.controller.rate_Hz, "supply_Pa": plant.supply_pressure(),
            "supply_gain": supply.gain[0], "supply_offset": supply.offset[0], "supply_resolution": supply.resolution[0],
            "share": loop.compensation_share, "step": step, "follow": follow,
        }  # fmt: skip
        for name, value in numbers.items():
            self.record[name] = value
        self.desk, self.address = desk, native_control().address


def with_desk(function: Callable[..., Any]) -> Any:
    """A compiled function that holds layouts and calls functions of `compensation`."""
    return compiled.compiled(function, compensation_sources(), allocates=True)


@with_desk
def expected_load(path, inertia, stiffness, neutral, tick_s, out):
    """As `ExpectedLoad.accelerations`, of setpoints (m, n), into out (n, m)."""
    m, n = path.shape
    for i in range(n):
        for k in range(m):
            middle, total, held = min(max(k, 1), m - 2), 0.0, 0.0
            for j in range(n):
                if m > 2:
                    total += inertia[i, j] * (path[middle + 1, j] - 2.0 * path[middle, j] + path[middle - 1, j])
                held += stiffness[i, j] * (path[k, j] - neutral[j])
            out[i, k] = total / tick_s**2 + held


@with_desk
def watch_legs(t, seen, positions, pressures, tops, supply_Pa, d):
    """As `PositionLoop._watch_legs`, onto a desk."""
    n, areas, speeds = t.n, rows(t.areas, 2, t.n), doubles(d.speeds_m_s, t.n)
    for i in range(n):
        top = tops[i] if t.has_top else supply_Pa
        force, position = pressures[i] * areas[0, i] - top * areas[1, i], positions[i]
        if t.running == 0:
            for k in range(SPAN):
                seen[k, 0, i], seen[k, 1, i] = position, force
        if not math.isfinite(position):
            position = seen[SPAN - 1, 0, i]
        if not math.isfinite(force):
            force = seen[SPAN - 1, 1, i]
        speed = 0.0
        for k in range(SPAN - 1):
            seen[k, 0, i], seen[k, 1, i] = seen[k + 1, 0, i], seen[k + 1, 1, i]
            speed += SLOPE[k] * seen[k, 0, i]
        seen[SPAN - 1, 0, i], seen[SPAN - 1, 1, i] = position, force
        speeds[i] = (speed + SLOPE[SPAN - 1] * position) / t.control_tick_s
    copy(doubles(d.forces_N, n), seen[MEASURED_TICKS, 1])
    load_of_pose(t, seen[MEASURED_TICKS, 0], speeds, rows(d.mobility, n, n), doubles(d.pose_m_s2, n))


@with_desk
def load_of_pose(t, positions, speeds, mobility, load):
    """As `PoseLoad.at`, into mobility (n, n) and load (n,)."""
    n, neutral, stiffness = t.n, doubles(t.load_neutral, t.n), rows(t.load_stiffness, t.n, t.n)
    by_place, bend, drift = rows(t.by_place, n * n, n), rows(t.bend, n * n, n), rows(t.drift, n * n, n)
    at_neutral, held = rows(t.load_mobility, n, n), np.empty(n)
    for i in range(n):
        held[i] = 0.0
        for j in range(n):
            mobility[i, j], bent = at_neutral[i, j], stiffness[i, j]
            for k in range(n):
                away = positions[k] - neutral[k]
                mobility[i, j] += by_place[i * n + j, k] * away
                bent += bend[i * n + j, k] * away
            held[i] += bent * (positions[j] - neutral[j])
    for i in range(n):
        own, load[i] = mobility[i, i], 0.0
        for j in range(n):
            load[i] += mobility[i, j] * held[j]
            for k in range(n):
                load[i] -= drift[i * n + j, k] * speeds[k] * speeds[j]
            mobility[i, j] /= own
        load[i] /= own


@with_desk
def sensed(true, noise, gain, offset, resolution, k, n):
    """What transducers at addresses read at tick k (n,)."""
    return measure(true, doubles(noise + 8 * k * n, n), doubles(gain, n), doubles(offset, n), doubles(resolution, n))


@with_desk
def control_tick(t, k):
    """Volts of tick k into `valve`. Returns 0, or what Python answers."""
    n, time_s = t.n, k * t.tick_s
    d, control = (
        carray(pointer(t.desk), (1,), LEGS)[0],
        Control(rows(t.constants, n, N_CONSTANTS), rows(t.inertia, n, n)),
    )
    memory, asked, followed = rows(t.memory, n, N_MEMORY), doubles(t.asked, n), doubles(t.followed, n)
    setpoints = rows(t.setpoints + 8 * (k // t.every) * n, t.preview, n)
    path, load, commanded = rows(t.path, t.preview, n), doubles(t.load, n), doubles(t.commanded, n)
    positions = sensed(
        doubles(t.positions + 8 * k * n, n), t.position_noise, t.position_gain, t.position_offset, t.position_resolution, k, n
    )  # fmt: skip
    pressures = sensed(
        doubles(t.pressures + 8 * k * n, n), t.pressure_bottom_noise, t.pressure_bottom_gain, t.pressure_bottom_offset,
        t.pressure_bottom_resolution, k, n,
    )  # fmt: skip
    tops = np.zeros(n)
    if t.has_top:
        tops = sensed(
            doubles(t.rod_sides + 8 * k * n, n), t.pressure_top_noise, t.pressure_top_gain, t.pressure_top_offset,
            t.pressure_top_resolution, k, n,
        )  # fmt: skip
    supply_Pa = t.supply_Pa
    if t.supply_place >= 0:
        supply_Pa = chamber.pressure(doubles(t.act, t.supply_place + 1)[t.supply_place] * MPa)
    supply_Pa = reading(
        supply_Pa, doubles(t.supply_noise, k + 1)[k], t.supply_gain, t.supply_offset, t.supply_resolution
    )
    for i in range(n):
        load[i] = pressures[i] - (control.rows[i, C.AREA_RATIO] * tops[i] if t.has_top else 0.0)
    if t.running == 0:
        controller.begin(control, memory, setpoints[0], positions, load)
    forward, own = doubles(t.forward, n), doubles(d.forward_V, n)
    controller.ask(control, memory, setpoints, positions, load, path, followed, forward, own, asked)
    preview = rows(d.preview_m, n, t.preview)
    for i in range(n):
        for j in range(t.preview):
            preview[i, j] = path[j, i]
    if t.has_load:
        inertia, stiffness = rows(t.load_inertia, n, n), rows(t.load_stiffness, n, n)
        expected_load(
            path, inertia, stiffness, doubles(t.load_neutral, n), t.control_tick_s, rows(d.loads_m_s2, n, t.preview)
        )
    if t.feels:
        watch_legs(t, carray(pointer(t.seen), (SPAN, 2, n), np.float64), positions, pressures, tops, supply_Pa, d)
    t.running = 1
    d.time_s, d.supply_Pa = time_s, supply_Pa
    copy(doubles(d.setpoint_m, n), followed)
    copy(doubles(d.position_m, n), positions)
    copy(doubles(d.control_V, n), asked)
    copy(doubles(d.valve_V, n), commanded)
    copy(doubles(d.bottom_Pa, n), pressures)
    copy(doubles(d.top_Pa, n), tops)
    if not compensate(t, d, k, asked):
        return 1
    controller.send(control, memory, asked, commanded, doubles(t.valve, n))
    return 0


@with_desk
def compensate(t, d, k, asked):
    """As `PositionLoop._compensate`. Returns whether the run goes on."""
    n, reasons = t.n, integers(t.reasons, t.n)
    guards = carray(pointer(t.guards), (n,), GUARD)
    all_act, changed = step_desk(guards, integers(t.todo, n), reasons, t.desk, t.step)
    added, out = doubles(d.added_V, n), doubles(t.compensation, n)
    counts, first_s, first = integers(t.added_ticks, n), doubles(t.first_s, n), False
    for i in range(n):
        out[i] = added[i] * t.share
        asked[i] += out[i]
        if out[i] != 0.0:
            counts[i] += 1
            first = first or math.isnan(first_s[i])
    integers(t.ticks, 1)[0] += 1
    follows = changed or first or not (all_act and t.had_all)
    t.had_all = all_act
    if follows and call_control(t.follow, t.follow, k) != 0:
        return False
    share_desk(reasons, t.desk, t.step)
    return True


@cache
def native_control() -> Any:
    """`control_tick` as a C function: int f(TICK*, tick)."""

    @compiled.compiled_callback(types.int32(types.voidptr, types.int64), compensation_sources())
    def control(data, k):
        return control_tick(carray(data, (1,), TICK)[0], k)

    return control
