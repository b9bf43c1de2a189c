# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""The compiled equations that an FMU calls, as object files, and its library."""

from __future__ import annotations

from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import carray, cfunc, njit, types

from compensation.compensator import MEASURED_TICKS
from hexsim.compiled import allocating, with_code
from hexsim.errors import HexsimError
from hexsim.export.toolchain import ERROR_PATHS, System, compile_and_link, module_of, target_machine
from hexsim.hydraulics import steps, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.steps import StepRule
from hexsim.mechanics.leg_geometry import lengths_of_rows
from hexsim.motion_computer.controller import (
    N_MEMORY,
    C,
    Control,
    begin,
    computed,
    feed_forward,
    feedback,
    leg_path,
    of_the_setpoint,
    saturated,
    smoothed,
)
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.declared_control import control_of
from hexsim.motion_computer.leg_load import SLOPE, SPAN, ExpectedLoad, PoseLoad
from hexsim.plant import Plant
from hexsim.plant.callbacks import native_callbacks
from hexsim.plant.states import ROW
from hexsim.plant.stepping import asked_steps
from hexsim.sensors.bank import SensorBank, measure

HEADERS = Path(mujoco.__path__[0]) / "include"
SOURCES = ("plant.c", "instance.c", "mujoco.c", "memory.c")
N_STIFF = 6  # coefficients of `steps.stiffness`
MEMORY = (
    *(f"NRT_{name}" for name in ("Allocate", "Free", "MemInfo_alloc", "MemInfo_alloc_aligned", "MemInfo_call_dtor")),
    "NRT_MemInfo_alloc_safe_aligned",
    "NRT_MemInfo_data_fast",
    "numba_attempt_nocopy_reshape",
)
compiled_here = njit(error_model="numpy")


class StepView(NamedTuple):
    """What the choice of steps looks at, as in `stepping.StepContext`."""

    user: Any
    act: Any
    ctrl: Any
    leg_length: Any
    leg_velocity: Any
    velocity_before: Any
    offsets: Any
    rule: Any
    time: Any


def equations(plant: Plant) -> dict[str, Any]:
    """The compiled functions that the C source calls as hexsim_NAME."""
    return _equations(plant.n_legs, len(plant.layout), plant.model.na)


@cache
def _equations(n_legs: int, n_actuators: int, n_states: int) -> dict[str, Any]:
    number, pointer = types.float64, types.CPointer(types.float64)
    stiffness, own_frequency, rule_of, rate = steps.stiffness, steps.own_frequency, steps.rule_of, steps.supply_rate
    steps_by_rule = steps.count_steps_by_rule

    @cfunc(number(pointer, pointer), error_model="numpy")
    def stiff(row, out):
        out[0], out[1], out[2], out[3], out[4], out[5] = stiffness(row)
        return own_frequency(row)

    @cfunc(number(pointer, pointer, pointer), error_model="numpy")
    def rule(fastest, supply, out):
        out[0], out[1], out[2], out[3] = rule_of(
            fastest[0], fastest[1], fastest[2], fastest[3], fastest[4], fastest[5], fastest[6], rate(supply)
        )
        return 0.0

    @cfunc(number(*[pointer] * 9, number, number), error_model="numpy")
    def choose(user, act, ctrl, length, velocity, before, calm_s, numbers, timestep, time, span_s):
        rows = carray(user, (n_actuators, ROW))
        view = StepView(
            rows,
            carray(act, (n_states,)),
            carray(ctrl, (n_actuators,)),
            carray(length, (n_legs,)),
            carray(velocity, (n_legs,)),
            carray(before, (n_legs,)),
            rows[:n_legs, P.LENGTH_OFFSET],
            StepRule(numbers[0], numbers[1], numbers[2], numbers[3]),
            (time,),
        )
        asked, near = asked_steps(view)
        calm_s[0] = 0.0 if near else calm_s[0] + span_s
        steps = steps_by_rule(view.rule, asked, calm_s[0], span_s)
        timestep[0] = span_s / steps
        return steps

    @cfunc(types.void(number, pointer, pointer, number, number), error_model="numpy")
    def hysteresis(volts, spool_volts, apart, half_width, spread):
        held, between = carray(spool_volts, (1,)), carray(apart, (1,))
        held[0], between[0] = valve.hysteresis(volts, held[0], between[0], half_width, spread)

    act_dyn, act_bias = map(with_code, native_callbacks())
    return {
        "act_dyn": act_dyn,
        "act_bias": act_bias,
        "hysteresis": hysteresis,
        "stiffness": stiff,
        "rule": rule,
        "choose": choose,
    }


def loop_equations(plant: Plant) -> dict[str, Any]:
    """What the motion computer of the plant's machine adds: legs from setpoints and its declared controllers, up to the
    volts that are asked for (control), and from there to the valves (command). A compensator may add in between.

    `followed` (2, n_legs): setpoints behind their filter, and before it, which a compensator is given. Positions and
    pressures are read in place, with the declared gain, offset and resolution, without noise.
    """
    number, pointer = types.float64, types.CPointer(types.float64)
    n_legs, control, n_inputs = plant.n_legs, control_of(plant.machine), len(plant.kinematics.dofs)
    sensors = SensorBank(plant.resolved, 1, 1.0 / plant.machine.controller.rate_Hz, 0)
    position, bottom, supply = (_reading(sensors[stem]) for stem in ("position", "pressure_bottom", "pressure_supply"))
    piston_positions, ratio = _setpoints_of(plant), control.rows[:, C.AREA_RATIO].copy()
    rows, inertia, size = control.rows, control.inertia, N_MEMORY

    @cfunc(number(*[pointer] * 10, number), error_model="numpy")
    def control_tick(
        inputs, places, pressures, tops, supply_pressure, memory, setpoints, followed, forward, asked, is_first
    ):
        setpoint, path, out = carray(setpoints, (n_legs,)), carray(followed, (2, n_legs)), carray(asked, (n_legs,))
        ahead, kept, top = carray(forward, (n_legs,)), carray(memory, (n_legs, size)), carray(tops, (n_legs,))
        at, below = carray(places, (n_legs,)), carray(pressures, (n_legs,))
        setpoint[:] = piston_positions(carray(inputs, (n_inputs,)))
        at[:], below[:] = read(at, position), read(below, bottom)
        load, declared = below - ratio * top, Control(rows, inertia)
        if is_first > 0.0:
            begin(declared, kept, setpoint, at, load)
        leg_path(declared, kept, setpoint.reshape(1, -1), path[1:])
        smoothed(declared, kept, path[1], path[0])
        feed_forward(declared, kept, path[0], ahead)
        feedback(declared, kept, path[0], at, load, out)
        for i in range(n_legs):
            out[i] += ahead[i]
        of_the_setpoint(declared, kept, ahead, ahead)
        feeding = carray(supply_pressure, (1,))
        feeding[:] = read(feeding, supply)
        return 0.0

    @cfunc(number(*[pointer] * 4), error_model="numpy")
    def command(memory, asked, commanded, volts):
        declared, kept, sent = Control(rows, inertia), carray(memory, (n_legs, size)), carray(commanded, (n_legs,))
        saturated(declared, kept, carray(asked, (n_legs,)), sent)
        computed(declared, kept, sent, carray(volts, (n_legs,)))
        return 0.0

    return {"control": control_tick, "command": command}


def watch_legs(plant: Plant) -> Any:
    """What compensators of a platform's legs feel, as `PositionLoop`: of MEASURED_TICKS ago the mobility over each leg's own
    (n_legs, n_legs), the load by pose and speeds, forces and speeds (n_legs,). seen (SPAN, 2, n_legs): positions and forces."""
    number, pointer, machine, n = types.float64, types.CPointer(types.float64), plant.machine, plant.n_legs
    load = ExpectedLoad.of(plant.resolved)
    assert load is not None  # a platform
    by_pose, tick_s = PoseLoad.of(plant.resolved, load), 1.0 / machine.controller.rate_Hz
    contexts = [compensator_context(machine, None, leg, load) for leg in range(1, n + 1)]
    bottom_m2, top_m2 = (
        np.array([getattr(one, name) for one in contexts]) for name in ("area_bottom_m2", "area_top_m2")
    )
    four_way, neutral, mobility_0, stiffness = contexts[0].four_way, load.neutral, load.mobility, load.stiffness
    by_place, bend, drift = (np.ascontiguousarray(one) for one in (by_pose.by_place, by_pose.bend, by_pose.drift))
    slope, span, middle = SLOPE / tick_s, SPAN, MEASURED_TICKS

    @cfunc(types.void(*[pointer] * 9, number), error_model="numpy")
    def watch(places, bottoms, tops, supply, history, moves, poses, pushes, rates, is_first):
        seen, mobility, pose = carray(history, (span, 2, n)), carray(moves, (n, n)), carray(poses, (n,))
        forces, speeds = carray(pushes, (n,)), carray(rates, (n,))
        for _ in range(span if is_first > 0.0 else 1):
            for t in range(span - 1):
                for i in range(n):
                    seen[t, 0, i], seen[t, 1, i] = seen[t + 1, 0, i], seen[t + 1, 1, i]
            for i in range(n):
                top_Pa = tops[i] if four_way else supply[0]
                seen[span - 1, 0, i], seen[span - 1, 1, i] = places[i], bottoms[i] * bottom_m2[i] - top_Pa * top_m2[i]
        for i in range(n):
            forces[i], speeds[i] = seen[middle, 1, i], 0.0
            for t in range(span):
                speeds[i] += slope[t] * seen[t, 0, i]
        for i in range(n):
            for j in range(n):
                mobility[i, j] = mobility_0[i, j]
                for k in range(n):
                    mobility[i, j] += by_place[i, j, k] * (seen[middle, 0, k] - neutral[k])
        for i in range(n):
            pose[i] = 0.0
            for j in range(n):
                held, own = 0.0, 0.0
                for k in range(n):
                    away, bent = seen[middle, 0, k] - neutral[k], 0.0
                    for m in range(n):
                        bent += bend[j, k, m] * (seen[middle, 0, m] - neutral[m])
                    held += (stiffness[j, k] + bent) * away
                    own += drift[i, j, k] * speeds[k]
                pose[i] += mobility[i, j] * held - own * speeds[j]
        for i in range(n):
            own = mobility[i, i]
            pose[i] /= own
            for j in range(n):
                mobility[i, j] /= own

    return watch


def _reading(sensor: Any) -> tuple[Any, ...]:
    """Noise, gain, offset and resolution (n_legs,) of transducers, without noise."""
    if not sensor.is_direct:
        raise HexsimError("a sensor of the machine is late or filtered: the motion computer in an FMU reads it at once")
    return np.zeros(len(sensor.gain)), sensor.gain, sensor.offset, sensor.resolution


@allocating
def read(true, sensor):
    noise, gain, offset, resolution = sensor
    return measure(true, noise, gain, offset, resolution)


def _setpoints_of(plant: Plant) -> Any:
    """Compiled: piston positions (n_legs,) [m] of the pose (6,), or of a bench's piston (1,) itself."""
    legs = plant.kinematics
    if not legs.has_platform:
        return compiled_here(lambda inputs: inputs)
    base, platform, height = legs.base_joints, legs.platform_joints, legs.neutral_height_m
    retracted = np.ascontiguousarray(np.broadcast_to(legs.retracted_length_m, (plant.n_legs,)))
    return compiled_here(lambda pose: lengths_of_rows(pose.reshape(1, -1), base, platform, height)[0] - retracted)


def objects(functions: dict[str, Any], system: System, folder: Path) -> tuple[list[Path], list[str]]:
    """Object files of the `equations` in `folder`; and the error paths to leave empty."""
    made, missing = [], set()
    for name, function in functions.items():
        code, undefined = _object(function, name, system)
        missing |= undefined
        made.append(folder / f"{name}.{system.name}.o")
        made[-1].write_bytes(code)
    return made, sorted(missing - set(MEMORY))


@lru_cache(maxsize=64)  # most are those of all machines with so many legs; a machine has nine
def _object(function: Any, name: str, system: System) -> tuple[bytes, set[str]]:
    """Object file of one of the `equations`, and its error paths."""
    machine = target_machine(system)
    module = module_of(function, f"hexsim_{name}", system, machine, exported=False)
    undefined = [*module.functions, *module.global_variables]
    return machine.emit_object(module), {
        part.name for part in undefined if part.is_declaration and part.name.startswith(ERROR_PATHS)
    }


def link(folder: Path, system: System, fmi: int, given: list[Path], out: Path) -> None:
    """Compile the packaged C with `folder`/machine.h, and link it with the object files and libraries given to `out`."""
    ours = files("hexsim.export")
    sources = [*(Path(str(ours / name)) for name in (*SOURCES, f"fmi{fmi}.c")), *given]
    flags = ["-std=c23", "-fvisibility=hidden", "-fno-sanitize=undefined", f"-I{folder}", f"-I{HEADERS}"]
    if system.suffix == ".so":
        flags.append("-Wl,-rpath,$ORIGIN")
    compile_and_link(sources, system, out, flags)
